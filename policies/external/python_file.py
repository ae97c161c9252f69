"""Policy in a Python file: a `Policy`, or any callable from an observation to an action."""

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
    """Load the object of a Python file.

    A class is made without arguments, or with `robot` and `control_period` if it takes them.

    Args:
        reference: Reference to the file and the object's name.
        robot: Robot that the policy moves.
        control_period: Control period of the environment, s.

    Returns:
        Policy, or a factory of functions from one observation to one action.

    Raises:
        PolicyError: The file fails, has no object of this name, or the object is no policy.
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
    """Return the object of a reference. Raises PolicyError if the file fails or has no object of this name."""
    contents = vars(_run(reference))
    if reference.name not in contents:
        own = [name for name, value in contents.items() if callable(value) and not name.startswith("_")]
        raise PolicyError(f"{reference.file} has no {reference.name!r}; it has {', '.join(own) or 'nothing to call'}")
    return contents[reference.name]


def _run(reference: PolicyReference) -> ModuleType:
    """Return the file as a module, which can import modules of its folder."""
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
    """Return the object if it can be called. Raises PolicyError."""
    if not callable(candidate):
        raise PolicyError(
            f"{reference} must be a policies.Policy or callable with an observation, not {candidate!r:.80}"
        )
    act: ActFunction = candidate
    return act


def _accepted_arguments(kind: type, **known: Any) -> dict[str, Any]:
    """Return the known arguments that the constructor of a class accepts."""
    try:
        parameters = inspect.signature(kind).parameters
    except ValueError:  # of a class that is not written in Python
        return {}
    accepts_all = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    return {name: value for name, value in known.items() if accepts_all or name in parameters}


def _copy_of(act: ActFunction) -> ActFunction:
    """Return a copy of an object from before its first call; the object itself if it cannot be copied."""
    try:
        return copy.deepcopy(act)
    except Exception:
        return act
