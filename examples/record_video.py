"""An episode filmed by Gymnasium's RecordVideo: `python examples/record_video.py --policy trot --scenario rough=0.2`.

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
    """Film one episode of a policy that goes forward at 0.5 m/s."""
    robot = gym.make(
        quad_env.ENV_ID, scenario=quad_env.scenario(scenario), render_mode="rgb_array", max_episode_steps=steps
    )
    env = RecordVideo(robot, out, name_prefix=policy, episode_trigger=lambda episode: episode == 0)
    walker = policies.make(policy)
    observation, _ = env.reset(seed=seed, options={"command": (0.5, 0.0, 0.0)})
    forward: list[float] = []
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(walker.act(observation))
        forward.append(info["heading_velocity"][0])
        ended = terminated or truncated
    env.close()
    print(f"{out}/{policy}-episode-0.mp4: {np.mean(forward):.2f} m/s forward, in {len(forward) / 100:.2f} s")


if __name__ == "__main__":
    tyro.cli(main)
