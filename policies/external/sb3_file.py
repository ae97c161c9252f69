"""Loader of policies from model files (.zip) of Stable-Baselines3, for all algorithms with an actor.

Loading a model can run code that is hidden in the file.
"""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np

from policies.base import PolicyError
from policies.external.act_function import ActFactory
from policies.external.packages import import_package
from policies.external.reference import PolicyReference
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot


def load_sb3(reference: PolicyReference, robot: Robot) -> ActFactory:
    """Load a model of Stable-Baselines3 as a function from observations to joint targets.

    Args:
        reference: Reference to the model's file, with the file of its observation statistics.
        robot: Robot that the policy moves.

    Returns:
        Function without arguments that returns the policy function. The policy function maps the observation of one
        robot to the joint targets of the deterministic action, rad.

    Raises:
        PolicyError: The file is not a model, or the meaning of its actions is unknown.
    """
    torch = import_package("torch", "train")
    files = import_package("stable_baselines3.common.save_util", "train")
    torch.set_num_threads(1)
    try:
        data, parameters, _ = files.load_from_zip_file(reference.file, device="cpu")
        arguments = dict(data.get("policy_kwargs") or {})
        if data.get("use_sde"):
            arguments["use_sde"] = True
        spaces = data["observation_space"], data["action_space"]
        policy = data["policy_class"](*spaces, lambda _: 0.0, **arguments)
        policy.load_state_dict(parameters["policy"])
    except Exception as error:
        raise PolicyError(f"{reference} is not a model of Stable-Baselines3 ({format_exception(error)})") from error
    policy.set_training_mode(False)
    to_targets = _action_conversion(data["action_space"], reference, robot)
    normalize = _load_normaliser(reference, data["observation_space"])

    def act(observation: Any) -> object:
        return to_targets(policy.predict(normalize(observation), deterministic=True)[0])

    return lambda: act


def _load_normaliser(reference: PolicyReference, space: Any) -> Callable[[Any], Any]:
    """Return the function that normalises an observation with the model's statistics (VecNormalize).

    The function is the identity if the model has no statistics file. Raises PolicyError if the statistics file is
    invalid, or if a normalised observation has another shape than `space`, the model's observation space.
    """
    if reference.normaliser is None:
        return _identity
    try:
        statistics = pickle.loads(reference.normaliser.read_bytes())
        normalize: Callable[[Any], Any] = statistics.normalize_obs
        shape = normalize(np.zeros(space.shape, np.float32)).shape
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise PolicyError(
            f"{reference.normaliser} is not a VecNormalize of {reference.file.name} ({reason})"
        ) from error
    if shape != space.shape:
        raise PolicyError(f"{reference.normaliser} is of observations {shape}, and {reference.file} of {space.shape}")
    return normalize


def _action_conversion(space: Any, reference: PolicyReference, robot: Robot) -> Callable[[Any], Any]:
    """Return the function that converts a model's actions to joint targets, rad.

    `space` is the model's action space. Raises PolicyError if the action space was made for another robot, or if it is
    [-1, 1], because the file then does not state the joint targets that the actions represent.
    """
    # Gymnasium is imported here because commands that only print their help would otherwise wait for its import.
    from gymnasium.spaces import Box

    from quad_env.envs.home_pose import HomePoseSpace

    if isinstance(space, HomePoseSpace):
        if space.robot_name != robot.name:
            raise PolicyError(f"{reference} acts about the home pose of {space.robot_name}, not of {robot.name}")
        return space.targets
    if isinstance(space, Box) and (space.low == -1.0).all() and (space.high == 1.0).all():
        raise PolicyError(
            f"{reference} gives actions from -1 to 1, and the file does not say which joint targets these stand for: "
            "train it in quad_env.HomePoseActions, or turn its actions into rad in a class of a Python file"
        )
    return _identity


def _identity(values: Any) -> Any:
    return values
