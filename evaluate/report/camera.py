"""Films one episode: a program of its own, since a missing or broken OpenGL may end a whole process.

`python -m evaluate.report.camera FOLDER` reads a pickled list of `Shot` from its input and writes 0.webp, 1.webp, ….
"""

import io
import pickle
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from evaluate.rollouts.hardware import IDEAL, Hardware
from quad_env.scenarios.named import Scenario

WIDTH, HEIGHT = 240, 180
"""Pixels of a frame."""
STEPS_PER_FRAME = 8
"""Control steps: 12.5 frames a second."""
FRAMES = 50
"""4 s"""
SHADOW_SIZE = 512
"""Pixels; the model's own 4096 take half of a small frame's time."""
QUALITY = 55


@dataclass(frozen=True)
class Shot:
    """A stretch of one episode of one policy."""

    policy: str
    scenario: Scenario
    seed: int
    first_step: int
    hardware: Hardware = IDEAL


def film(shot: Shot) -> bytes:
    """The frames one below the other, as WebP; a fallen robot is shown where it lies."""
    import gymnasium as gym
    import numpy as np
    from PIL import Image

    import policies

    policy = policies.resolve(shot.policy, actuator=shot.hardware.actuator)
    env = gym.make(
        "quad_env:SimpleQuad-v0",
        scenario=shot.scenario,
        terminate_on_fall=False,
        render_mode="rgb_array",
        width=WIDTH,
        height=HEIGHT,
        **asdict(shot.hardware),
    )
    quality = env.unwrapped.model.vis.quality  # type: ignore[attr-defined]
    quality.shadowsize, quality.offsamples = SHADOW_SIZE, 0
    observation, _ = env.reset(seed=shot.seed)
    policy.reset()
    frames = []
    for step in range(shot.first_step + FRAMES * STEPS_PER_FRAME):
        observation, _, terminated, truncated, _ = env.step(policy.act(observation))
        if step >= shot.first_step and (step - shot.first_step) % STEPS_PER_FRAME == 0:
            frames.append(np.asarray(env.render()))
        if terminated or truncated:
            break
    frames = frames or [np.asarray(env.render())]
    env.close()
    buffer = io.BytesIO()
    strip = np.concatenate(frames + frames[-1:] * (FRAMES - len(frames)))
    Image.fromarray(strip).save(buffer, "webp", quality=QUALITY, method=1)
    return buffer.getvalue()


def main(folder: Path) -> None:
    """Film what the input asks for."""
    for number, shot in enumerate(pickle.load(sys.stdin.buffer)):
        (folder / f"{number}.webp").write_bytes(film(shot))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
