"""Loader of policies from users' Python files: a `Policy`, or a callable from observation to action."""

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
    """Load a policy from a Python file by the name of its class or object.

    If the name refers to a class, an instance is made. The constructor gets the arguments `robot` and `control_period`
    if it accepts them.

    Args:
        reference: Reference to the Python file, with the name of the class or object.
        robot: Robot that the policy moves.
        control_period: Control period of the environment, s.

    Returns:
        Policy, or a function without arguments that returns a function from one observation to one action.

    Raises:
        PolicyError: The file raises an exception or does not define the name, or the named object is not a policy.
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
    """Execute the Python file of a reference, and return the class or object that the reference names.

    Raises PolicyError if the file raises an exception or does not define the name.
    """
    contents = vars(_run(reference))
    if reference.name not in contents:
        own = [name for name, value in contents.items() if callable(value) and not name.startswith("_")]
        raise PolicyError(f"{reference.file} has no {reference.name!r}; it has {', '.join(own) or 'nothing to call'}")
    return contents[reference.name]


def _run(reference: PolicyReference) -> ModuleType:
    """Execute the Python file of a reference and return it as a module.

    The folder of the file is added to `sys.path`, so that the file can import other modules of this folder. Raises
    PolicyError if the file raises an exception.
    """
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
    """Return `candidate`, an object from a user's file, if it is callable; raise PolicyError otherwise."""
    if not callable(candidate):
        raise PolicyError(
            f"{reference} must be a policies.Policy or callable with an observation, not {candidate!r:.80}"
        )
    act: ActFunction = candidate
    return act


def _accepted_arguments(kind: type, **known: Any) -> dict[str, Any]:
    """Return the arguments in `known` that the constructor of the class `kind` accepts: name -> value."""
    try:
        parameters = inspect.signature(kind).parameters
    except ValueError:  # A class that is implemented in C may have no signature.
        return {}
    accepts_all = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    return {name: value for name, value in known.items() if accepts_all or name in parameters}


def _copy_of(act: ActFunction) -> ActFunction:
    """Return a copy of a policy function in its initial state, so that each robot has its own state.

    Returns the function itself if it cannot be copied; the robots then share its state.
    """
    try:
        return copy.deepcopy(act)
    except Exception:
        return act
