"""A model of Stable-Baselines3, of any algorithm with an actor. Loading one can run code that is hidden in it."""

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np

from policies.base import PolicyError
from policies.external.packages import import_package
from policies.external.python_file import ActFactory
from policies.external.reference import PolicyReference
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot


def load_sb3(reference: PolicyReference, robot: Robot) -> ActFactory:
    """Gives the model's deterministic action for one observation, as joint targets of the robot, rad.

    Raises PolicyError, one line, for what is no model, and for actions whose meaning the file does not give.
    """
    torch, files = import_package("torch", "train"), import_package("stable_baselines3.common.save_util", "train")
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
        raise PolicyError(f"{reference} is no model of Stable-Baselines3 ({format_exception(error)})") from error
    policy.set_training_mode(False)
    targets = _meaning(data["action_space"], reference, robot)
    normalised = _normaliser(reference, data["observation_space"])

    def act(observation: Any) -> object:
        return targets(policy.predict(normalised(observation), deterministic=True)[0])

    return lambda: act


def _normaliser(reference: PolicyReference, space: Any) -> Callable[[Any], Any]:
    """From observations to those that the model was trained on; raises PolicyError."""
    if reference.normaliser is None:
        return _as_they_are
    try:
        found = pickle.loads(reference.normaliser.read_bytes())
        normalised: Callable[[Any], Any] = found.normalize_obs
        shape = normalised(np.zeros(space.shape, np.float32)).shape
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        raise PolicyError(f"{reference.normaliser} is no VecNormalize of {reference.file.name} ({reason})") from error
    if shape != space.shape:
        raise PolicyError(f"{reference.normaliser} is of observations {shape}, and {reference.file} of {space.shape}")
    return normalised


def _meaning(space: Any, reference: PolicyReference, robot: Robot) -> Callable[[Any], Any]:
    """From a model's actions to joint targets."""
    # Here, so that commands that print their help do not wait for Gymnasium.
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
    return _as_they_are


def _as_they_are(values: Any) -> Any:
    return values
