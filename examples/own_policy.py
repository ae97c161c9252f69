"""Your own policy compared with the trot and the standing robot: `python examples/own_policy.py --episodes 8`.

`python -m evaluate --policies examples/own_policy.py:ShortTrot trot` evaluates it on all the usual scenarios.
"""

import os

import numpy as np
import tyro
from numpy.typing import NDArray

from evaluate.__main__ import main as evaluate
from quad_env import OBSERVATION

DIAGONAL = np.array([0.0, np.pi, np.pi, 0.0])
"""Phases of the legs, front left, front right, hind left, hind right, rad."""
LATERAL_OFFSET = np.array([0.25, -0.25, 0.25, -0.25])
"""Lateral positions of the legs, positive to the left, m."""
STRIDE_RATE = 3.0
"""Hz."""


class ShortTrot:
    """Trot in twelve lines: legs swing at the commanded velocity, calves lift the feet."""

    def __init__(self, control_period: float) -> None:
        self.phase_step = 2.0 * np.pi * STRIDE_RATE * control_period
        self.phase = 0.0

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the joint targets, (12,), rad, for the observation of one robot, (48,)."""
        self.phase += self.phase_step
        forward, lateral, yaw_rate = observation[OBSERVATION["command"]]
        swing = np.sin(DIAGONAL + self.phase)
        lift = np.maximum(0.0, np.cos(DIAGONAL + self.phase))
        hip = 0.2 * (lateral + 0.25 * np.array([1.0, 1.0, -1.0, -1.0]) * yaw_rate) * swing
        thigh = 0.5 - 0.2 * (forward - LATERAL_OFFSET * yaw_rate) * swing + 0.15 * lift
        return np.stack((hip, thigh, -1.0 - 0.3 * lift), axis=1).ravel()


def main(episodes: int = 8, out: str = "results/own-policy") -> int:
    """Evaluate it on flat ground: print a table and write a report.

    Args:
        episodes: Episodes of each policy.
        out: Folder of the report.

    Returns:
        Exit code.
    """
    policies = ["--policies", f"{os.path.relpath(__file__)}:ShortTrot", "trot", "stand"]
    return evaluate([*policies, "--scenarios", "flat", "--episodes", str(episodes), "--out", out])


if __name__ == "__main__":
    raise SystemExit(tyro.cli(main))
