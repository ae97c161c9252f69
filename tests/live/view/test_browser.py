"""A user's session with the live view: the command, a browser, keys, and the robot's state on the page."""

import math
import re
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, sync_playwright

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.rendering,
    pytest.mark.skipif(CHROMIUM is None, reason="needs a browser: apt-get install chromium"),
]
QUIET = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync")
PAD = """
const buttons = Array.from({length: 16}, () => ({pressed: false}));
const pad = {connected: true, id: "a pad", axes: [0, 0, 0, 0], buttons};
Object.defineProperty(navigator, "getGamepads", {value: () => (window.name === "pad" ? [pad] : [])});
addEventListener("stick", ({detail}) => { pad.axes = detail; });
"""
"""Simulated gamepad, since a browser has none without hardware; the page's own code reads it."""


PATIENCE = 300
"""s. Largest time for any change of the page on a busy machine; it is no requirement on speed."""


@pytest.fixture(scope="module")
def address(running: Any) -> Iterator[str]:
    command = [sys.executable, "-m", "quad_env", "view", "--policy", "trot", "--port", "0"]
    with running(command, longest=900.0) as view:
        told = view.stdout.readline()
        found = re.search(r"http://localhost:\d+/", told)
        assert found, told
        yield found.group()
        view.send_signal(signal.SIGINT)
        _, complaint = view.communicate(timeout=PATIENCE)
    assert view.returncode == 130
    assert complaint == "interrupted: the view has ended\n"


@pytest.fixture(scope="module")
def page(address: str) -> Iterator[Page]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        found = browser.new_page(viewport={"width": 1280, "height": 900})
        found.set_default_timeout(1000 * PATIENCE)
        found.add_init_script(PAD)
        problems: list[str] = []
        found.on("pageerror", lambda error: problems.append(str(error)))
        found.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        found.goto(address)
        yield found
        browser.close()
    assert problems == []


def told(page: Page, name: str, robot: int = 0) -> str:
    """Return an entry of a robot in the page's table."""
    return page.locator(f'tr.robot-{robot} td[data-name="{name}"]').inner_text()


def number(page: Page, name: str) -> float:
    return float(told(page, name))


def until(page: Page, shown: Callable[[], bool]) -> None:
    """Wait until a condition on the page holds."""
    end = time.monotonic() + PATIENCE
    while not shown():
        assert time.monotonic() < end
        page.wait_for_timeout(50)


def clock(page: Page) -> float:
    """Return the simulated time, s."""
    return float(page.locator("#clock").inner_text().split()[0])


def walk(page: Page, seconds: float) -> None:
    """Wait until `seconds` of simulated time have passed."""
    end = clock(page) + seconds
    until(page, lambda: clock(page) >= end)


def frames(page: Page) -> int:
    """Return the number of pictures that the page has shown."""
    return int(page.locator("#frame").get_attribute("data-frames") or 0)


def test_the_arrow_up_has_the_robot_walk_ahead_and_the_arrow_left_turn_left(page: Page) -> None:
    page.locator("#frame[data-frames]").wait_for()
    before = number(page, "x, m"), number(page, "y, m"), number(page, "heading, °")
    for _ in range(5):
        page.keyboard.press("ArrowUp")
    assert page.locator("#forward-value").inner_text() == "0.50"
    walk(page, 2.0)
    after = number(page, "x, m"), number(page, "y, m")
    ahead = math.cos(math.radians(before[2])), math.sin(math.radians(before[2]))
    gone = sum((b - a) * way for a, b, way in zip(before, after, ahead, strict=False))
    assert 0.3 < gone < 3.0
    page.keyboard.press("Space")
    assert page.locator("#forward-value").inner_text() == "0.00"
    before_turn = number(page, "heading, °")
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    walk(page, 1.5)
    page.keyboard.press("Space")
    assert 15.0 < (number(page, "heading, °") - before_turn) % 360.0 < 180.0


