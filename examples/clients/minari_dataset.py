"""Offline dataset of Minari: episodes of a policy, with infos: `python examples/clients/minari_dataset.py`.

The dataset goes to a temporary folder; without `MINARI_DATASETS_PATH` it would go to the user's own.
"""

import os
import tempfile

import gymnasium as gym
import minari
import numpy as np
import tyro

import policies
import quad_env


def main(episodes: int = 3, steps: int = 100, scenario: str = "payload=5+slope=8") -> None:
    """Collect a dataset, load it, and make its environment.

    Args:
        episodes: Number of episodes.
        steps: Longest episode, in control steps.
        scenario: Scenario with severities.
    """
    robot = gym.make("quad_env:SimpleQuad-v0", scenario=quad_env.scenario(scenario), max_episode_steps=steps)
    collector = minari.DataCollector(robot, record_infos=True)
    trot = policies.make("trot")
    for seed in range(episodes):
        observation, _ = collector.reset(seed=seed)
        trot.reset()
        has_ended = False
        while not has_ended:
            observation, _, terminated, truncated, _ = collector.step(trot.act(observation))
            has_ended = terminated or truncated
    with tempfile.TemporaryDirectory() as folder:
        os.environ["MINARI_DATASETS_PATH"] = folder
        collector.create_dataset("simple-quad/trot-v0", algorithm_name="trot")
        dataset = minari.load_dataset("simple-quad/trot-v0")
        recovered = dataset.recover_environment()
        first = next(dataset.iterate_episodes())
        np.testing.assert_array_equal(recovered.reset(seed=0)[0], first.observations[0])
        fell = sum(bool(np.any(episode.infos["fall"])) for episode in dataset.iterate_episodes())
        print(
            f"{dataset.total_steps} steps in {dataset.total_episodes} episodes on {scenario}, {fell} fell; made again"
        )


if __name__ == "__main__":
    tyro.cli(main)
