"""Strips of frames: `python -m evaluate pictures` shows policies walking, one row a policy and scenario.

Look at the robot before believing a figure. With `--out docs/walking.png` and one scenario it draws the README's
picture.
"""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import policies
import quad_env
from evaluate.rollouts.frames import Frame, Frames
from evaluate.rollouts.rollout import roll_out
from evaluate.terminal.command_line import UsageError
from policies.base import CONTROL_PERIOD
from policies.files import make_writable_folder

EPISODE = 10.0
"""Length of an episode, s."""


@dataclass(frozen=True)
class Options:
    """Draw strips of frames."""

    policies: tuple[str, ...] = ("document", "document_repaired", "trot", "residual")
    """Names or folders of trained policies."""
    scenarios: tuple[str, ...] = ("flat", "push", "rough")
    """Names of scenarios."""
    out: Path = Path("results/walking.png")
    """PNG to write."""
    command: tuple[float, float, float] = (0.7, 0.0, 0.0)
    """Forward m/s, lateral m/s, yaw rate rad/s."""
    start: float = 2.0
    """Time of the first frame, s."""
    every: float = 0.06
    """Time between frames, s."""
    frames: int = 8
    """Frames a row."""
    seed: int = 0
    """Seed of the episode."""
    camera: str = "track"
    """Camera of the model: track or side."""


def main(options: Options) -> int:
    """Draw the strips; the exit code."""
    _check(options)
    try:
        draw(options)
    except ValueError as error:
        raise UsageError(str(error)) from error
    print(options.out)
    return 0


def _check(options: Options) -> None:
    """Everything that can be wrong, before anything is drawn; ValueError (PolicyError), OSError or UsageError."""
    if not (options.frames >= 1 and options.every >= 0.01 and options.start >= 0.0):
        raise UsageError("--frames must be at least 1, --every at least 0.01 s, --start not negative")
    if not options.start + options.frames * options.every <= EPISODE:
        raise UsageError(f"the last frame must lie within the episode's {EPISODE:g} s; see --start, --every, --frames")
    if not options.policies or not options.scenarios:
        raise UsageError("--policies and --scenarios must each name at least one")
    for policy in options.policies:
        policies.resolve(policy)
    try:
        for scenario in options.scenarios:
            quad_env.scenario(scenario)
    except ValueError as error:
        raise UsageError(f"--scenarios: {error}") from error
    if options.out.suffix.lower() != ".png" or options.out.is_dir():
        raise UsageError(f"--out must be a PNG file, such as results/walking.png, not {options.out}")
    make_writable_folder(options.out.parent)


def draw(options: Options) -> None:
    """Write the picture: a labelled row of frames for each policy on each scenario."""
    from PIL import Image, ImageDraw

    rows = []
    for scenario in options.scenarios:
        for policy in options.policies:
            row = Image.fromarray(np.concatenate(strip(policy, scenario, options), axis=1))
            ImageDraw.Draw(row).text((8, 6), f"{policy}, {scenario}", fill=(20, 20, 20), font_size=18)
            rows.append(np.asarray(row))
    Image.fromarray(np.concatenate(rows, axis=0)).save(options.out)


def strip(policy: str, scenario: str, options: Options) -> list[Frame]:
    """Frames of one episode; a fallen robot is shown where it lies."""
    first, every = 1 + round(options.start / CONTROL_PERIOD), round(options.every / CONTROL_PERIOD)
    steps = first + (options.frames - 1) * every
    with closing(Frames(every, first, width=240, height=200, camera=options.camera)) as frames:
        roll_out(
            policies.resolve(policy),
            scenario,
            np.array([options.seed]),
            frames,
            steps=steps,
            command=options.command,
            terminate_on_fall=False,
        )
    return frames.taken + frames.taken[-1:] * (options.frames - len(frames.taken))
