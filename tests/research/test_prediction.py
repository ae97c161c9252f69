"""What is foreseen is compared with what MuJoCo has, in the frame and at the moment that it is meant for."""

from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from evaluate.__main__ import main
from policies.mpc.motion import motion
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import MpcWbc
from policies.mpc.rigid_body import Body, Horizon, Weights
from quad_env.config import GRAVITY
from quad_env.envs.env import SimpleQuadEnv
from quad_env.physics.dynamics import Dynamics, WholeBody, whole_body
from quad_env.seeding import episode_seeds
from research.studies import prediction
from research.studies.prediction import Walk, errors, turned_back, walk

PERIODS = 0.04, 0.01


@pytest.fixture(scope="module")
def walked() -> Walk:
    """By parameters that no search changes: what is tested are the forecasts."""
    seeds = episode_seeds("validation", 3, 2)
    return walk(MpcWbc(MpcParameters()), "flat", seeds, command=(0.5, 0.0, 0.6), steps=300)


def now(env: SimpleQuadEnv) -> WholeBody:
    return whole_body(env.robot, env.simulation.model, env.simulation.snapshot(0))


def test_a_standing_robot_s_feet_bear_its_weight() -> None:
    env = gym.make("quad_env:SimpleQuad-v0", scenario="flat").unwrapped
    env.reset(seed=0)
    for _ in range(100):
        env.step(env.robot.home_pose.astype(np.float32))
    centre, velocity, rotation, turning, forces = now(env)
    np.testing.assert_allclose(forces.sum(axis=0), (0.0, 0.0, env.robot.mass * GRAVITY), atol=1.0)
    assert (forces[:, 2] > 10.0).all()
    assert np.abs(np.concatenate((velocity, turning))).max() < 0.01
    assert rotation[2, 2] > 0.99
    assert 0.2 < centre[2] < env.robot.home_height


def test_the_rigid_body_s_next_step_is_mujoco_s() -> None:
    """With MuJoCo's own contact forces: velocity within 2e-4 m/s, turning within 0.05 rad/s; the legs turn as well."""
    env = gym.make("quad_env:SimpleQuad-v0", scenario="flat").unwrapped
    observation, _ = env.reset(seed=3, options={"command": (0.5, 0.0, 0.3)})
    policy, dynamics, missed, changed = MpcWbc(), Dynamics(env.robot), [], []
    policy.reset()
    model = env.simulation.model
    one = Horizon(1, model.opt.timestep, Weights(np.ones(3), np.ones(3), np.ones(3), np.ones(3), 1.0))
    trunk = model.body("base_link").id
    joint = model.body_dofadr[trunk]
    for step in range(200):
        observation, *_ = env.step(policy.act(observation))
        if step < 100 or step % 7:
            continue
        centre, velocity, rotation, turning, forces = now(env)
        heading, data = turned_back(rotation), env.simulation.snapshot(0)
        feet = np.array([data.geom(f"{leg}_foot").xpos for leg in env.robot.leg_names])
        start = Body(
            angles=np.zeros((1, 3)),
            position=np.zeros((1, 3)),
            turning=(heading @ turning)[None],
            velocity=(heading @ velocity)[None],
            mass=np.array([env.robot.mass]),
            inertia=motion(env.robot, dynamics, observation[None]).bodies.rotational_inertia,
            acceleration=np.zeros((1, 6)),
        )
        arms, pushes = ((each @ heading.T)[None, None] for each in (feet - centre, forces))
        path = one.predicted(start, arms, pushes)
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        then = heading @ data.subtree_linvel[trunk]
        turned = heading @ data.xmat[trunk].reshape(3, 3) @ data.qvel[joint + 3 : joint + 6]
        missed.append((*(path.velocity[0, 0] - then), *(path.turning[0, 0] - turned)))
        changed.append((*(start.velocity[0] - then), *(start.turning[0] - turned)))
    missed, changed = np.abs(missed), np.abs(changed)
    assert missed[:, :3].max() < 2e-4
    assert changed[:, :3].max() > 1e-2
    assert missed[:, 3:].max() < 0.05
    assert (missed[:, 3:] ** 2).mean() < 0.5 * (changed[:, 3:] ** 2).mean()


def test_a_forecast_errs_less_than_going_on_as_it_is(walked: Walk) -> None:
    for steps in (1, 5):
        height, horizontal, upward, tilt = errors(walked, steps, *PERIODS)
        same = errors(walked, steps, *PERIODS, still=True)
        assert (horizontal, tilt) < (same[1], same[3])
        assert height < 10.0
        assert horizontal < 0.2
        assert upward < 0.15
        assert tilt < 2.0


@pytest.mark.parametrize("fault", ["a step late", "not turned"])
def test_forecasts_of_another_moment_or_in_another_frame_err_more(
    walked: Walk, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = errors(walked, 1, *PERIODS)
    if fault == "not turned":
        monkeypatch.setattr(prediction, "turned_back", lambda rotation: np.broadcast_to(np.eye(3), rotation.shape))
        assert errors(walked, 1, *PERIODS)[1] > 2.0 * right[1]
    else:
        late = Walk(walked.measured, *(np.roll(each, 2, axis=0) for each in walked[1:6]), walked.fall_step)
        wrong = errors(late, 1, *PERIODS)
        assert wrong[3] > right[3]
        assert wrong[1] > right[1]


def test_the_command_draws_a_stride_and_writes_its_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prediction, "GROUNDS", ("flat",))
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- prediction -->\n<!-- /prediction -->\nafter\n", encoding="utf-8")
    words = ["--episodes", "1", "--start", "100", "--out", str(tmp_path / "p.png"), "--page", str(page)]
    assert main(["prediction", *words]) == 0
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    text = page.read_text(encoding="utf-8")
    assert "| flat | 0.40 |" in text
    assert text.startswith("before")
    assert text.endswith("after\n")


@pytest.mark.parametrize("words", [["--out", "a.svg"], ["--start", "10"], ["--page", "nowhere.md"]])
def test_what_cannot_be_done_is_one_line(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prediction", *words]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
