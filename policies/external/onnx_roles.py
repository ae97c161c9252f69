"""Roles of an ONNX network's inputs and outputs by name: observation, action, and memory with its update.

Sources: rsl_rl `utils/exporter.py` and Isaac Lab `isaaclab_rl/rsl_rl/exporter.py` (`obs`, `h_in`, `c_in` ->
`actions`, `h_out`, `c_out`); rl_games' exporters (`obs` -> `mu`, `log_std`, `value`, and `states`, `out_state_*`).
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from policies.base import PolicyError

ACTIONS = ("actions", "action"), ("mu", "mean", "action_mean", "actions_mean", "deterministic_actions"), ("output",)
"""Names of the action output; the first group with a match decides."""
OBSERVATIONS = "obs", "observation", "observations", "policy", "input", "features"
"""Names of the observation input, where several inputs are no memory."""
_SIDE = {"in", "out", "input", "output", "prev", "previous", "next", "new", "old", "last", "init", "final", "updated"}
"""Words that distinguish a memory from its update."""
_STEP = re.compile(r"([a-z]+?)_?(?:0|1|n|t)")
"""Pattern of memories such as `h0`, updated by `hn`."""


@dataclass(frozen=True)
class NetworkRoles:
    """Inputs and outputs of a network, as onnxruntime describes them."""

    observation: Any
    action: Any
    memory: tuple[tuple[Any, Any], ...]
    """Each memory input with the output that updates it."""


def find_roles(inputs: Sequence[Any], outputs: Sequence[Any], file: Path) -> NetworkRoles:
    """Return the roles of a network's inputs and outputs.

    Args:
        inputs: Of the network, with `name` and `shape`.
        outputs: Of the network, with `name` and `shape`.
        file: Where it is from, for errors.

    Raises:
        PolicyError: Neither names nor shapes decide.
    """
    if not inputs or not outputs:
        counts = f"{len(inputs)} inputs and {len(outputs)} outputs"
        raise PolicyError(f"{file} has {counts}: it must have one or more of each")
    observation = inputs[0] if len(inputs) == 1 else _observation(inputs, outputs)
    states = [each for each in inputs if each is not observation]
    pairs = {state.name: renewed for state in states if (renewed := _by_name(state, inputs, outputs)) is not None}
    action = _action([each for each in outputs if each not in pairs.values()], file)
    for state in states:
        free = [each for each in outputs if each is not action and each not in pairs.values()]
        if state.name not in pairs:
            pairs[state.name] = _by_shape(state, states, free, file)
    return NetworkRoles(observation, action, tuple((state, pairs[state.name]) for state in states))


def _observation(inputs: Sequence[Any], outputs: Sequence[Any]) -> Any:
    """Return the observation input: by name, or the only one that no output updates, or the first."""
    named = [each for each in inputs if each.name.lower() in OBSERVATIONS]
    if len(named) == 1:
        return named[0]
    alone = [each for each in inputs if _by_name(each, inputs, outputs) is None]
    return alone[0] if len(alone) == 1 else inputs[0]


def _action(outputs: Sequence[Any], file: Path) -> Any:
    """Return the action output."""
    for group in ACTIONS:
        if len(named := [each for each in outputs if each.name.lower() in group]) == 1:
            return named[0]
    of_joints = [each for each in outputs if each.shape and each.shape[-1] == 12]
    candidates = of_joints if len(outputs) > 1 else outputs
    if len(candidates) == 1:
        return candidates[0]
    names = ", ".join(each.name for each in outputs)
    raise PolicyError(f"{file} has the outputs {names}, and none is called actions", "rename the output of the actions")


def _by_name(state: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> Any | None:
    """Return the one output with the memory's name, apart from words such as `in` and `out`."""
    if sum(_stem(each.name) == _stem(state.name) for each in inputs) > 1:
        return None
    found = [each for each in outputs if _stem(each.name) == _stem(state.name) and _may_renew(state, each)]
    return found[0] if len(found) == 1 else None


def _by_shape(state: Any, states: Sequence[Any], free: Sequence[Any], file: Path) -> Any:
    """Return the one output of a memory's shape, where no other memory has that shape."""
    found = [each for each in free if _may_renew(state, each)]
    rivals = [each for each in states if each is not state and _may_renew(each, state)]
    if len(found) == 1 and not rivals:
        return found[0]
    if not found:
        raise PolicyError(f"{file} reads {state.name} besides the observation, and its outputs do not renew it")
    names = ", ".join(each.name for each in found)
    fault = f"{file} reads {state.name} besides the observation, and {names} may renew it"
    stem = _stem(state.name)
    raise PolicyError(fault, f"name the output by the input, such as {stem}_in and {stem}_out")


def _stem(name: str) -> str:
    """Return a name in lower case without the words that distinguish a memory from its update."""
    words = [word for word in re.split(r"[^a-z0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()) if word]
    kept = "_".join(word for word in words if word not in _SIDE) or name.lower()
    return match[1] if (match := _STEP.fullmatch(kept)) and len(match[1]) <= 2 else kept


def _may_renew(state: Any, output: Any) -> bool:
    """Return whether the shapes are equal where both are known."""
    if len(state.shape) != len(output.shape):
        return False
    pairs = zip(state.shape, output.shape, strict=True)
    return all(not isinstance(a, int) or not isinstance(b, int) or a == b for a, b in pairs)
