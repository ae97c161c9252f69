"""Checkpoints of a training run between two rollouts: arrays as safetensors, all other values as JSON.

The learner, the schedules and the random generators are restored exactly. The states of the robots are not saved. A run
is divided into segments; all robots start new episodes at the start of a segment, see `segment_steps`. A checkpoint has
the actions of the robots since the start of the present segment. A resumed run repeats these actions.

A checkpoint has two files. STEPS.safetensors is written first, then STEPS.json with the hash of the first file. A
checkpoint without STEPS.json is ignored, so that the previous checkpoint remains valid if a run is killed. The last two
checkpoints are kept.
"""

import hashlib
import json
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors
from stable_baselines3 import PPO

from quad_env.cli.command_line import UsageError
from quad_env.files.reading import MAX_DATA_SIZE, read_bytes
from quad_env.files.writing import write_atomically
from train.sb3.vec_env import TrainingVecEnv

SCHEMA = 2
"""Version of the file format of checkpoints."""
KEPT_CHECKPOINTS = 2
"""Number of checkpoints that are kept in the folder of a run; `save` removes older ones."""
_POLICY = "policy."
_OPTIMISER = "optimiser."
_ACTIONS = "robots.actions"
_REFERENCE = "reference."


@dataclass(frozen=True)
class Checkpoint:
    """Checkpoint: state of a training run between two rollouts, made by `capture` or read from a folder by `load`."""

    tensors: dict[str, torch.Tensor]
    """Name -> array: network weights, optimiser moments, states of random generators, and actions of the robots.

    The prefix of a name shows its kind, for example "policy." for network weights."""
    progress: dict[str, Any]
    """Name -> value of JSON types: number of steps and updates, states of random generators, callback state.

    The callback state has the key "remembered"."""
    damaged: tuple[str, ...] = ()
    """Error messages, one line each, of newer checkpoints in the same folder that could not be read."""

    @property
    def actions(self) -> list[NDArray[np.float32]]:
        """Actions of all n robots since they last started new episodes together, (n, 12) per learner step.

        A resumed run repeats these actions, because a checkpoint does not contain the states of the robots. The list is
        empty if all robots start new episodes after the checkpoint.
        """
        return list(self.tensors[_ACTIONS].numpy()) if _ACTIONS in self.tensors else []


def capture(model: PPO, remembered: dict[str, Any], actions: Sequence[NDArray[np.float32]] = ()) -> Checkpoint:
    """Make a checkpoint of a training run, between the update after one rollout and the start of the next one.

    Args:
        model: PPO learner.
        remembered: State of the training callback, as a dictionary of JSON types, see `CallbackState`.
        actions: Actions of all n robots since they last started new episodes together, one array, (n, 12), per learner
            step.

    Returns:
        The checkpoint, with copies of all arrays.
    """
    tensors = {_POLICY + name: value for name, value in model.policy.state_dict().items()}
    tensors |= optimiser_tensors(model.policy.optimizer)
    numpy_state = np.random.get_state(legacy=False)["state"]  # noqa: NPY002 - SB3 shuffles with the global generator
    key = torch.from_numpy(numpy_state["key"].astype(np.int64))
    tensors |= {"random.torch": torch.get_rng_state(), "random.numpy": key}
    progress: dict[str, Any] = {"steps": model.num_timesteps, "updates": model._n_updates, "remembered": remembered}
    progress |= {"python_random": random.getstate(), "numpy_random_position": int(numpy_state["pos"])}
    if actions:
        tensors[_ACTIONS] = torch.from_numpy(np.stack(actions))
    return Checkpoint(copies(tensors), progress)


def restore(model: PPO, checkpoint: Checkpoint) -> None:
    """Restore the learner and all random generators from a checkpoint.

    Args:
        model: PPO learner, which is changed.
        checkpoint: Checkpoint of a learner with the same settings.

    Raises:
        UsageError: The checkpoint does not fit the learner.
    """
    tensors, progress = checkpoint.tensors, checkpoint.progress
    try:
        model.policy.load_state_dict(with_prefix(tensors, _POLICY))
        restore_optimiser(model.policy.optimizer, tensors)
        model.num_timesteps = int(progress["steps"])
        model._n_updates = int(progress["updates"])
        version, words, gauss = progress["python_random"]
        random.setstate((version, tuple(words), gauss))
        key = tensors["random.numpy"].numpy().astype(np.uint32)
        np.random.set_state(("MT19937", key, int(progress["numpy_random_position"]), 0, 0.0))  # noqa: NPY002
        torch.set_rng_state(tensors["random.torch"])
    except (KeyError, RuntimeError, TypeError, ValueError) as error:
        raise UsageError(f"the checkpoint does not fit this run: {str(error).splitlines()[0]}") from None


