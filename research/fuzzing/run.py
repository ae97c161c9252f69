"""Fuzz the readers of other people's files: `python -m research fuzz FORMAT --minutes 30`, or `all`.

Each case is a valid file with a few changes by its number; `--first N --cases 1` repeats it. Findings are foreign
exceptions, messages that are not one line, hangs over 10 s, more than 1 GiB, the end of the process, and absurd
results.
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
from research.fuzzing.formats import FORMATS, OWN_ERRORS, AbsurdError

HANG = 10.0
"""s. Longest run time of a case, without waits for a processor."""
MEMORY = 2**30
"""Byte. Largest memory of a case."""
PACKAGES = "quad_env", "policies", "evaluate", "train", "live", "research"
"""Folders of the clone whose code is the project's."""
MAX_LINE = 3000
"""Largest number of characters of an error."""
REPORT_PERIOD = 10.0
"""s. Time between two lines of progress."""
READ = "read"
REFUSED = "refused"


@dataclass(frozen=True)
class FuzzOptions:
    """Fuzz the readers of a format."""

    format: Annotated[str, tyro.conf.Positional]
    """Format: one of those that `python -m research fuzz list` prints, or all."""
    minutes: float = 1.0
    """Time for each format (min, from 0.01)."""
    cases: int = 0
    """Cases of each format (count); 0 is as many as there is time for."""
    first: int = 0
    """Number of the first case (whole number from 0)."""
    seed: int = 0
    """Seed of the cases (whole number from 0)."""
    keep: Path | None = None
    """Folder for the files with findings."""


@dataclass(frozen=True)
class CaseResult:
    """Result of a case."""

    number: int
    kind: str
    """READ, REFUSED, or the finding: traceback, absurd, not one line, memory, hang, end of the process."""
    detail: str = ""


def main(options: FuzzOptions) -> int:
    """Run the cases and print the findings; return 1 if there are any."""
    check_numbers(options, {"minutes": (0.01, 1e5), "cases": (0, 10**9), "first": (0, 10**9), "seed": (0, 2**31)})
    if options.format == "list":
        print("\n".join(FORMATS))
        return 0
    if options.format not in (*FORMATS, "all"):
        raise UsageError(f"FORMAT: unknown format, got {options.format}; valid: {', '.join(FORMATS)}, all")
    found = 0
    with Interrupt() as interrupt:
        for name in FORMATS if options.format == "all" else [options.format]:
            found += _fuzz(name, options, interrupt)
    return int(found > 0)


def _fuzz(name: str, options: FuzzOptions, interrupt: Interrupt) -> int:
    """Fuzz one format and return the number of findings."""
    counts = Counter[str]()
    seen = set[tuple[str, str]]()
    end = time.monotonic() + 60.0 * options.minutes
    due = time.monotonic() + REPORT_PERIOD
    for result in _results(name, options):
        counts[result.kind] += 1
        if result.kind not in (READ, REFUSED) and (result.kind, result.detail[-200:]) not in seen:
            seen.add((result.kind, result.detail[-200:]))
            print(f"{name} {result.number}: {result.kind}\n{result.detail}".rstrip(), flush=True)
            _keep(name, options, result.number)
        now = time.monotonic()
        if now >= due:
            print(f"{name}: {_summary(counts)}; {max(0.0, (end - now) / 60.0):.1f} min left at most", file=sys.stderr)
            due = now + REPORT_PERIOD
        if interrupt.requested or now >= end or (options.cases and counts.total() >= options.cases):
            break
    print(f"{name}: {_summary(counts)}", flush=True)
    return counts.total() - counts[READ] - counts[REFUSED]


def _summary(counts: Counter[str]) -> str:
    return f"{counts.total()} cases: " + ", ".join(f"{count} {kind}" for kind, count in counts.items())


def _keep(name: str, options: FuzzOptions, number: int) -> None:
    if options.keep is not None:
        place = options.keep / f"{name}-{options.seed}-{number}"
        place.mkdir(parents=True, exist_ok=True)
        FORMATS[name][0](place, _generator(options.seed, number))


def _generator(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng((seed, number))


def run_case(name: str, seed: int, number: int) -> CaseResult:
    """Run one case in this process.

    Args:
        name: Format.
        seed: Seed of the cases.
        number: Number of the case.
    """
    write, read = FORMATS[name]
    folder = Path(tempfile.mkdtemp(prefix="fuzz-"))
    try:
        file = write(folder, _generator(seed, number))
        before = _largest_memory()
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
        if (taken := _largest_memory() - before) > MEMORY:
            return CaseResult(number, "memory", f"{taken / 2**20:.0f} MiB")
        return CaseResult(number, READ)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _is_ours(error: Exception) -> bool:
    """Return whether the project itself raised the error, and no library."""
    frames = traceback.extract_tb(error.__traceback__)
    clone = Path(__file__).parents[2]
    raised = Path(frames[-1].filename)
    return any(raised.is_relative_to(clone / package) for package in PACKAGES)  # a `.venv` lies in the clone too


def _largest_memory() -> int:
    if sys.platform == "win32":
        return 0
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)


def _results(name: str, options: FuzzOptions) -> Iterator[CaseResult]:
    """Yield results of cases by number, from a process that is replaced after it has hung or ended."""
    context: Any = multiprocessing.get_context("spawn")
    number = options.first
    while True:
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs, name, options.seed, number), daemon=True)
        process.start()
        theirs.close()
        try:
            ours.recv()  # all is imported
            while True:
                yield _next(ours, process, number)
                number += 1
        except EOFError:
            process.join(10.0)
            yield CaseResult(number, "end of the process", f"exit code {process.exitcode}")
        except TimeoutError:
            yield CaseResult(number, "hang", f"more than {HANG:g} s")
        finally:
            process.kill()
            process.join()
            ours.close()
        number += 1


def _next(ours: Connection, process: Any, number: int) -> CaseResult:
    """Return the result of that case. Raises EOFError where the process has ended, TimeoutError where it hangs."""
    clock = RunClock(process.pid)
    while not ours.poll(0.2):
        if clock.elapsed() > HANG:
            raise TimeoutError
    result: CaseResult = ours.recv()
    return result


def _work(theirs: Connection, name: str, seed: int, number: int) -> None:
    theirs.send(None)
    while True:
        theirs.send(run_case(name, seed, number))
        number += 1
