"""`python -m benchmarks.view`: the live view in a headless browser, on this machine's processors.

The browser draws in software, without graphics hardware. A residual policy walks ahead. Real time is measured by the
simulation; frames are counted when the page has drawn them. With `--seconds 3600` the growth is measured over an hour.
"""

import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.support.bars import check_requirement
from benchmarks.support.command import BenchmarkResult, OutputOptions, make_command, make_table
from quad_env.cli.command_line import UsageError
from quad_env.cli.launcher import launch
from quad_env.cli.progress import show_bar

CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
"""Names of browser executables, in the order in which the benchmark searches for them."""
FLAGS = ("--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-sync")
"""Command-line arguments of the browser that turn off its sandbox, its first-run pages and its network services."""
SOFTWARE = ("--enable-unsafe-swiftshader",)
"""Command-line argument with which the browser renders on the processor, without graphics hardware."""
WARM_UP = 5.0
"""Waiting time between the first frame and the start of a measurement that is shorter than LONG_RUN, s."""
LONG_WARM_UP = 60.0
"""Waiting time between the first frame and the start of a measurement that lasts at least LONG_RUN, s.

This time is longer than WARM_UP, because a long measurement examines the growth of memory.
"""
LONG_RUN = 600.0
"""Smallest duration of a measurement that waits LONG_WARM_UP instead of WARM_UP at its start, s."""
SAMPLE_PERIOD = 1.0
"""Time after which the benchmark reads the simulation speed on the page again, s."""
SIZE = {"width": 1280, "height": 900}
"""Width and height of the browser window, pixels."""


@dataclass(frozen=True)
class ViewBenchmarkOptions(OutputOptions):
    """Options of the measurement of the live view in a headless browser."""

    seconds: float = 60.0
    """Duration of the measurement in wall time, s."""
    scenario: str = "flat"
    """Name of the scenario on which the robots walk."""
    policy: tuple[str, ...] = ("residual",)
    """Names of policies; each policy controls one robot."""


def measure(options: ViewBenchmarkOptions) -> BenchmarkResult:
    """Measure speed, frame rate, time to the first frame and memory of the live view.

    Args:
        options: Options of the command; `seconds` is the duration of the measurement.

    Returns:
        Measured values. The result also has the checks of the requirements `view real time`, `view frames` and
        `view first frame`.
    """
    if options.quick:
        options = ViewBenchmarkOptions(quick=True, seconds=4.0, scenario=options.scenario, policy=options.policy)
    with _browser() as browser:
        figures = _watch(browser, options)
    rows = make_table("Live view in a headless browser", "viewer", "x real time", "frames/s", "first frame, s")
    rows.add_row(
        "quad_env view", f"{figures['real_time']:.2f}", f"{figures['frames']:.1f}", f"{figures['first_frame']:.1f}"
    )
    growth = make_table(f"Growth over {options.seconds:g} s", "of", "at first", "at last", "share")
    for name in ("simulation, MiB", "page, MiB"):
        first, last = figures[name]
        growth.add_row(name, f"{first:.1f}", f"{last:.1f}", f"{last / first - 1.0:+.1%}")
    checks = (
        check_requirement("view real time", figures["real_time"]),
        check_requirement("view frames", figures["frames"]),
        check_requirement("view first frame", figures["first_frame"]),
    )
    return BenchmarkResult({"view": figures}, (rows, growth), checks)