def load_networks(model: PPO, folder: Path) -> bool:
    """Load actor, critic and exploration noise from the newest checkpoint of another run into a new learner.

    Args:
        model: PPO learner, which is changed.
        folder: Folder of the checkpoints of the other run.

    Returns:
        True if the networks were loaded; False if the run was a distillation, which has no value network.

    Raises:
        UsageError: The networks in the checkpoint have another shape, or the folder has no checkpoint.
    """
    weights = with_prefix(load(folder).tensors, _POLICY)
    if not weights:
        return False
    own = model.policy.state_dict()
    weights = {name: value for name, value in weights.items() if not name.startswith(_REFERENCE)}
    weights |= {name: value for name, value in own.items() if name.startswith(_REFERENCE)}
    _fit_scenarios(weights, model)
    try:
        model.policy.load_state_dict(weights)
    except RuntimeError as error:
        shapes = " ".join(str(error).split("\n\t")[-1].split())
        raise UsageError(f"--start: the networks in {folder.parent} are of another shape ({shapes})") from None
    return True


def _fit_scenarios(weights: dict[str, torch.Tensor], model: PPO) -> None:
    """Change the first layer of the critic in `weights` to the number of scenarios of the learner `model`.

    The input of the critic has one entry for each scenario, see `MultiScenarioVectorEnv`. A scenario of the new run has
    the mean weights of the scenarios of the other run.
    """
    env = cast(TrainingVecEnv, model.get_env())
    first = model.policy.features_dim - env.privileged
    for name, own in model.policy.mlp_extractor.value_net.named_parameters(prefix="mlp_extractor.value_net"):
        other = weights.get(name)
        if other is None or own.dim() < 2 or own.shape[1] != model.policy.features_dim:
            continue
        robots: Any = env.env.unwrapped
        count = len(robots.batches)
        end = first + count + other.shape[1] - own.shape[1]
        if end > first:
            mean = other[:, first:end].mean(dim=1, keepdim=True)
            weights[name] = torch.cat((other[:, :first], mean.expand(-1, count), other[:, end:]), dim=1)
        return


def with_prefix(tensors: dict[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    """Return the tensors, name -> array, with names that start with `prefix`; the prefix is removed from the names."""
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def copies(tensors: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Return contiguous copies of `tensors`, name -> array, that later training steps do not change."""
    return {name: value.detach().clone().contiguous() for name, value in tensors.items()}


def optimiser_tensors(optimiser: torch.optim.Optimizer) -> dict[str, torch.Tensor]:
    """Return the moments of an optimiser (running averages of the gradients), name in a checkpoint -> array.

    The name is `optimiser.INDEX.NAME` for the moment NAME of the parameter with the index INDEX.
    """
    return {
        f"{_OPTIMISER}{index}.{name}": torch.as_tensor(value)
        for index, moments in optimiser.state_dict()["state"].items()
        for name, value in moments.items()
    }


def restore_optimiser(optimiser: torch.optim.Optimizer, tensors: dict[str, torch.Tensor]) -> None:
    """Restore the moments (running averages of the gradients) of an optimiser from the arrays of a checkpoint.

    Args:
        optimiser: Optimiser, which is changed.
        tensors: Arrays of a checkpoint, name -> array. The names of the moments are as in `optimiser_tensors`.
    """
    state: dict[int, dict[str, torch.Tensor]] = {}
    for name, value in with_prefix(tensors, _OPTIMISER).items():
        index, moment = name.split(".")
        state.setdefault(int(index), {})[moment] = value
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})


def save(folder: Path, checkpoint: Checkpoint) -> None:
    """Write a `checkpoint` to `folder`, and remove all checkpoints but the latest `KEPT_CHECKPOINTS`."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = f"{checkpoint.progress['steps']:012d}"
    tensors = save_tensors(checkpoint.tensors)
    write_atomically(folder / f"{stem}.safetensors", tensors)
    record = {"schema": SCHEMA, "sha256": hashlib.sha256(tensors).hexdigest(), **checkpoint.progress}
    write_atomically(folder / f"{stem}.json", json.dumps(record).encode())
    for record_path in sorted(folder.glob("*.json"))[:-KEPT_CHECKPOINTS]:
        record_path.unlink()
        record_path.with_suffix(".safetensors").unlink(missing_ok=True)


def load(folder: Path) -> Checkpoint:
    """Load the newest complete checkpoint in a folder.

    Args:
        folder: Folder of the checkpoints of a run.

    Returns:
        The checkpoint. Its field `damaged` lists newer checkpoints that could not be read.

    Raises:
        UsageError: The folder has no complete checkpoint.
    """
    problems = list[str]()
    for record_path in sorted(folder.glob("*.json"), reverse=True):
        try:
            return replace(_read(record_path), damaged=tuple(problems))
        except UsageError as error:
            problems.append(str(error))
    if problems:
        raise UsageError(f"no complete checkpoint in {folder} ({problems[0]}); start again with another --out")
    raise UsageError(f"no checkpoint in {folder} to continue from: start again without --resume")


def _read(record_path: Path) -> Checkpoint:
    try:
        record = json.loads(read_bytes(record_path))
        content = read_bytes(record_path.with_suffix(".safetensors"), MAX_DATA_SIZE)
        if (record.pop("schema"), record.pop("sha256")) != (SCHEMA, hashlib.sha256(content).hexdigest()):
            raise ValueError(f"not whole, or not of schema {SCHEMA}")
        if type(record["steps"]) is int and isinstance(record["remembered"], dict):
            return Checkpoint(load_tensors(content), record)
        raise ValueError("without its number of steps")
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, SafetensorError) as error:
        raise UsageError(f"{record_path.name} cannot be read: {error}") from None
