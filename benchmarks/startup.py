"""`python -m benchmarks.startup`: imports, the first environment and the help, each in a fresh interpreter.

Imports are timed within the interpreter, so that its own start is not in the ratio; help is timed as a user waits
for it.
"""

import subprocess
import sys
import time
from dataclasses import dataclass, replace

from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, MeasurementOptions, format_quartiles, make_command, make_table
from benchmarks.support.measure import TimedFunction, compute_quartiles, interleave
from evaluate.records.provenance import REPOSITORY
from quad_env.cli.launcher import launch

FORBIDDEN_MODULES = ("gymnasium", "mujoco", "torch")
"""Modules that `import quad_env` must not load."""
IMPORT_QUAD_ENV = "import quad_env, gymnasium"
"""Program: the import of this package that is timed."""
IMPORT_GYMNASIUM = "import gymnasium"
"""Program: the import with which the import of this package is compared."""
MAKE = "gym.make after it"
"""Name in tables of the duration of `gym.make` for the first environment, after the imports."""
HELP_COMMANDS = ("python -m evaluate --help", "python -m train --help")
"""Commands that are timed from start to exit."""
_TIMED = "import time; begin = time.perf_counter(); {code}; print(time.perf_counter() - begin)"
"""Template of a program that runs `code` and prints the duration of `code`, s."""
_CODE = {
    IMPORT_QUAD_ENV: _TIMED.format(code=IMPORT_QUAD_ENV),
    IMPORT_GYMNASIUM: _TIMED.format(code=IMPORT_GYMNASIUM),
    MAKE: f"{IMPORT_QUAD_ENV}; " + _TIMED.format(code="gymnasium.make(quad_env.ENV_ID)"),
}
"""Name of a duration in tables -> program that prints this duration."""
_LOADED = f"import sys, quad_env; print(*(name for name in {FORBIDDEN_MODULES} if name in sys.modules))"
"""Program that prints the names of the FORBIDDEN_MODULES that `import quad_env` loads."""


@dataclass(frozen=True)
class StartupBenchmarkOptions(MeasurementOptions):
    """Durations of imports, first environment and help."""

    rounds: int = 7
    """Interleaved rounds (count). Figures are medians over them, in brackets the quartiles."""


def measure(options: StartupBenchmarkOptions) -> BenchmarkResult:
    """Time imports, first environment and help, and compute the ratio of the two imports."""
    if options.quick:
        options = replace(options, rounds=1)
    timed_functions: dict[str, TimedFunction] = {name: _time_inside(code) for name, code in _CODE.items()}
    timed_functions |= {name: _time_outside(name) for name in HELP_COMMANDS}
    warm_up = 0 if options.quick else 1  # because the first round reads files from the disk
    seconds = interleave(timed_functions, options.rounds, "start-up", warm_up)
    loaded = _python("-c", _LOADED).split()
    rows = make_table("Start-up, fresh interpreters", "", "s")
    for name, values in seconds.items():
        rows.add_row(name, format_quartiles(compute_quartiles(values), 3))
    ratio = compute_quartiles(seconds[IMPORT_QUAD_ENV] / seconds[IMPORT_GYMNASIUM])
    rows.add_row(f"{IMPORT_QUAD_ENV} / {IMPORT_GYMNASIUM}", format_quartiles(ratio))
    slower_help = max(compute_quartiles(seconds[name]).median for name in HELP_COMMANDS)
    checks = (
        check_requirement("import", ratio.median),
        check_requirement("loaded", len(loaded)),
        check_requirement("help", slower_help),
    )
    figures = {"seconds": seconds, "import_ratio": ratio, "loaded_by_quad_env": loaded}
    return BenchmarkResult(figures, (rows,), checks)


def _python(*arguments: str) -> str:
    """Run a fresh interpreter in the root of the repository and return its output.

    Args:
        *arguments: Command-line arguments of the interpreter.

    Returns:
        Text on standard output.

    Raises:
        OSError: The interpreter exits with an error.
    """
    run = subprocess.run([sys.executable, *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if run.returncode:
        raise OSError(f"python {' '.join(arguments)} failed: {(run.stderr.splitlines() or ['no message'])[-1]}")
    return run.stdout


def _time_inside(code: str) -> TimedFunction:
    """Return a function that runs a program (`code`) and returns the duration that the program prints, s."""
    return lambda: float(_python("-c", code))


def _time_outside(command: str) -> TimedFunction:
    """Return a function that runs a command and returns its duration from start to exit, s."""

    def wait() -> float:
        begin = time.perf_counter()
        _python(*command.split()[1:])
        return time.perf_counter() - begin

    return wait


main = make_command(StartupBenchmarkOptions, measure, "benchmarks.startup", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
