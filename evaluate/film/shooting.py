"""The images of a film: one episode of one policy or of several, side by side, with captions and marks."""

import math
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

from PIL import Image

from evaluate.film import captions, files, sheet
from evaluate.film.panel import Panel
from evaluate.film.scene import COMMAND
from evaluate.film.take import Look, Take
from evaluate.rollouts.observers import Step

STRIP_RATE = 5.0
"""Frames of a second from which those of a strip are chosen."""
Progress = Callable[[float], None]


def shoot(take: Take, look: Look, progress: Progress) -> Generator[Image.Image]:
    """The images, until shortly after the last robot's fall; the last one says what came of each.

    Raises:
        ValueError: there is no such camera, or a policy is for another robot.
        UsageError: nothing can be drawn here.
    """
    with ExitStack() as stack:
        panels = [stack.enter_context(closing(Panel(policy, take, look))) for policy in take.policies]
        for number in range(take.steps + 1):
            over = number == take.steps or all(panel.over for panel in panels)
            if over or number % look.every == 0:
                tiles = sheet.tiled([panel.draw(over) for panel in panels], sheet.columns_for(len(panels)))
                yield sheet.stacked([_header(tiles.width, take, look, panels[0].step, number), tiles])
                progress(number / take.steps)
            if over:
                break
            for panel in panels:
                panel.advance()
    progress(1.0)


def _header(width: int, take: Take, look: Look, step: Step, number: int) -> Image.Image:
    """Title, time and command, which are the same for all."""
    text = captions.Text(look.letters)
    image = text.band(width, 2)
    slowed = "" if look.speed == 1.0 else f" at {look.speed:g} of real time"
    room = text.write(image, f"{number * step.env.dt:.2f} s{slowed}", 0, right=True)
    text.write(image, take.title, 0, taken=room)
    command = captions.motion(step.infos["command"][0])
    text.write(image, f"command {command}", 1, captions.ink(COMMAND))
    return image


def film(take: Take, look: Look, path: Path, progress: Progress) -> None:
    """Film an episode into a file, see `files`.

    Raises:
        ValueError: there is no such camera, or a policy is for another robot.
        UsageError: nothing can be drawn here, or the film is longer than its format can be.
        OSError: nothing can be written there.
    """
    if path.suffix.lower() == files.STRIP:
        look = replace(look, rate=STRIP_RATE)
    files.check_pixels(path, (take.steps // look.every + 1) * len(take.policies) * math.prod(look.size))
    with closing(shoot(take, look, progress)) as images:
        files.write(images, path, look.period)
