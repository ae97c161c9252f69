"""A person's way with the live view: the command, a browser, keys, and what the page then says of the robot."""

import math
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.rendering,
    pytest.mark.skipif(CHROMIUM is None, reason="needs a browser: apt-get install chromium"),
]
if CHROMIUM is not None:
    from playwright.sync_api import Page, sync_playwright

QUIET = ("--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync")
PAD = """
const buttons = Array.from({length: 16}, () => ({pressed: false}));
const pad = {connected: true, id: "a pad", axes: [0, 0, 0, 0], buttons};
Object.defineProperty(navigator, "getGamepads", {value: () => (window.name === "pad" ? [pad] : [])});
addEventListener("stick", ({detail}) => { pad.axes = detail; });
"""
"""Stands in for a gamepad, which no browser without hardware has; the page's own code reads it."""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("view")
    command = [sys.executable, "-m", "quad_env", "view", "--policy", "trot", "--port", "0"]
    view = subprocess.Popen(
        [*command, "--recordings", str(folder)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert view.stdout is not None
    told = view.stdout.readline()
    found = re.search(r"http://localhost:\d+/", told)
    assert found, told + (view.communicate(timeout=10)[1] if view.poll() is not None else "")
    yield found.group()
    view.send_signal(signal.SIGINT)
    _, complaint = view.communicate(timeout=20)
    assert view.returncode == 130
    assert complaint == "interrupted: the view has ended\n"


@pytest.fixture(scope="module")
def page(address: str) -> Iterator[Page]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=list(QUIET))
        found = browser.new_page(viewport={"width": 1280, "height": 900})
        found.add_init_script(PAD)
        problems: list[str] = []
        found.on("pageerror", lambda error: problems.append(str(error)))
        found.on("console", lambda message: problems.append(message.text) if message.type == "error" else None)
        found.goto(address)
        yield found
        browser.close()
    assert problems == []


def told(page: Page, name: str, robot: int = 0) -> str:
    """What the page's table says of a robot."""
    return page.locator(f'#robot-{robot} td[data-name="{name}"]').inner_text()


def number(page: Page, name: str) -> float:
    return float(told(page, name).rstrip("°%"))


def wait(page: Page, seconds: float) -> None:
    page.wait_for_timeout(1000 * seconds)


def test_the_first_frame_comes_within_ten_seconds_of_the_command(page: Page) -> None:
    page.locator("#frame[data-frames]").wait_for(timeout=10_000)
    frames = int(page.locator("#frame").get_attribute("data-frames") or 0)
    wait(page, 1.5)
    assert int(page.locator("#frame").get_attribute("data-frames") or 0) > frames


def test_the_arrow_up_has_the_robot_walk_ahead_and_space_stand(page: Page) -> None:
    page.keyboard.press("r")
    wait(page, 1.0)
    before = number(page, "x, m"), number(page, "y, m"), number(page, "heading")
    for _ in range(5):
        page.keyboard.press("ArrowUp")
    assert page.locator("#forward-value").inner_text() == "0.50"
    wait(page, 3.0)
    after = number(page, "x, m"), number(page, "y, m")
    ahead = math.cos(math.radians(before[2])), math.sin(math.radians(before[2]))
    gone = sum((b - a) * way for a, b, way in zip(before, after, ahead, strict=False))
    assert 0.3 < gone < 3.0
    page.keyboard.press("Space")
    wait(page, 2.0)
    stood = number(page, "x, m")
    wait(page, 1.0)
    assert abs(number(page, "x, m") - stood) < 0.1


def test_the_arrow_left_turns_it_left(page: Page) -> None:
    before = number(page, "heading")
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    wait(page, 2.0)
    page.keyboard.press("Space")
    assert 15.0 < (number(page, "heading") - before) % 360.0 < 180.0


def test_a_gamepads_stick_walks_and_its_release_stands(page: Page) -> None:
    page.evaluate("() => { window.name = 'pad'; }")
    page.evaluate("() => dispatchEvent(new CustomEvent('stick', {detail: [0, -0.6, 0, 0]}))")
    page.locator("#pad", has_text="a pad").wait_for(timeout=3000)
    wait(page, 0.5)
    assert 0.4 < float(page.locator("#forward-value").inner_text()) < 1.0
    page.evaluate("() => dispatchEvent(new CustomEvent('stick', {detail: [0, 0, 0, 0]}))")
    wait(page, 0.5)
    assert page.locator("#forward-value").inner_text() == "0.00"
    page.evaluate("() => { window.name = ''; }")


def test_policies_are_changed_under_way_and_two_walk_side_by_side(page: Page) -> None:
    page.select_option("#policy-0", "residual")
    page.locator('#robot-0 td[data-name="robot"]', has_text="residual").wait_for(timeout=5000)
    assert told(page, "correction").endswith("%")
    page.check("#compare")
    page.locator('#robot-1 td[data-name="robot"]', has_text="trot").wait_for(timeout=10_000)
    page.uncheck("#compare")
    page.locator("#robot-1").wait_for(state="detached", timeout=10_000)


def test_scenario_push_and_recording_from_the_page(page: Page) -> None:
    page.select_option("#scenario", "slope")
    page.locator("#clock", has_text="slope=").wait_for(timeout=10_000)
    page.fill("#scenario-name", "rough:3")
    page.click("#go")
    page.locator("#clock", has_text="rough:3").wait_for(timeout=10_000)
    wait(page, 0.5)
    assert page.locator("#scenario").input_value() == "rough"
    assert page.locator("#severity-value").inner_text() == "0.180 m"
    page.fill("#scenario-name", "nowhere")
    page.click("#go")
    page.locator("#events .bad", has_text="unknown scenario").wait_for(timeout=5000)
    page.click("#push")
    page.locator("#events li", has_text="pushed by hand").wait_for(timeout=5000)
    page.click("#record")
    page.locator("#recording", has_text=".mcap").wait_for(timeout=10_000)
    file = Path(page.locator("#recording").inner_text())
    wait(page, 1.5)
    page.click("#record")
    page.locator("#events li", has_text="recorded").wait_for(timeout=10_000)
    assert file.stat().st_size > 10_000


def test_paused_time_stands_and_a_step_is_a_hundredth_of_a_second(page: Page) -> None:
    page.keyboard.press("p")
    page.locator("#clock", has_text="paused").wait_for(timeout=5000)
    before = float(page.locator("#clock").inner_text().split()[0])
    page.keyboard.press(".")
    wait(page, 0.5)
    assert float(page.locator("#clock").inner_text().split()[0]) == pytest.approx(before + 0.01)
    page.keyboard.press("p")
    wait(page, 0.5)
    assert float(page.locator("#clock").inner_text().split()[0]) > before + 0.05


def test_the_picture_is_dragged_round(page: Page) -> None:
    page.keyboard.press("p")
    wait(page, 0.7)
    before = page.locator("#frame").screenshot()
    page.locator("#frame").hover()
    page.mouse.down()
    page.mouse.move(300, 300, steps=4)
    page.mouse.up()
    wait(page, 0.7)
    assert page.locator("#frame").screenshot() != before
    page.keyboard.press("p")
