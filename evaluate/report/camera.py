"""Films one episode: a program of its own, since a missing or broken OpenGL may end a whole process.

`python -m evaluate.report.camera FOLDER` reads a pickled list of `Shot` from its input and writes 0.webp, 1.webp, ….
"""

import io
import pickle
import sys
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from evaluate.film.frames import Frames
from evaluate.rollouts.hardware import IDEAL, Hardware
from evaluate.rollouts.rollout import roll_out
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
    """The frames one below the other, as WebP; a fallen robot is shown where it lies."""
    policy, seeds = shot.hardware.policy(shot.policy, shot.trust), np.array([shot.seed])
    steps = shot.first_step + FRAMES * STEPS_PER_FRAME
    with closing(Frames(STEPS_PER_FRAME, shot.first_step + 1, width=WIDTH, height=HEIGHT)) as frames:
        roll_out(policy, shot.scenario, seeds, frames, steps=steps, terminate_on_fall=False, hardware=shot.hardware)
    buffer = io.BytesIO()
    strip = np.concatenate(frames.taken + frames.taken[-1:] * (FRAMES - len(frames.taken)))
    Image.fromarray(strip).save(buffer, "webp", quality=QUALITY, method=1)
    return buffer.getvalue()


def main(folder: Path) -> None:
    """Film what the input asks for."""
    for number, shot in enumerate(pickle.load(sys.stdin.buffer)):
        (folder / f"{number}.webp").write_bytes(film(shot))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
