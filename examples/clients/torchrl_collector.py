"""TorchRL with one robot, three in processes, and the native batch under a collector and its PPO loss.

`python examples/clients/torchrl_collector.py`
"""

import gymnasium as gym
import torch
import tyro
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.envs import GymEnv, GymWrapper
from torchrl.envs.utils import check_env_specs
from torchrl.modules import MLP, NormalParamExtractor, ProbabilisticActor, TanhNormal, ValueOperator
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

ENV_ID = "quad_env:SimpleQuad-v0"


def main(frames: int = 512) -> None:
    """Step each environment, and train a policy on rollouts of the batch.

    Args:
        frames: Steps of all robots together.
    """
    torch.set_num_threads(1)
    robots = gym.make_vec(ENV_ID, num_envs=8, autoreset_mode="DISABLED", max_episode_steps=50)
    one, batch = (env.auto_register_info_dict() for env in (GymEnv(ENV_ID), GymWrapper(robots)))
    for env in (one, GymEnv(ENV_ID, num_envs=3), batch):
        check_env_specs(env)
        print(f"{env.batch_size}: {env.rollout(20)['next', 'reward'].mean():.5f} a step")
    space = batch.action_spec.space
    net = nn.Sequential(MLP(48, 24, num_cells=[64]), NormalParamExtractor())
    limits = {"low": space.low[0], "high": space.high[0]}
    module = TensorDictModule(net, ["observation"], ["loc", "scale"])
    actor = ProbabilisticActor(
        module,
        in_keys=["loc", "scale"],
        distribution_class=TanhNormal,
        distribution_kwargs=limits,
        return_log_prob=True,
    )
    critic = ValueOperator(MLP(48, 1, num_cells=[64]), in_keys=["observation"])
    loss = ClipPPOLoss(actor, critic)
    adam = torch.optim.Adam([*actor.parameters(), *critic.parameters()], lr=3e-4)
    for data in Collector(batch, actor, frames_per_batch=frames // 2, total_frames=frames):
        GAE(gamma=0.99, lmbda=0.95, value_network=critic)(data)
        losses = loss(data)
        total = sum(losses[key] for key in ("loss_objective", "loss_critic", "loss_entropy"))
        adam.zero_grad()
        total.backward()
        adam.step()
        print(f"{data.numel()} frames, reward {data['next', 'reward'].mean():.5f} a step, loss {float(total):.4f}")


if __name__ == "__main__":
    tyro.cli(main)
