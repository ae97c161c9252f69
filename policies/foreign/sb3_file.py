"""A model of Stable-Baselines3, of any algorithm with an actor. Loading one can run code that is hidden in it."""

from importlib import import_module
from typing import Any

from policies.base import PolicyError
from policies.foreign.python_file import Maker
from policies.foreign.reference import Reference


def load(reference: Reference) -> Maker:
    """Gives the model's deterministic action for one observation."""
    # By name: judging imports no learner, except where it is asked to judge a learner's own file.
    torch: Any = import_module("torch")
    files: Any = import_module("stable_baselines3.common.save_util")
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
        raise PolicyError(f"{reference} is no model of Stable-Baselines3 ({type(error).__name__}: {error})") from error
    policy.set_training_mode(False)

    def act(observation: Any) -> object:
        return policy.predict(observation, deterministic=True)[0]

    return lambda: act
