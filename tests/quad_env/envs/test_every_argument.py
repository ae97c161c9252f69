"""Every argument of the environments affects the simulated robots.

`ARGUMENTS`, `ALONE` and `BATCHED` have an entry for each argument; an argument without an entry fails. An entry changes
one value and reads the model, the motion, the observation or the infos. It does this for the second robot of a batch
and for a single robot.
"""

import inspect
from pathlib import Path

import numpy as np
import pytest

from quad_env import OBSERVATION_SIZE, TaskConfig
from quad_env.envs.base import EnvKwargs
from quad_env.envs.env import SimpleQuadEnv
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.task.observations import ObservationTerm
from tests.quad_env.envs.effects.episode import FALLS, fallen
from tests.quad_env.envs.effects.motors import largest_torque, servo_gains
from tests.quad_env.envs.effects.robot import DT, FAR, HOME, SCAN, Effect, after, scene
from tests.quad_env.envs.effects.sensors import made_out, scan, seen_from_the_side
from tests.quad_env.robots.alike import alike

ARGUMENTS = {
    "scenario": Effect("weak_motors=8", after(largest_torque, FAR), 8.0),
    "terminate_on_fall": Effect(False, after(fallen), [2, 0], {"config": FALLS}),
    "config": Effect(TaskConfig(control_rate=50.0), after(lambda robot: robot.now.time), 0.02),
    "actuator": Effect("motor", lambda robot: robot.base.simulation.winding_temperature is not None, True),
    "sensors": Effect("ideal", lambda robot: robot.infos.get("sensor_joint_position"), HOME, scene()),
    "robot": Effect(alike, lambda robot: robot.model.body_mass.sum(), 0.1 * SIMPLE_QUAD.mass),
    "servo": Effect((60.0, 2.0), after(servo_gains, FAR), np.tile((60.0, 2.0), (12, 1))),
    "estimator": Effect("kalman", after(made_out, steps=20), True, {"sensors": "typical"}),
    "height_scan": Effect(SCAN, lambda robot: scan(robot) + robot.now.qpos[2], np.zeros(6)),
    "max_episode_steps": Effect(
        3, lambda robot: [after(lambda robot: robot.own(robot.cut))(robot) for _ in range(3)], [False, False, True]
    ),
    "render_mode": Effect("rgb_array", lambda robot: robot.base.render_mode == "rgb_array", True),
    "rewards": Effect(
        {"unit": (lambda state: 0.0 * state.height + 1.0, 3.0)},
        after(lambda robot: robot.infos.get("reward_unit")),
        3.0 * DT,
    ),
    "observations": Effect(
        (ObservationTerm("trunk_height", 1, "m", 2.0, 1.0, lambda state: state.height),),
        lambda robot: [len(robot.seen), robot.seen[-1] == np.float32(robot.now.qpos[2])],
        [OBSERVATION_SIZE + 1, True],
    ),
}
ALONE = {
    "width": Effect(64, lambda robot: robot.env.render().shape[:2], (9, 64), {"render_mode": "rgb_array", "height": 9}),
    "height": Effect(48, lambda robot: robot.env.render().shape[:2], (48, 9), {"render_mode": "rgb_array", "width": 9}),
    "camera": Effect("side", seen_from_the_side, True, {"render_mode": "rgb_array", "width": 64, "height": 48}),
}
BATCHED = {
    "num_envs": Effect(3, lambda robot: len(robot.base.simulation.quaternion), 3),
    "nthread": Effect(3, lambda robot: robot.base.simulation.batch.nthread, 3, {"num_envs": 4}),
    "autoreset_mode": Effect(
        "SAME_STEP", after(lambda robot: "final_obs" in robot.infos), True, {"max_episode_steps": 1}
    ),
    "readings": Effect(True, lambda robot: robot.infos.get("joint_position"), HOME, scene()),
}


def test_every_argument_has_an_effect_that_is_tested() -> None:
    for kind, own in ((SimpleQuadEnv, ALONE), (SimpleQuadVectorEnv, BATCHED)):
        of_test_drake = "simulator"
        given = {*inspect.signature(kind).parameters, *EnvKwargs.__annotations__, "max_episode_steps"} - {"parts"}
        assert given == {*ARGUMENTS, *own, of_test_drake}


@pytest.mark.parametrize(
    ("name", "alone"),
    [
        pytest.param(name, alone, marks=[pytest.mark.rendering] if name in ALONE else [])
        for alone, own in ((True, ALONE), (False, BATCHED))
        for name in (*ARGUMENTS, *own)
    ],
)
def test_an_argument_reaches_what_it_governs(name: str, alone: bool, tmp_path: Path) -> None:
    effect = {**ARGUMENTS, **ALONE, **BATCHED}[name]
    changed = {name: effect.value(tmp_path) if name == "robot" else effect.value}
    effect.check(effect.of(alone, {}), effect.of(alone, changed))
