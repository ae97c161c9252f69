"""PPO of RLlib on the native batch, which `gym.make_vec` makes: `python examples/clients/rllib_ppo.py`."""

import ray
import tyro
from ray.rllib.algorithms.ppo import PPOConfig


def main(iterations: int = 2, robots: int = 8) -> None:
    """Train in this process; RLlib itself rescales actions from [-1, 1] to the joint limits.

    Args:
        iterations: Updates of the policy.
        robots: Number of robots.
    """
    ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False)
    config = (
        PPOConfig()
        .environment("quad_env:SimpleQuad-v0", env_config={"max_episode_steps": 50})
        .env_runners(num_env_runners=0, num_envs_per_env_runner=robots, gym_env_vectorize_mode="vector_entry_point")
        .training(train_batch_size_per_learner=robots * 64, minibatch_size=128, num_epochs=1)
    )
    learner = config.build_algo()
    for _ in range(iterations):
        result = learner.train()["env_runners"]
        print(f"{result['num_env_steps_sampled_lifetime']} steps, an episode earns {result['episode_return_mean']:.3f}")
    print(f"on {type(learner.env_runner.env.unwrapped).__name__}")
    learner.stop()
    ray.shutdown()


if __name__ == "__main__":
    tyro.cli(main)
