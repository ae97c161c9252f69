"""An episode filmed by Gymnasium's RecordVideo: `python examples/record_video.py --policy trot --scenario rough:2`.

Wants `pip install moviepy`. `python -m evaluate replay` films an episode of an evaluation without it.
"""

import gymnasium as gym
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
    observation, info = env.reset(seed=seed, options={"command": (0.5, 0.0, 0.0)})
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(walker.act(observation))
        ended = terminated or truncated
    env.close()
    forward, lateral, _ = info["heading_velocity"]
    print(f"{out}/{policy}-episode-0.mp4: in the end {forward:.2f} m/s forward, {lateral:.2f} m/s to the left")


if __name__ == "__main__":
    tyro.cli(main)