def test_a_gamepads_stick_walks_and_its_release_stands(page: Page) -> None:
    page.evaluate("() => { window.name = 'pad'; }")
    page.evaluate("() => dispatchEvent(new CustomEvent('stick', {detail: [0, -0.6, 0, 0]}))")
    page.locator("#pad", has_text="a pad").wait_for()
    until(page, lambda: 0.4 < float(page.locator("#forward-value").inner_text()) < 1.0)
    page.evaluate("() => dispatchEvent(new CustomEvent('stick', {detail: [0, 0, 0, 0]}))")
    until(page, lambda: page.locator("#forward-value").inner_text() == "0.00")
    page.evaluate("() => { window.name = ''; }")


def test_policies_are_changed_under_way_and_two_walk_side_by_side(page: Page) -> None:
    page.select_option("#policy-0", "residual")
    page.locator("tr.robot-0", has_text="residual").wait_for()
    assert number(page, "correction, % of the authority") >= 0.0
    page.select_option("#policy-1", "trot")
    page.locator("tr.robot-1", has_text="trot").wait_for()
    assert page.locator("#legend").inner_text() == "Latest 6 s of command, residual, trot"
    for policy in ("residual", "trot"):
        page.locator("#outcomes p", has_text=f"{policy}: undecided until 10 s").wait_for()
    page.select_option("#policy-1", "")
    page.locator("tr.robot-1").wait_for(state="detached")


def test_scenario_and_push_from_the_page(page: Page) -> None:
    page.select_option("#scenario", "slope")
    page.locator("#clock", has_text="slope=").wait_for()
    page.fill("#scenario-name", "rough:3")
    page.click("#go")
    page.locator("#clock", has_text="rough:3").wait_for()
    until(page, lambda: page.locator("#scenario").input_value() == "rough")
    assert page.locator("#severity-value").inner_text() == "0.180 m"
    page.fill("#scenario-name", "nowhere")
    page.click("#go")
    page.locator("#events .bad", has_text="unknown scenario").wait_for()
    page.click("#push")
    page.locator("#events li", has_text="pushed by hand").wait_for()


def test_the_cause_of_a_fall_is_shown_and_stays_until_the_next_episode(page: Page) -> None:
    page.keyboard.press("r")
    page.locator("#impulse").fill("100")
    assert page.locator("#impulse-value").inner_text() == "100 N·s"
    fallen = page.locator("#outcomes .robot-0 .bad", has_text="; cause: pushed over")
    for _ in range(20):
        page.keyboard.press("x")
        walk(page, 0.5)
        if fallen.count():
            break
    before = page.locator("#outcomes").inner_text()
    assert "a push of" in before
    walk(page, 0.5)
    assert page.locator("#outcomes").inner_text() == before
    page.keyboard.press("r")
    fallen.wait_for(state="detached")


@pytest.mark.parametrize(("width", "height"), [(1366, 768), (1024, 640), (400, 800), (800, 400)])
def test_no_control_scrolls_the_robot_out_of_sight(page: Page, width: int, height: int) -> None:
    page.set_viewport_size({"width": width, "height": height})
    for control in ("#follow", "#reward", "#forward-slider"):
        page.locator(control).scroll_into_view_if_needed()
        shown, moved = page.locator("#frame").bounding_box(), page.locator(control).bounding_box()
        assert shown is not None
        assert moved is not None
        assert shown["height"] >= 140.0
        assert 0.0 <= shown["y"] <= height - shown["height"]
        below = moved["y"] >= shown["y"] + shown["height"]
        assert below or moved["x"] >= shown["x"] + shown["width"], "it covers the robot"
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_paused_time_stands_a_step_is_a_hundredth_of_a_second_and_the_picture_is_dragged_round(page: Page) -> None:
    page.keyboard.press("p")
    page.locator("#clock", has_text="paused").wait_for()
    before = clock(page)
    page.keyboard.press(".")
    until(page, lambda: clock(page) != before)
    assert clock(page) == pytest.approx(before + 0.01)
    last = frames(page) + 3  # the first frame may be older
    until(page, lambda: frames(page) >= last)
    still = page.locator("#frame").screenshot()
    page.locator("#frame").hover()
    page.mouse.down()
    page.mouse.move(300, 300, steps=4)
    page.mouse.up()
    until(page, lambda: page.locator("#frame").screenshot() != still)
    page.keyboard.press("p")
    until(page, lambda: clock(page) > before + 0.05)
