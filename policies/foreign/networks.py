"""Networks of policies from other projects, ONNX or TorchScript, with or without memory, asked for n robots.

A row of observations gives the same bits alone and in any batch: rows are shown in blocks of one size where, as is
tried when a file is loaded, a row's bits hang neither on its place nor on the other rows; one by one elsewhere.
"""

import copy
import re
import warnings
from collections.abc import Callable
from functools import partial
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Mask, PolicyError
from policies.foreign.description import PolicyDescription
from policies.foreign.onnx_file import TYPES, session_of
from quad_env.columns import Rows
from quad_env.files.text import described

Weights = NDArray[np.float32]
Act = Callable[[Weights], Any]
"""From observations (b, k) to actions (b, 12)."""
BLOCK = 16
"""Rows of a block."""
LONGEST_REASON = 300


class Networks:
    """The network of a description, for n robots.

    Args:
        make: makes what gives actions, without memory of any robot.
        block: how many rows that takes.
        remembers: whether it has a memory: then each robot has one of its own.
    """

    def __init__(self, make: Callable[[], Act], block: int, remembers: bool) -> None:
        self._make, self._block, self.remembers = make, block, remembers
        self._acts = [make()]

    def allocate(self, num_envs: int) -> None:
        """Fresh memories for so many robots."""
        if self.remembers:
            self._acts = [self._make() for _ in range(num_envs)]

    def restart(self, mask: Mask) -> None:
        """Fresh memories for those robots."""
        for robot in np.flatnonzero(mask).tolist() if self.remembers else ():
            self._acts[robot] = self._make()

    def actions(self, observations: Weights, who: Rows) -> NDArray[Any]:
        """Actions (m, 12) of those robots for their observations, (m, k)."""
        if self.remembers:
            pairs = zip(observations, who.tolist(), strict=True)
            return np.concatenate([self._acts[robot](row[None]) for row, robot in pairs])
        act, block, count = self._acts[0], self._block, len(observations)
        rows = np.zeros((-(-count // block) * block, observations.shape[1]), np.float32)
        rows[:count] = observations
        return np.concatenate([act(rows[first : first + block]) for first in range(0, count, block)])[:count]


def load(description: PolicyDescription) -> Networks:
    """The description's network, which has its process to itself. Raises PolicyError, one line."""
    make, blocks, remembers = (_torch if description.network.suffix == ".pt" else _onnx)(description)
    rows = np.random.default_rng(0).standard_normal((BLOCK, description.width)).astype(np.float32)
    try:
        found = np.asarray(make()(rows[:1]))
    except Exception as error:
        raise _failure(description, error) from None
    if found.size != (wanted := len(description.joints)) or found.dtype.kind != "f":
        gives = f"gives {found.size} numbers of type {found.dtype}"
        raise PolicyError(f"{description.network} {gives} for the {wanted} joints of its description")
    remembers = remembers or _remembers(make(), rows[:1])
    batched = blocks and not remembers and _same_bits(make(), rows, wanted)
    return Networks(lambda: _in_rows(make()), BLOCK if batched else 1, remembers)


def _in_rows(act: Act) -> Act:
    """Gives actions (b, 12), whatever axes they have besides."""
    return lambda rows: np.reshape(act(rows), (len(rows), -1))


def _failure(description: PolicyDescription, error: Exception) -> PolicyError:
    """What an error of a network says; where it is of matrices that do not fit, the width that it reads."""
    if found := re.search(r"and (\d+)x\d+\)|Expected (\d+), got|mat \(\d+x(\d+)\)", str(error)):
        return _other_width(description, int(next(filter(None, found.groups()))))
    *_, reason = described(error).rpartition("RuntimeError: ")
    return PolicyError(f"{description.network} fails: {reason[:LONGEST_REASON]}")


def _other_width(description: PolicyDescription, reads: int) -> PolicyError:
    terms = [(each.name, each.width, each.history) for each in description.terms]
    widths = " + ".join(f"{name} {width}{f' x {shown}' if shown > 1 else ''}" for name, width, shown in terms)
    fault = f"{description.network} reads {reads} numbers and its description gives {description.width}: {widths}"
    return PolicyError(fault, "correct the terms")


def _remembers(act: Act, row: Weights) -> bool:
    """Whether it gives another action when it is shown the same again."""
    first, *others = (np.array(act(row)).tobytes() for _ in range(3))
    return any(first != other for other in others)


def _same_bits(act: Act, rows: Weights, outputs: int) -> bool:
    """Whether it takes blocks, and each row has the same bits at each place and next to any others."""
    try:
        whole = np.array(act(rows))
        if whole.shape != (len(rows), outputs):
            return False
        for step in (1, 3, 7):
            kept = np.arange(len(rows)) % (step + 1) != 0
            others = np.where(kept[:, None], rows, -2.0 * rows)
            moved = np.roll(whole, step, axis=0).tobytes() == np.array(act(np.roll(rows, step, axis=0))).tobytes()
            if not moved or whole[kept].tobytes() != np.array(act(others))[kept].tobytes():
                return False
    except Exception:  # it does not take several rows
        return False
    return True


def _onnx(description: PolicyDescription) -> tuple[Callable[[], Act], bool, bool]:
    """What makes the network of an ONNX file, whether it takes batches, and whether it has a memory: inputs after the
    first, which outputs after the first renew in the same order."""
    file = description.network
    session = session_of(file)
    (seen, *states), (given, *renewed) = session.get_inputs(), session.get_outputs()
    shapes = [[size if isinstance(size, int) else 1 for size in state.shape] for state in states]
    if other := next((each for each in (seen, *states) if each.type not in TYPES), None):
        raise PolicyError(f"{file} reads {other.type}: it must read float or double")
    if len(seen.shape) not in (1, 2):
        raise PolicyError(f"{file} reads {seen.shape}: it must read one observation, or a batch")
    if isinstance(seen.shape[-1], int) and seen.shape[-1] != description.width:
        raise _other_width(description, seen.shape[-1])
    if [len(each.shape) for each in renewed[: len(states)]] != [len(shape) for shape in shapes]:
        names = ", ".join(each.name for each in states)
        raise PolicyError(f"{file} reads {names} besides the observation, and its outputs do not renew them")
    names, flat = [each.name for each in (given, *renewed[: len(states)])], len(seen.shape) == 1

    def make() -> Act:
        memory = {state.name: np.zeros(shape, TYPES[state.type]) for state, shape in zip(states, shapes, strict=True)}

        def act(rows: Weights) -> Any:
            shown = rows.astype(TYPES[seen.type])
            found, *kept = session.run(names, {seen.name: shown[0] if flat else shown} | memory)
            memory.update(zip(memory, kept, strict=True))
            return found

        return act

    return make, not flat and not isinstance(seen.shape[0], int), bool(states)


def _torch(description: PolicyDescription) -> tuple[Callable[[], Act], bool, bool]:
    """What makes the network of a TorchScript file; that it takes batches and has a memory is found out by trying."""
    # By name: evaluating imports no learner, except for a learner's own file.
    file, torch = description.network, import_module("torch")
    torch.set_num_threads(1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            module = torch.jit.load(file, map_location="cpu").eval()
    except Exception as error:
        fault = f"{file} is no TorchScript ({described(error)[:LONGEST_REASON]})"
        raise PolicyError(fault, "export the network with torch.jit.save; a checkpoint holds weights alone") from None
    kind = next((each.dtype for each in module.parameters()), torch.float32)

    def make(flat: bool = False) -> Act:
        own = copy.deepcopy(module)

        def act(rows: Weights) -> Any:
            # Unoptimised: what the first calls give is to be what later ones do.
            with torch.inference_mode(), torch.jit.optimized_execution(False):
                found = own(torch.from_numpy(rows[0] if flat else rows).to(kind))
            return (found[0] if isinstance(found, tuple | list) else found).numpy()

        return act

    one = np.zeros((1, description.width), np.float32)
    flat = not _answers(make(), one) and _answers(make(True), one)
    return partial(make, flat), not flat, hasattr(module, "reset")


def _answers(act: Act, rows: Weights) -> bool:
    try:
        act(rows)
    except Exception:
        return False
    return True
