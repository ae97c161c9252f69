"""Packages of extras, loaded by name when a file needs them: evaluating imports no learner otherwise."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from policies.base import PolicyError


def import_package(name: str, extra: str = "onnx") -> Any:
    """The module of that name. Raises PolicyError, which names the extra that installs it, where it is missing."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise _missing(str(error.name), extra) from None


def check_package(name: str, extra: str = "onnx") -> None:
    """Raise PolicyError where a module is missing, as `package` does, without loading it."""
    if find_spec(name) is None:
        raise _missing(name, extra)


def _missing(name: str, extra: str) -> PolicyError:
    return PolicyError(f'this needs {name}, which is not here: pip install -e ".[{extra}]"')