def _watch(browser: Any, options: ViewBenchmarkOptions) -> dict[str, Any]:
    """Start the live view, open it in the browser, and measure it.

    Args:
        browser: Browser of Playwright.
        options: Options of the command.

    Returns:
        Dictionary: `real_time`, simulated time per wall time; `frames`, frame rate, 1/s; `first_frame`, time from the
        start of the command to the first frame, s; `simulation, MiB` and `page, MiB`, memory at the start and at the
        end of the measurement.
    """
    arguments = ["--policy", *options.policy, "--scenario", options.scenario, "--command", "0.5", "0", "0"]
    begin = time.perf_counter()
    with _process("-m", "quad_env", "view", *arguments, "--port", "0", "--no-browser") as view:
        page = _open_page(browser, view)
        first_frame = time.perf_counter() - begin
        page.wait_for_timeout(1000 * (LONG_WARM_UP if options.seconds >= LONG_RUN else WARM_UP))
        first_memory = _memory(view.pid, page)
        speed, frame_rate = _sample(page, options.seconds)
        last_memory = _memory(view.pid, page)
        page.close()
    return {
        "real_time": speed,
        "frames": frame_rate,
        "first_frame": first_frame,
        "simulation, MiB": [first_memory[0], last_memory[0]],
        "page, MiB": [first_memory[1], last_memory[1]],
    }


def _open_page(browser: Any, view: subprocess.Popen[str]) -> Any:
    """Open the page of the live view in the browser, and wait for the first frame.

    Args:
        browser: Browser of Playwright.
        view: Process of the live view.

    Returns:
        Page of Playwright that shows the live view.

    Raises:
        UsageError: The live view has not printed the address of the page.
    """
    assert view.stdout is not None
    line = view.stdout.readline()
    address = re.search(r"http://\S+", line)
    if address is None:
        raise UsageError(f"the view did not start: {line}")
    page = browser.new_page(viewport=SIZE)
    page.goto(address.group())
    page.locator("#frame[data-frames]").wait_for(timeout=60_000)
    return page


def _sample(page: Any, seconds: float) -> tuple[float, float]:
    """Read the simulation speed on the page repeatedly, and count the frames that the page draws, for some time.

    Args:
        page: Page of Playwright that shows the live view.
        seconds: Duration, s.

    Returns:
        speed: Mean displayed speed, simulated time per wall time.
        frame_rate: Frames that the page has drawn per second of wall time, 1/s.
    """
    speeds = []
    start = time.perf_counter()
    first_frames = _frames(page)
    with show_bar("watching") as progress:
        while (passed := time.perf_counter() - start) < seconds:
            page.wait_for_timeout(1000 * SAMPLE_PERIOD)
            speeds.append(float(page.locator("#rate").inner_text().split()[0]))
            progress(min(1.0, passed / seconds))
    frame_rate = (_frames(page) - first_frames) / (time.perf_counter() - start)
    return float(np.mean(speeds)), frame_rate


def _frames(page: Any) -> int:
    """Return the number of frames that the page has drawn since it was opened."""
    return int(page.locator("#frame").get_attribute("data-frames") or 0)


def _memory(process: int, page: Any) -> tuple[float, float]:
    """Measure the memory of the live view and of its page in the browser.

    Args:
        process: Identifier of the process of the live view.
        page: Page of Playwright that shows the live view.

    Returns:
        resident: Resident memory of the process, MiB; NaN if the system has no /proc.
        heap: Memory of the JavaScript objects of the page after a garbage collection, MiB.
    """
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    session.send("Performance.enable")
    metrics = {metric["name"]: metric["value"] for metric in session.send("Performance.getMetrics")["metrics"]}
    status = Path(f"/proc/{process}/status")
    resident = re.search(r"VmRSS:\s+(\d+) kB", status.read_text(encoding="utf-8")) if status.is_file() else None
    return int(resident.group(1)) / 1024.0 if resident else float("nan"), metrics["JSHeapUsedSize"] / 2**20


@contextmanager
def _browser() -> Iterator[Any]:
    """Start a headless browser as a context manager, and close the browser at the end.

    Yields:
        Browser of Playwright.

    Raises:
        UsageError: No browser program or no Playwright is installed.
    """
    executable = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if executable is None or find_spec("playwright") is None:
        raise UsageError('needs a browser, `apt-get install chromium`, and `pip install -e ".[dev]"`')
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=[*FLAGS, *SOFTWARE])
        yield browser
        browser.close()


@contextmanager
def _process(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Start Python with the arguments `words`, as a context manager that kills the process at the end."""
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


main = make_command(ViewBenchmarkOptions, measure, "benchmarks.view", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
