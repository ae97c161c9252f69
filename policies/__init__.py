"""Controllers (policies) of quadruped robots; they compute joint targets from observations.

A policy controls a batch of n robots. Make the policy for an environment, and call it at every control step:

    policy = policies.make("trot", robot=env.robot, control_period=env.dt)
    policy.reset(num_envs=n)
    action = policy.act(observation)  # observation, (n, k) -> joint targets, (n, 12), rad
"""

from policies.base import Policy, PolicyError
from policies.behaviour import Behaviour
from policies.bundle import load
from policies.external import ExternalPolicy, is_reference, unsupported_file_remedy
from policies.poses import Stand
from policies.registry import SAFE, TRAINED, is_missing, make, names, resolve, summary, trained_names
from policies.residual import ResidualPolicy
from policies.safety import Safe
from policies.trot.open_loop import Trot

Foreign = ExternalPolicy
"""Deprecated name of `ExternalPolicy`, the class of policies from files that a user provides."""
unsupported = unsupported_file_remedy
"""Deprecated name of the function `unsupported_file_remedy`."""

__all__ = [
    "SAFE",
    "TRAINED",
    "Behaviour",
    "ExternalPolicy",
    "Foreign",
    "Policy",
    "PolicyError",
    "ResidualPolicy",
    "Safe",
    "Stand",
    "Trot",
    "is_missing",
    "is_reference",
    "load",
    "make",
    "names",
    "resolve",
    "summary",
    "trained_names",
    "unsupported",
    "unsupported_file_remedy",
]
