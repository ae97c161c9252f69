"""Films one episode: a program of its own, since a missing or broken OpenGL may end a whole process.

`python -m evaluate.report.camera FOLDER` reads a pickled list of `Shot` from its input and writes 0.webp, 1.webp, ….
"""

import io
import pickle
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from evaluate.film.frames import frames_of
from evaluate.rollouts.hardware import IDEAL, Hardware
from quad_env.scenarios.named import Scenario

WIDTH, HEIGHT = 240, 180
"""Pixels of a frame."""
STEPS_PER_FRAME = 8
"""Control steps: 12.5 frames a second."""
FRAMES = 50
"""4 s"""
QUALITY = 55


@dataclass(frozen=True)
class Shot:
    """A stretch of one episode of one policy."""

    policy: str
    scenario: Scenario
    seed: int
    first_step: int
    hardware: Hardware = IDEAL
    trust: bool = False
    """Whether its policy may be loaded from a file in which code can be hidden."""


def film(shot: Shot) -> bytes:
    """The frames one below the other, as WebP."""
    frames = frames_of(
        shot.hardware.policy(shot.policy, shot.trust),
        shot.scenario,
        shot.seed,
        first=shot.first_step + 1,
        every=STEPS_PER_FRAME,
        count=FRAMES,
        size=(WIDTH, HEIGHT),
        hardware=shot.hardware,
    )
    buffer = io.BytesIO()
    Image.fromarray(np.concatenate(frames)).save(buffer, "webp", quality=QUALITY, method=1)
    return buffer.getvalue()


def main(folder: Path) -> None:
    """Film what the input asks for."""
    for number, shot in enumerate(pickle.load(sys.stdin.buffer)):
        (folder / f"{number}.webp").write_bytes(film(shot))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
