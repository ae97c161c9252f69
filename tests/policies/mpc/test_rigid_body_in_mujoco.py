"""The rigid body of the predictive controllers moves as MuJoCo's robot does."""

import gymnasium as gym
import mujoco
import numpy as np

from policies.mpc.motion import motion
from policies.mpc.policy import MpcWbc
from policies.mpc.rigid_body import Body, Horizon, Weights
from quad_env.envs.env import SimpleQuadEnv
from quad_env.physics.dynamics import Dynamics
from research.studies.prediction import WholeBody, turned_back, whole_body


def now(env: SimpleQuadEnv) -> WholeBody:
    return whole_body(env.robot, env.simulation.model, env.simulation.snapshot(0))


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
