"""A policy in a Python file: a `Policy`, or anything that is called with an observation and gives an action."""

import copy
import importlib.util
import inspect
import sys
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

from policies.base import Policy, PolicyError
from policies.external.reference import PolicyReference
from quad_env.files.text import format_exception
from quad_env.robots.robot import Robot

ActFunction = Callable[[Any], object]
"""From an observation to an action, of one robot or of several."""
ActFactory = Callable[[], ActFunction]
"""Gives one without memory of any robot."""


def load_python(reference: PolicyReference, robot: Robot, control_period: float) -> Policy | ActFactory:
    """The policy that a reference names; PolicyError, one line, where there is none.

    A class is made without arguments, or with `robot` and `control_period` if it takes them.
    """
    there = find_object(reference)
    if isinstance(there, Policy):
        return there
    if not isinstance(there, type):
        return partial(_fresh, _callable(there, reference))
    make = partial(there, **_arguments(there, robot=robot, control_period=control_period))
    try:
        first = make()
    except (Exception, SystemExit) as error:
        raise PolicyError(f"{reference} cannot be made: {format_exception(error)}") from error
    if isinstance(first, Policy):
        return first
    _callable(first, reference)
    return make


def find_object(reference: PolicyReference) -> Any:
    """What a reference names; PolicyError, one line, where the file fails or has none of that name."""
    contents = vars(_run(reference))
    if reference.name not in contents:
        own = [name for name, value in contents.items() if callable(value) and not name.startswith("_")]
        raise PolicyError(f"{reference.file} has no {reference.name!r}; it has {', '.join(own) or 'nothing to call'}")
    return contents[reference.name]


def _run(reference: PolicyReference) -> ModuleType:
    """The file as a module, which can import its neighbours."""
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


def _callable(found: Any, reference: PolicyReference) -> ActFunction:
    if not callable(found):
        raise PolicyError(f"{reference} must be a policies.Policy or callable with an observation, not {found!r:.80}")
    act: ActFunction = found
    return act


def _arguments(kind: type, **known: Any) -> dict[str, Any]:
    """Those of the known arguments that a class takes."""
    try:
        parameters = inspect.signature(kind).parameters
    except ValueError:  # of a class that is not written in Python
        return {}
    every = any(each.kind is inspect.Parameter.VAR_KEYWORD for each in parameters.values())
    return {name: value for name, value in known.items() if every or name in parameters}


def _fresh(act: ActFunction) -> ActFunction:
    """A copy of an object, as it was before its first call; what cannot be copied serves every robot."""
    try:
        return copy.deepcopy(act)
    except Exception:
        return act
