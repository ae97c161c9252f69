"""Policies in Python files: a `Policy`, or any callable that maps an observation to an action."""

import copy
import importlib.util
import inspect
import sys
from functools import partial
from types import ModuleType
from typing import Any

from policies.base import Policy, PolicyError
from policies.external.act_function import ActFactory, ActFunction
from policies.external.reference import PolicyReference
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot


def load_python(reference: PolicyReference, robot: Robot, control_period: float) -> Policy | ActFactory:
    """Load the policy that a name in a Python file refers to.

    A class is called to make an instance. It gets the arguments `robot` and `control_period` that it accepts.

    Args:
        reference: Reference to the file and the name.
        robot: Robot that the policy moves.
        control_period: Control period of the environment, s.

    Returns:
        Policy, or a factory of functions from one observation to one action.

    Raises:
        PolicyError: The file fails, the name does not exist, or its object is not a policy.
    """
    named_object = find_object(reference)
    if isinstance(named_object, Policy):
        return named_object
    if not isinstance(named_object, type):
        return partial(_copy_of, _check_callable(named_object, reference))
    make = partial(named_object, **_accepted_arguments(named_object, robot=robot, control_period=control_period))
    try:
        instance = make()
    except (Exception, SystemExit) as error:
        raise PolicyError(f"{reference} cannot be made: {format_exception(error)}") from error
    if isinstance(instance, Policy):
        return instance
    _check_callable(instance, reference)
    return make


def find_object(reference: PolicyReference) -> Any:
    """Return the object that a reference names. Raises PolicyError if the file fails or lacks this name."""
    contents = vars(_run(reference))
    if reference.name not in contents:
        own = [name for name, value in contents.items() if callable(value) and not name.startswith("_")]
        raise PolicyError(f"{reference.file} has no {reference.name!r}; it has {', '.join(own) or 'nothing to call'}")
    return contents[reference.name]


def _run(reference: PolicyReference) -> ModuleType:
    """Execute a Python file and return it as a module; it can import other modules of its folder."""
    file = reference.file.resolve()
    sys.path.insert(0, str(file.parent))
    name = f"policy_of_{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None  # noqa: PT018
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise PolicyError(f"{reference.file} fails: {format_exception(error)}") from error
    return module


def _check_callable(candidate: Any, reference: PolicyReference) -> ActFunction:
    """Return the object if it can be called. Raises PolicyError otherwise."""
    if not callable(candidate):
        raise PolicyError(
            f"{reference} must be a policies.Policy or callable with an observation, not {candidate!r:.80}"
        )
    act: ActFunction = candidate
    return act


def _accepted_arguments(kind: type, **known: Any) -> dict[str, Any]:
    """Return the arguments in `known` that the constructor of a class accepts, as a dictionary."""
    try:
        parameters = inspect.signature(kind).parameters
    except ValueError:  # because a class that is not written in Python may have no signature
        return {}
    accepts_all = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    return {name: value for name, value in known.items() if accepts_all or name in parameters}


def _copy_of(act: ActFunction) -> ActFunction:
    """Return a copy of a callable that has not been called yet.

    Returns the callable itself if it cannot be copied.
    """
    try:
        return copy.deepcopy(act)
    except Exception:
        return act
