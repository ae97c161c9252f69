"""Fuzz test of the functions that read other people's files: `python -m research fuzz FORMAT`.

FORMAT is a file format, or `all`. In each case, the command writes a valid file with a few random changes and reads it.
The seed and the number of the case determine the changes, so that `--first N --cases 1` repeats case N.

The command reports these findings:
- an exception of a library,
- an error message of several lines,
- a case that takes longer than 10 s,
- a case that uses more than 1 GiB of memory,
- an unexpected end of the subprocess,
- an implausible result.
"""

import multiprocessing
import shutil
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from quad_env.cli.child_process import RunClock
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.interrupt import Interrupt
from research.fuzzing.formats import FORMATS, OWN_ERRORS
from research.fuzzing.readers import AbsurdError

HANG_TIME = 10.0
"""Maximum duration of a case, s; a case reads one mutated file (valid file with random changes).

The time in which the process waits for a processor does not count. A case that takes longer is a finding.
"""
MAX_MEMORY = 2**30
"""Maximum additional memory for the reading of one mutated file, bytes; more memory is a finding."""
PACKAGES = "quad_env", "policies", "evaluate", "train", "live", "research"
"""Names of the project's packages; an exception that their code raises does not come from a library."""
MAX_LINE = 3000
"""Maximum length of an error message, characters; a longer message is a finding."""
POLL_PERIOD = 0.2
"""Time between two checks of the duration of a running case, s."""
REPORT_PERIOD = 10.0
"""Time between two printed lines about the progress, s."""
READ = "read"
"""Kind of the result of a fuzz case: the mutated file was read, and its content is plausible."""
REFUSED = "refused"
"""Kind of the result of a fuzz case: the mutated file was refused with a one-line error message."""


@dataclass(frozen=True)
class FuzzOptions:
    """Options of the command `fuzz`: file format, duration of the test, and random changes of the files."""

    format: Annotated[str, tyro.conf.Positional]
    """Name of a file format, as `python -m research fuzz list` prints it, or `all` for all formats."""
    minutes: float = 1.0
    """Duration of the test of each file format, min, at least 0.01."""
    cases: int = 0
    """Number of cases (mutated files) of each file format; 0 if only --minutes limits the test."""
    first: int = 0
    """Number of the first case, a whole number >= 0."""
    seed: int = 0
    """Seed of the random changes, a whole number >= 0."""
    keep: Path | None = None
    """Folder to which the files of cases with findings are written."""


@dataclass(frozen=True)
class CaseResult:
    """Result of a case (one mutated file that was read), made by `run_case` or by the parent process."""

    number: int
    """Number of the case, >= 0; the number and the seed determine the random changes of the file."""
    kind: str
    """`read` (plausible content), `refused` (error message of one line), or the name of a finding.

    The findings are `traceback` (exception of a library), `absurd` (implausible content), `not one line` (error message
    of several lines), `memory`, `hang` and `end of the process`."""
    detail: str = ""
    """Details of a finding, for example a traceback; empty if the case is no finding."""


def main(options: FuzzOptions) -> int:
    """Run the command `fuzz`: run the cases and print the findings.

    Args:
        options: Options of the command.

    Returns:
        Exit code: 1 if there are findings, otherwise 0.

    Raises:
        UsageError: An option is invalid.
    """
    check_numbers(options, {"minutes": (0.01, 1e5), "cases": (0, 10**9), "first": (0, 10**9), "seed": (0, 2**31)})
    if options.format == "list":
        print("\n".join(FORMATS))
        return 0
    if options.format not in (*FORMATS, "all"):
        raise UsageError(f"FORMAT: unknown format, got {options.format}; valid: {', '.join(FORMATS)}, all")
    finding_count = 0
    with Interrupt() as interrupt:
        for name in FORMATS if options.format == "all" else [options.format]:
            finding_count += _fuzz(name, options, interrupt)
    return int(finding_count > 0)


def _fuzz(name: str, options: FuzzOptions, interrupt: Interrupt) -> int:
    """Run the cases (mutated files) of one file format, and print each new finding.

    Args:
        name: Name of the file format.
        options: Options of the command.
        interrupt: Object that records Ctrl-C; no further case is run after Ctrl-C.

    Returns:
        Number of cases with a finding.
    """
    counts = Counter[str]()
    seen = set[tuple[str, str]]()
    end = time.monotonic() + 60.0 * options.minutes
    due = time.monotonic() + REPORT_PERIOD
    for result in _run_cases(name, options):
        counts[result.kind] += 1
        if result.kind not in (READ, REFUSED) and (result.kind, result.detail[-200:]) not in seen:
            seen.add((result.kind, result.detail[-200:]))
            print(f"{name} {result.number}: {result.kind}\n{result.detail}".rstrip(), flush=True)
            _keep_files(name, options, result.number)
        now = time.monotonic()
        if now >= due:
            print(f"{name}: {_summarize(counts)}; {max(0.0, (end - now) / 60.0):.1f} min left at most", file=sys.stderr)
            due = now + REPORT_PERIOD
        if interrupt.requested or now >= end or (options.cases and counts.total() >= options.cases):
            break
    print(f"{name}: {_summarize(counts)}", flush=True)
    return counts.total() - counts[READ] - counts[REFUSED]


