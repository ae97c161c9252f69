"""`python -m benchmarks.view`: the live view in a headless browser, on this machine's processors.

The browser draws in software, without graphics hardware. A residual policy walks ahead; real
time is the simulation's own, frames are those that the page has drawn. With `--seconds 3600` the growth is that of an
hour.
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
FLAGS = ("--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-sync")
SOFTWARE = ("--enable-unsafe-swiftshader",)
WARM_UP, LONG_WARM_UP = 5.0, 60.0
"""s before anything counts; of a watch of ten minutes and more, whose growth is of interest, the latter."""
LONG_RUN = 600.0
SAMPLE_PERIOD = 1.0
"""s between two readings."""
SIZE = {"width": 1280, "height": 900}


@dataclass(frozen=True)
class ViewOptions(OutputOptions):
    """The live view in real time, watched by a headless browser."""

    seconds: float = 60.0
    """How long it is watched, s."""
    scenario: str = "flat"
    """What the robot walks on."""
    policy: tuple[str, ...] = ("residual",)
    """Policies, a robot each."""


def measure(options: ViewOptions) -> BenchmarkResult:
    """Watch the view for that long."""
    if options.quick:
        options = ViewOptions(quick=True, seconds=4.0, scenario=options.scenario, policy=options.policy)
    with _browser() as browser:
        own = _watch(browser, options)
    rows = make_table("Live view in a headless browser", "viewer", "x real time", "frames/s", "first frame, s")
    rows.add_row("quad_env view", f"{own['real_time']:.2f}", f"{own['frames']:.1f}", f"{own['first_frame']:.1f}")
    growth = make_table(f"Growth over {options.seconds:g} s", "of", "at first", "at last", "share")
    for name in ("simulation, MiB", "page, MiB"):
        first, last = own[name]
        growth.add_row(name, f"{first:.1f}", f"{last:.1f}", f"{last / first - 1.0:+.1%}")
    checks = (
        check_requirement("view real time", own["real_time"]),
        check_requirement("view frames", own["frames"]),
        check_requirement("view first frame", own["first_frame"]),
    )
    return BenchmarkResult({"view": own}, (rows, growth), checks)


def _watch(browser: Any, options: ViewOptions) -> dict[str, Any]:
    words = ["--policy", *options.policy, "--scenario", options.scenario, "--command", "0.5", "0", "0"]
    begun = time.perf_counter()
    with _process("-m", "quad_env", "view", *words, "--port", "0", "--no-browser") as view:
        assert view.stdout is not None
        address = re.search(r"http://\S+", line := view.stdout.readline())
        if address is None:
            raise UsageError(f"the view did not start: {line}")
        page = browser.new_page(viewport=SIZE)
        page.goto(address.group())
        page.locator("#frame[data-frames]").wait_for(timeout=60_000)
        first_frame = time.perf_counter() - begun
        page.wait_for_timeout(1000 * (LONG_WARM_UP if options.seconds >= LONG_RUN else WARM_UP))
        memory, speeds, start, frames = [_memory(view.pid, page)], [], time.perf_counter(), _frames(page)
        with show_bar("watching") as progress:
            while (passed := time.perf_counter() - start) < options.seconds:
                page.wait_for_timeout(1000 * SAMPLE_PERIOD)
                speeds.append(float(page.locator("#rate").inner_text().split()[0]))
                progress(min(1.0, passed / options.seconds))
        rate = (_frames(page) - frames) / (time.perf_counter() - start)
        memory.append(_memory(view.pid, page))
        page.close()
    return {
        "real_time": float(np.mean(speeds)),
        "frames": rate,
        "first_frame": first_frame,
        "simulation, MiB": [simulation for simulation, _ in memory],
        "page, MiB": [heap for _, heap in memory],
    }


def _frames(page: Any) -> int:
    return int(page.locator("#frame").get_attribute("data-frames") or 0)


def _memory(process: int, page: Any) -> tuple[float, float]:
    """Of a process and of a page's objects after a collection, MiB; NaN for the former where there is no /proc."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    session.send("Performance.enable")
    metrics = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
    status = Path(f"/proc/{process}/status")
    found = re.search(r"VmRSS:\s+(\d+) kB", status.read_text(encoding="utf-8")) if status.is_file() else None
    return int(found.group(1)) / 1024.0 if found else float("nan"), metrics["JSHeapUsedSize"] / 2**20


@contextmanager
def _browser() -> Iterator[Any]:
    found = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if found is None or find_spec("playwright") is None:
        raise UsageError('needs a browser, `apt-get install chromium`, and `pip install -e ".[dev]"`')
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=[*FLAGS, *SOFTWARE])
        yield browser
        browser.close()


@contextmanager
def _process(*words: str) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


main = make_command(ViewOptions, measure, "benchmarks.view", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
