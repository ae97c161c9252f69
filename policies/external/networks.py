"""Networks of policies from other projects, ONNX or TorchScript, with or without memory, asked for n robots.

They are shown one observation at a time: a row of a larger product is rounded otherwise, by 1e-7, which the previous
actions in the observation multiply. So a robot's actions have the same bits in any batch, and those of its project.
"""

import copy
import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Mask, PolicyError
from policies.external.network_kind import check_is_network, is_onnx
from policies.external.onnx_file import make_network_factory, open_session
from policies.external.onnx_roles import find_roles
from policies.external.packages import import_package
from policies.external.python_file import ActFunction
from policies.external.spec import PolicySpec
from policies.memory import PerRobotState
from quad_env.columns import EnvIndices
from quad_env.files.text import format_exception

Weights = NDArray[np.float32]
MAX_REASON = 300


class BatchedNetwork(PerRobotState):
    """The network of a description, for n robots.

    Args:
        make: makes what gives actions, without memory of any robot.
        remembers: whether it has a memory: then each robot has one of its own.
    """

    def __init__(self, make: Callable[[], ActFunction], remembers: bool) -> None:
        self._make, self.remembers = make, remembers
        self.reset(1)

    def reset(self, num_envs: int) -> None:
        """Fresh memories for so many robots."""
        self._acts = [self._make() for _ in range(num_envs)] if self.remembers else [self._make()] * num_envs

    def reset_where(self, mask: Mask) -> None:
        """Fresh memories for those robots."""
        for robot in np.flatnonzero(mask).tolist() if self.remembers else ():
            self._acts[robot] = self._make()

    def compute_actions(self, observations: Weights, who: EnvIndices) -> NDArray[Any]:
        """Actions (m, 12) of those robots for their observations, (m, k)."""
        pairs = zip(observations, who.tolist(), strict=True)
        return np.array([np.ravel(self._acts[robot](row)) for row, robot in pairs])


def load_network(description: PolicySpec) -> BatchedNetwork:
    """The description's network, which has its process to itself. Raises PolicyError, one line."""
    make, remembers = (_onnx if is_onnx(description.network) else _torch)(description)
    row = np.random.default_rng(0).standard_normal(description.width).astype(np.float32)
    try:
        act = make()
        found, *again = (np.array(act(row)) for _ in range(3))
    except Exception as error:
        raise _failure(description, error) from None
    if found.size != (wanted := len(description.joints)) or found.dtype.kind != "f":
        gives = f"gives {found.size} numbers of type {found.dtype}"
        raise PolicyError(f"{description.network} {gives} for the {wanted} joints of its description")
    return BatchedNetwork(make, remembers or any(found.tobytes() != each.tobytes() for each in again))


def _failure(description: PolicySpec, error: Exception) -> PolicyError:
    """What an error of a network says; where it is of matrices that do not fit, the width that it reads."""
    if found := re.search(r"and (\d+)x\d+\)|Expected (\d+), got|mat \(\d+x(\d+)\)", str(error)):
        return _other_width(description, int(next(filter(None, found.groups()))))
    reason = format_exception(error).rpartition("RuntimeError: ")[2]
    return PolicyError(f"{description.network} fails: {reason[:MAX_REASON]}")


def _other_width(description: PolicySpec, reads: int) -> PolicyError:
    terms = [(each.name, each.width, each.history) for each in description.terms]
    widths = " + ".join(f"{name} {width}{f' x {shown}' if shown > 1 else ''}" for name, width, shown in terms)
    fault = f"{description.network} reads {reads} numbers and its description gives {description.width}: {widths}"
    return PolicyError(fault, "correct the terms")


def _onnx(description: PolicySpec) -> tuple[Callable[[], ActFunction], bool]:
    """What makes the network of an ONNX file, and whether it has a memory."""
    session = open_session(description.network)
    made = make_network_factory(session, description.network)
    width = find_roles(session.get_inputs(), session.get_outputs(), description.network).observation.shape[-1]
    if isinstance(width, int) and width != description.width:
        raise _other_width(description, width)
    return made


def _torch(description: PolicySpec) -> tuple[Callable[[], ActFunction], bool]:
    """What makes the network of a TorchScript file, and whether it says that it has a memory."""
    file = description.network
    check_is_network(file)
    torch = import_package("torch", "train")
    torch.set_num_threads(1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            module = torch.jit.load(file, map_location="cpu").eval()
    except Exception as error:
        fault = f"{file} is no TorchScript ({format_exception(error)[:MAX_REASON]})"
        raise PolicyError(fault, "export the network with torch.jit.save; a checkpoint holds weights alone") from None
    kind = next((each.dtype for each in module.parameters()), torch.float32)

    def make() -> ActFunction:
        own = copy.deepcopy(module)

        def act(row: Weights) -> Any:
            # A copy, since bits hang on where a row lies in memory; unoptimised, since later calls would differ.
            with torch.inference_mode(), torch.jit.optimized_execution(False):
                found = own(torch.from_numpy(row[None]).to(kind, copy=True))
            return (found[0] if isinstance(found, tuple | list) else found).numpy()

        return act

    return make, hasattr(module, "reset")
