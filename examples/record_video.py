"""Episode filmed by Gymnasium's RecordVideo: `python examples/record_video.py --policy trot --scenario rough=0.2`.

Needs `pip install moviepy`. `python -m evaluate replay` films an episode of an evaluation without it.
"""

import gymnasium as gym
import numpy as np
import tyro
from gymnasium.wrappers import RecordVideo

import policies
import quad_env


def main(
    policy: str = "trot", scenario: str = "rough", out: str = "results/films", steps: int = 300, seed: int = 0
) -> None:
    """Film one episode with a commanded forward velocity of 0.5 m/s.

    Args:
        policy: Name of the policy.
        scenario: Name of the scenario, also with a level or severity.
        out: Folder of the film.
        steps: Longest episode, in control steps.
        seed: Seed of the episode.
    """
    robot = gym.make(
        quad_env.ENV_ID, scenario=quad_env.scenario(scenario), render_mode="rgb_array", max_episode_steps=steps
    )
    env = RecordVideo(robot, out, name_prefix=policy, episode_trigger=lambda episode: episode == 0)
    walker = policies.make(policy)
    observation, _ = env.reset(seed=seed, options={"command": (0.5, 0.0, 0.0)})
    forward_velocities: list[float] = []
    has_ended = False
    while not has_ended:
        observation, _, terminated, truncated, info = env.step(walker.act(observation))
        forward_velocities.append(info["heading_velocity"][0])
        has_ended = terminated or truncated
    env.close()
    duration = len(forward_velocities) / 100
    print(f"{out}/{policy}-episode-0.mp4: {np.mean(forward_velocities):.2f} m/s forward, in {duration:.2f} s")


if __name__ == "__main__":
    tyro.cli(main)
