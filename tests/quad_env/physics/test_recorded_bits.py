"""The first three scenarios have the recorded episodes, independent of later additions to the environment."""

import hashlib
import platform
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest

from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import SCENARIOS
from quad_env.scenarios.scenario import Scenario
from quad_env.scenarios.terrain import SmoothRandom

HERE = (platform.machine(), version("mujoco"), "X86_V4" in np.show_config(mode="dicts")["SIMD Extensions"]["found"])
RECORDED_ON = ("x86_64", "4.0.0", True)
"""Machine, version of MuJoCo, and whether NumPy uses AVX-512; the last bits differ elsewhere."""
OLD_ROUGH = replace(SCENARIOS["rough"], terrain=SmoothRandom(0.12, 0.3, 22.0, 4.0, 0.1, 0))
"""Terrain of results from before every episode had its own surface, as in their manifests."""
RECORDED = [
    ("flat", "e1b9690c9a7d0357"),
    ("push", "ec0e3c845fd9b224"),
    ("rough", "3383746e1a204942"),
    (OLD_ROUGH, "e2f0ae28196a5411"),
]
SHOWN = [0, 1, 3, 4, 6, 7, 9, 20, 23, 45]
"""Indices of gravity, gyro, velocity, joints, a joint speed and the forward command."""
AFTER_25_STEPS = {
    "flat": [-0.045754, 0.053187, -0.032212, 1.702967, 0.158767, 0.288780, 0.017793, 0.100401, -5.375366, 0.579908],
    "rough": [-0.101359, -0.002345, -0.875917, 1.268292, -0.089952, 0.469113, 0.024164, 0.065186, -5.338287, 0.579908],
}
"""Observation of robot 2 after 25 steps on any machine, before contacts have amplified the last bits."""


def rollout(scenario: str | Scenario, steps: int = 200) -> np.ndarray:
    """Return the observations of 8 robots that move their legs, (steps + 1, 8, 48)."""
    env, rng = SimpleQuadVectorEnv(8, scenario), np.random.default_rng(0)
    actions = np.clip(
        SIMPLE_QUAD.home_pose + rng.normal(0, 0.15, (200, 8, 12)), SIMPLE_QUAD.joint_lower, SIMPLE_QUAD.joint_upper
    )
    return np.array([env.reset(seed=3)[0]] + [env.step(action)[0] for action in actions[:steps]])


@pytest.mark.parametrize("scenario", AFTER_25_STEPS)
def test_the_first_steps_are_as_recorded_on_any_machine(scenario: str) -> None:
    np.testing.assert_allclose(rollout(scenario, 25)[25, 2, SHOWN], AFTER_25_STEPS[scenario], rtol=1e-3, atol=1e-4)


@pytest.mark.skipif(HERE != RECORDED_ON, reason=f"bits were recorded on {RECORDED_ON}")
@pytest.mark.parametrize(("scenario", "digest"), RECORDED)
def test_the_bits_are_as_recorded(scenario: str | Scenario, digest: str) -> None:
    assert hashlib.sha256(rollout(scenario).tobytes()).hexdigest()[:16] == digest
