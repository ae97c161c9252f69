"""Processor time of an action: the time in which a policy computes the joint targets of one robot."""

import time
from collections.abc import Sequence

import gymnasium as gym
import numpy as np

import policies
from evaluate.hardware import HardwareConfig
from policies.base import Actions, Floats, Policy
from quad_env import ENV_ID

STEPS = 200
"""Number of control steps of the walk in which the actions are timed."""
PASSES = 3
"""Number of times that each action is computed; the shortest time of an action counts."""


def action_times(names: Sequence[str], hardware: HardwareConfig, *, trust: bool = False) -> dict[str, float]:
    """Measure the processor time in which each policy computes an action for one robot.

    The policy walks on flat ground. The policies alternate, so that other work on
    the machine lengthens the times of all of them. A policy that runs in a process of its own is left out, because the
    clock of this process does not count its time.

    Args:
        names: Names or paths of the policies.
        hardware: Robot of the policies.
        trust: True to load policies from files that can contain hidden code.

    Returns:
        Name of a policy -> median of its actions, s.
    """
    made = {name: hardware.policy(name, trust) for name in dict.fromkeys(names)}
    timed = {name: policy for name, policy in made.items() if not isinstance(policy, policies.ExternalPolicy)}
    walks = {name: _walk(policy, hardware) for name, policy in timed.items()}
    durations: dict[str, list[Floats]] = {name: [] for name in timed}
    for _ in range(PASSES):
        for name, policy in timed.items():
            durations[name].append(_time_actions(policy, walks[name]))
    return {name: float(np.median(np.min(passes, axis=0))) for name, passes in durations.items()}


def _walk(policy: Policy, hardware: HardwareConfig) -> list[Actions]:
    """Return the observations, each (1, k), of a walk of a policy on flat ground, one for each control step."""
    env = gym.make_vec(ENV_ID, 1, height_scan=policy.height_scan, **hardware.env_kwargs(policy.robot))
    observation, _ = env.reset(seed=0)
    policy.reset(1, seed=0)
    observations = []
    for _ in range(STEPS):
        observations.append(observation.copy())
        observation, *_ = env.step(policy.act(observation))
    env.close()
    return observations


def _time_actions(policy: Policy, observations: Sequence[Actions]) -> Floats:
    """Return the processor time of each action, (steps,), s, for the observations of a walk."""
    policy.reset(1, seed=0)
    durations = np.empty(len(observations))
    for index, observation in enumerate(observations):
        start = time.process_time()
        policy.act(observation)
        durations[index] = time.process_time() - start
    return durations
