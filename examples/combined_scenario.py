"""Trot on a scenario of several disturbances: `python examples/combined_scenario.py`.

`python -m evaluate --policies trot residual --scenarios examples/combined_scenario.py:hillside` evaluates them on it.
The option also takes `payload=5+slope=8+latency=0.02`, which needs no file.
"""

import gymnasium as gym
import numpy as np
import tyro

import policies
import quad_env

hillside = quad_env.Scenario(
    "hillside",
    terrain=quad_env.Slope(np.radians(8.0)),
    ground=quad_env.Ground(friction=0.6),
    payload=quad_env.Payload(5.0),
    latency=quad_env.Latency(0.02),
    pushes=quad_env.Pushes(count=2, impulse=15.0),
)


def main(policy: str = "trot", robots: int = 32, seconds: float = 10.0) -> None:
    """Walk forward on flat ground and on the hillside, and print the mean velocity and the falls.

    Args:
        policy: Name of the policy.
        robots: Number of robots.
        seconds: Duration (s).
    """
    walker = policies.make(policy)
    steps = round(seconds * 100)
    for scenario in ("flat", hillside):
        vec = gym.make_vec(quad_env.ENV_ID, num_envs=robots, scenario=scenario, max_episode_steps=None)
        observation, _ = vec.reset(seed=0, options={"command": (0.5, 0.0, 0.0)})
        walker.reset(num_envs=robots)
        fell = np.zeros(robots, bool)
        forward_velocities = []
        for _ in range(steps):
            observation, _, terminated, _, info = vec.step(walker.act(observation))
            fell |= terminated
            forward_velocities.append(info["heading_velocity"][~fell, 0])
        name = getattr(scenario, "name", scenario)
        print(f"{name}: {np.concatenate(forward_velocities).mean():.2f} m/s of 0.50 m/s, {fell.sum()} of {robots} fell")


if __name__ == "__main__":
    tyro.cli(main)
