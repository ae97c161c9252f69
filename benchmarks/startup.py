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
"""Names of modules that `import quad_env` must not load, so that the import is fast."""
IMPORT_QUAD_ENV = "import quad_env, gymnasium"
"""Python statement that imports this package and Gymnasium; its duration is measured."""
IMPORT_GYMNASIUM = "import gymnasium"
"""Python statement that imports Gymnasium.

The duration of IMPORT_QUAD_ENV is compared with the duration of this statement."""
MAKE = "gym.make after it"
"""Name in the printed table for the duration of the first call of `gym.make`, which follows the imports."""
HELP_COMMANDS = ("python -m evaluate --help", "python -m train --help")
"""Shell commands that print a help text; each command is timed from its start to its exit."""
_TIMED = "import time; begin = time.perf_counter(); {code}; print(time.perf_counter() - begin)"
"""Template of a Python program that runs the statement `code` and prints the duration of the statement, s."""
_CODE = {
    IMPORT_QUAD_ENV: _TIMED.format(code=IMPORT_QUAD_ENV),
    IMPORT_GYMNASIUM: _TIMED.format(code=IMPORT_GYMNASIUM),
    MAKE: f"{IMPORT_QUAD_ENV}; " + _TIMED.format(code="gymnasium.make(quad_env.ENV_ID)"),
}
"""Name of a duration in the tables -> Python program that measures and prints this duration, s."""
_LOADED = f"import sys, quad_env; print(*(name for name in {FORBIDDEN_MODULES} if name in sys.modules))"
"""Python program that prints the names of the FORBIDDEN_MODULES that `import quad_env` loads."""


@dataclass(frozen=True)
class StartupBenchmarkOptions(MeasurementOptions):
    """Options of the timing of imports, of the first environment and of the help texts."""

    rounds: int = 7
    """Number of measurement rounds; results are medians over the rounds, with quartiles in brackets."""


def measure(options: StartupBenchmarkOptions) -> BenchmarkResult:
    """Time the imports, the first environment and the help texts in fresh interpreters.

    Args:
        options: Options of the command.

    Returns:
        Durations, and the ratio of two import times: this package with Gymnasium, and Gymnasium alone. The result also
        has the checks of the requirements `import`, `loaded` and `help`.
    """
    if options.quick:
        options = replace(options, rounds=1)
    timed_functions: dict[str, TimedFunction] = {name: _time_inside(code) for name, code in _CODE.items()}
    timed_functions |= {name: _time_outside(name) for name in HELP_COMMANDS}
    # The results of a warm-up round are ignored, because this round reads the files from the disk.
    warm_up = 0 if options.quick else 1
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
    """Run a new Python interpreter in the root folder of the project, and return its output.

    Args:
        *arguments: Command-line arguments of the interpreter.

    Returns:
        Text that the interpreter has printed on standard output.

    Raises:
        OSError: The interpreter exits with an error.
    """
    run = subprocess.run([sys.executable, *arguments], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if run.returncode:
        raise OSError(f"python {' '.join(arguments)} failed: {(run.stderr.splitlines() or ['no message'])[-1]}")
    return run.stdout


def _time_inside(code: str) -> TimedFunction:
    """Return a function that runs the Python program `code` and returns the duration that it prints, s."""
    return lambda: float(_python("-c", code))


def _time_outside(command: str) -> TimedFunction:
    """Return a function that runs a `python` command and returns the wall time from start to exit, s."""

    def wait() -> float:
        begin = time.perf_counter()
        _python(*command.split()[1:])
        return time.perf_counter() - begin

    return wait


main = make_command(StartupBenchmarkOptions, measure, "benchmarks.startup", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