def _summarize(counts: Counter[str]) -> str:
    return f"{counts.total()} cases: " + ", ".join(f"{count} {kind}" for kind, count in counts.items())


def _keep_files(name: str, options: FuzzOptions, number: int) -> None:
    """Write the mutated files of a case into a subfolder of `options.keep`, if that is not None."""
    if options.keep is not None:
        folder = options.keep / f"{name}-{options.seed}-{number}"
        folder.mkdir(parents=True, exist_ok=True)
        FORMATS[name][0](folder, _make_generator(options.seed, number))


def _make_generator(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng((seed, number))


def run_case(name: str, seed: int, number: int) -> CaseResult:
    """Run one case in this process: write a mutated file, read it, and classify the result.

    Args:
        name: Name of the file format.
        seed: Seed of the random changes.
        number: Number of the case, >= 0; the seed and this number determine the changes.

    Returns:
        Result of the case, for example `refused` or the name of a finding.
    """
    write, read = FORMATS[name]
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        file = write(folder, _make_generator(seed, number))
        memory_before = _peak_memory()
        try:
            read(file)
        except AbsurdError as error:
            return CaseResult(number, "absurd", str(error))
        except OWN_ERRORS as error:
            if isinstance(error, UnicodeError) or (type(error) is ValueError and not _is_ours(error)):
                return CaseResult(number, "traceback", traceback.format_exc())
            if "\n" in (line := str(error)) or len(line) > MAX_LINE:
                return CaseResult(number, "not one line", line[:MAX_LINE])
            return CaseResult(number, REFUSED)
        except Exception:
            return CaseResult(number, "traceback", traceback.format_exc())
        used_memory = _peak_memory() - memory_before
        if used_memory > MAX_MEMORY:
            return CaseResult(number, "memory", f"{used_memory / 2**20:.0f} MiB")
        return CaseResult(number, READ)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _is_ours(error: Exception) -> bool:
    """Return True if the code of this project raised the exception, False if a library raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    clone = Path(__file__).parents[2]
    raised = Path(frames[-1].filename)
    # The packages are checked one by one, because the folder of the project may also contain libraries, in `.venv`.
    return any(raised.is_relative_to(clone / package) for package in PACKAGES)


def _peak_memory() -> int:
    """Return the largest memory that this process has used so far, bytes; 0 on Windows."""
    if sys.platform == "win32":
        return 0
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _run_cases(name: str, options: FuzzOptions) -> Iterator[CaseResult]:
    """Run cases of the file format `name` in a subprocess, and yield the result of each case.

    The first case has the number `options.first`. The generator never ends. If the subprocess hangs or ends during a
    case, this case is a finding, and a new subprocess continues with the next case.
    """
    context: Any = multiprocessing.get_context("spawn")
    number = options.first
    while True:
        parent_end, child_end = context.Pipe()
        process = context.Process(target=_serve_cases, args=(child_end, name, options.seed, number), daemon=True)
        process.start()
        child_end.close()
        try:
            # The first message means that the subprocess has imported all modules.
            parent_end.recv()
            while True:
                yield _receive_result(parent_end, process)
                number += 1
        except EOFError:
            process.join(10.0)
            yield CaseResult(number, "end of the process", f"exit code {process.exitcode}")
        except TimeoutError:
            yield CaseResult(number, "hang", f"more than {HANG_TIME:g} s")
        finally:
            process.kill()
            process.join()
            parent_end.close()
        number += 1


def _receive_result(parent_end: Connection, process: Any) -> CaseResult:
    """Wait for the result of the case (mutated file to read) that the subprocess runs.

    The call raises EOFError if the subprocess has ended.

    Args:
        parent_end: Connection to the subprocess.
        process: The subprocess.

    Returns:
        Result of the case.

    Raises:
        TimeoutError: The case takes longer than 10 s (HANG_TIME).
    """
    clock = RunClock(process.pid)
    while not parent_end.poll(POLL_PERIOD):
        if clock.elapsed() > HANG_TIME:
            raise TimeoutError
    result: CaseResult = parent_end.recv()
    return result


def _serve_cases(child_end: Connection, name: str, seed: int, number: int) -> None:
    """Run fuzz cases without end and send their results; this is the main function of the subprocess.

    Args:
        child_end: Connection to the parent process.
        name: Name of the file format.
        seed: Seed of the random changes.
        number: Number of the first case.
    """
    child_end.send(None)
    while True:
        child_end.send(run_case(name, seed, number))
        number += 1
