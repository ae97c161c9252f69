"""Checkpoints of a run at a rollout boundary: safetensors for arrays, JSON for the rest, no pickle anywhere.

Learner, schedules and random generators are restored exactly. The robots start new episodes at a checkpoint, or the
checkpoint holds their actions since the start, which are repeated. A checkpoint is two files, STEPS.safetensors and
then STEPS.json with the hash of the first. It exists once the second does, so that a run killed at any moment leaves
the one before complete. The last two are kept.
"""

import hashlib
import json
import random
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

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

SCHEMA = 2
"""Version of the format."""
KEPT_CHECKPOINTS = 2
"""Number of checkpoints that a folder keeps."""
_POLICY = "policy."
_OPTIMISER = "optimiser."
_ACTIONS = "robots.actions"


@dataclass(frozen=True)
class Checkpoint:
    """State of a run between two rollouts.

    `capture` makes one from a learner, and `load` reads one from a folder.
    """

    tensors: dict[str, torch.Tensor]
    """Weights, optimiser moments and random states, each under its prefix."""
    progress: dict[str, Any]
    """JSON types: counters, random states, and under "remembered" the state of the callback."""
    damaged: tuple[str, ...] = ()
    """Newer checkpoints that could not be read, one line each."""

    @property
    def actions(self) -> list[NDArray[np.float32]]:
        """Actions of the robots since their start, each (n, k); empty at a start."""
        return list(self.tensors[_ACTIONS].numpy()) if _ACTIONS in self.tensors else []


def capture(model: PPO, remembered: dict[str, Any], actions: Sequence[NDArray[np.float32]] = ()) -> Checkpoint:
    """Capture the state of a run; call it between an update and a rollout.

    Args:
        model: Learner.
        remembered: State of the callback, JSON types.
        actions: Actions of the robots since their start, each (n, k).

    Returns:
        The state.
    """
    tensors = {_POLICY + name: value for name, value in model.policy.state_dict().items()}
    for index, moments in model.policy.optimizer.state_dict()["state"].items():
        tensors |= {f"{_OPTIMISER}{index}.{name}": torch.as_tensor(value) for name, value in moments.items()}
    numpy_state = np.random.get_state(legacy=False)["state"]  # noqa: NPY002 - SB3 shuffles with the global generator
    key = torch.from_numpy(numpy_state["key"].astype(np.int64))
    tensors |= {"random.torch": torch.get_rng_state(), "random.numpy": key}
    progress: dict[str, Any] = {"steps": model.num_timesteps, "updates": model._n_updates, "remembered": remembered}
    progress |= {"python_random": random.getstate(), "numpy_random_position": int(numpy_state["pos"])}
    if actions:
        tensors[_ACTIONS] = torch.from_numpy(np.stack(actions))
    return Checkpoint({name: value.detach().clone().contiguous() for name, value in tensors.items()}, progress)


def restore(model: PPO, checkpoint: Checkpoint) -> None:
    """Set the learner and all random generators to a checkpoint.

    Args:
        model: Learner.
        checkpoint: State.

    Raises:
        UsageError: It is of another learner.
    """
    tensors, progress = checkpoint.tensors, checkpoint.progress
    try:
        model.policy.load_state_dict(_with_prefix(tensors, _POLICY))
        _restore_optimiser(model.policy.optimizer, _with_prefix(tensors, _OPTIMISER))
        model.num_timesteps = int(progress["steps"])
        model._n_updates = int(progress["updates"])
        version, words, gauss = progress["python_random"]
        random.setstate((version, tuple(words), gauss))
        key = tensors["random.numpy"].numpy().astype(np.uint32)
        np.random.set_state(("MT19937", key, int(progress["numpy_random_position"]), 0, 0.0))  # noqa: NPY002
        torch.set_rng_state(tensors["random.torch"])
    except (KeyError, RuntimeError, TypeError, ValueError) as error:
        raise UsageError(f"the checkpoint does not fit this run: {str(error).splitlines()[0]}") from None


def load_networks(model: PPO, folder: Path) -> None:
    """Load the networks and the noise of the newest checkpoint in a folder into the learner of a new run.

    Args:
        model: Learner.
        folder: Folder of checkpoints.

    Raises:
        UsageError: The networks have another shape, or there is no checkpoint.
    """
    weights = _with_prefix(load(folder).tensors, _POLICY)
    try:
        model.policy.load_state_dict(weights)
    except RuntimeError as error:
        shapes = " ".join(str(error).split("\n\t")[-1].split())
        raise UsageError(f"--start: the networks in {folder.parent} are of another shape ({shapes})") from None


def _with_prefix(tensors: dict[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    """Return the tensors with a prefix in their names, without it."""
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}


def _restore_optimiser(optimiser: torch.optim.Optimizer, moments: dict[str, torch.Tensor]) -> None:
    state: dict[int, dict[str, torch.Tensor]] = {}
    for name, value in moments.items():
        index, moment = name.split(".")
        state.setdefault(int(index), {})[moment] = value
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})


def save(folder: Path, checkpoint: Checkpoint) -> None:
    """Write a `checkpoint` to `folder`, and remove all but the last two."""
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
    """Load the newest complete checkpoint of a folder.

    Args:
        folder: Folder of checkpoints.

    Returns:
        The checkpoint.

    Raises:
        UsageError: There is none.
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
