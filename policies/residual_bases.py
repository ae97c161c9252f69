"""Base policies of residual policies, and their storage as JSON.

Three items define a base policy completely: its name, its parameters and, if it uses a height scan, the scan.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from typing import Any, NamedTuple

from policies.article import Document, DocumentRepaired, PrintedGait
from policies.base import Policy
from policies.gaits.parameters import GAITS, GaitParameters
from policies.gaits.policy import Gaits
from policies.mpc.model_based import ModelBased
from policies.mpc.parameters import MpcParameters
from policies.mpc.policy import Mpc, MpcWbc
from policies.mpc.sighted import SightedMpcWbc
from policies.parameters import Parameters, from_json
from policies.poses import Crouch, Stand
from policies.trot.integral import IntegralParameters, TrotIntegral
from policies.trot.open_loop import Trot, TrotParameters
from policies.trot.reference import ReferenceParameters, TrotReference
from policies.virtual_model.parameters import VirtualParameters
from policies.virtual_model.policy import TrotFeedback
from quad_env.actuation.models import IDEAL, Actuator
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import HeightScan


class BaseSpec(NamedTuple):
    """Specification of a base policy: function that makes the policy, and class of its parameters."""

    make: Callable[..., Policy]
    """Function that makes the policy from the keyword arguments `robot`, `control_period` (s) and `parameters`.

    The function has the argument `parameters` only if the policy has parameters. If this argument is omitted, the
    policy gets the parameters that ship with the project."""
    parameters: type[Parameters] | None = None
    """Class of the parameters of the base policy; None if the policy has no parameters."""

    @property
    def kind(self) -> type:
        """Class of the base policy, a subclass of `Policy`."""
        kind = self.make.func if isinstance(self.make, partial) else self.make
        assert isinstance(kind, type)
        return kind

    @property
    def is_model_based(self) -> bool:
        """True if the base policy uses a dynamics model of the robot.

        `make` then also accepts the keyword arguments `joint_delay_steps` (control steps) and `actuator`.
        """
        return issubclass(self.kind, ModelBased)


BASES: dict[str, BaseSpec] = {
    "bound": BaseSpec(partial(Gaits, "bound"), GaitParameters),
    "crouch": BaseSpec(Crouch),
    "document": BaseSpec(Document, PrintedGait),
    "document_repaired": BaseSpec(DocumentRepaired, PrintedGait),
    "gaits": BaseSpec(Gaits, GaitParameters),
    "mpc": BaseSpec(Mpc, MpcParameters),
    "mpc_wbc": BaseSpec(MpcWbc, MpcParameters),
    "mpc_wbc_sighted": BaseSpec(SightedMpcWbc, MpcParameters),
    "pace": BaseSpec(partial(Gaits, "pace"), GaitParameters),
    "pronk": BaseSpec(partial(Gaits, "pronk"), GaitParameters),
    "stand": BaseSpec(Stand),
    "trot": BaseSpec(Trot, TrotParameters),
    "trot_feedback": BaseSpec(TrotFeedback, VirtualParameters),
    "trot_integral": BaseSpec(TrotIntegral, IntegralParameters),
    "trot_reference": BaseSpec(TrotReference, ReferenceParameters),
    "walk": BaseSpec(partial(Gaits, "walk"), GaitParameters),
}
"""Name of each base policy -> its specification: function that makes the policy, and class of its parameters."""


def base_to_json(policy: Policy) -> dict[str, Any]:
    """Convert a base policy to JSON values, which are stored in the `policy.json` of a residual policy.

    Args:
        policy: Base policy to convert.

    Returns:
        Dictionary with the keys `name`, `parameters`, `sha256` (SHA-256 of the parameters) and, if the policy uses a
        height scan, `height_scan`.

    Raises:
        ValueError: The policy is not one of the base policies in `BASES`.
    """
    base = BASES.get(policy.name)
    if base is None or type(policy) is not base.kind:
        raise ValueError(f"a residual's base is one of {', '.join(BASES)}, not {policy.name}")
    parameters: Any = getattr(policy, "parameters", {})
    if isinstance(parameters, Mapping):
        parameters = {gait: asdict(values) for gait, values in parameters.items()}
    else:
        parameters = asdict(parameters)
    scan = {} if policy.height_scan is None else {"height_scan": asdict(policy.height_scan)}
    return {"name": policy.name, "parameters": parameters, "sha256": _digest(parameters), **scan}


def base_from_json(
    description: Any, robot: Robot, control_period: float, joint_delay_steps: int = 0, actuator: Actuator = IDEAL
) -> Policy:
    """Make a base policy from the JSON values of `base_to_json`.

    Args:
        description: Dictionary that `base_to_json` has returned, read from a file.
        robot: Robot that the policy controls.
        control_period: Time between two control steps, s.
        joint_delay_steps: Delay of the observed joint angles, control steps; used by a model-based policy.
        actuator: Actuator model of the joints; used by a model-based policy.

    Returns:
        The base policy.

    Raises:
        ValueError: The description is not valid. The error message has one line.
    """
    if not isinstance(description, dict) or set(description) - {"height_scan"} != {"name", "parameters", "sha256"}:
        raise ValueError("base must have name and parameters, and a sha256 of these")
    name = description["name"]
    parameters = description["parameters"]
    if not isinstance(name, str) or name not in BASES:
        raise ValueError(f"base must be one of {', '.join(BASES)}, not {name!r}")
    if not isinstance(parameters, dict):
        raise ValueError("the base's parameters must be an object")
    arguments = _arguments(BASES[name], parameters)
    if description["sha256"] != _digest(parameters):
        raise ValueError("the base's parameters are not those that it was trained on (SHA-256 differs)")
    try:
        scan = HeightScan(**description["height_scan"]) if "height_scan" in description else None
    except (TypeError, ValueError) as error:
        raise ValueError(f"the base's height_scan: {error}") from None
    if scan is None and BASES[name].kind is SightedMpcWbc:
        raise ValueError("mpc_wbc_sighted needs a height_scan")
    if BASES[name].is_model_based:
        arguments |= {"joint_delay_steps": joint_delay_steps, "actuator": actuator}
    return make_base(BASES[name], scan, robot=robot, control_period=control_period, **arguments)


def make_base(base: BaseSpec, height_scan: HeightScan | None = None, **arguments: Any) -> Policy:
    """Make a base policy from its specification.

    Args:
        base: Specification of the base policy, see `BASES`.
        height_scan: Height scan that the environment observes. Only mpc_wbc_sighted uses it; the other policies accept
            an observation with a height scan and ignore the scan. None if the environment observes no height scan.
        **arguments: Keyword arguments of the function `base.make`, for example `robot` and `control_period`.

    Returns:
        The base policy.
    """
    if base.kind is SightedMpcWbc and height_scan is not None:
        arguments["height_scan"] = height_scan
    policy = base.make(**arguments)
    policy.height_scan = height_scan or policy.height_scan
    return policy


def _arguments(base: BaseSpec, parameters: dict[str, Any]) -> dict[str, Any]:
    """Convert the JSON parameters of a base policy to keyword arguments of `base.make`.

    The result is empty if the policy has no parameters. Raises ValueError if the parameters are not valid.
    """
    if base.parameters is None:
        if parameters:
            raise ValueError(f"a {base.kind.__name__} has no parameters")
        return {}
    if base.kind is Gaits and set(parameters) != set(GAITS):
        raise ValueError(f"the base's parameters must be those of {', '.join(GAITS)}")
    try:
        if base.kind is Gaits:
            return {"parameters": {gait: from_json(base.parameters, values) for gait, values in parameters.items()}}
        return {"parameters": from_json(base.parameters, parameters)}
    except ValueError as error:
        raise ValueError(f"the base's {error}") from None


def _digest(parameters: dict[str, Any]) -> str:
    """Return the SHA-256 of the JSON text of policy `parameters` (name -> number), as hexadecimal digits."""
    return hashlib.sha256(json.dumps(parameters, sort_keys=True).encode()).hexdigest()
