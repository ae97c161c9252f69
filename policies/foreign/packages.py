"""Packages of extras, loaded by name when a file needs them: evaluating imports no learner otherwise."""

from importlib import import_module
from typing import Any

from policies.base import PolicyError


def package(name: str, extra: str = "onnx") -> Any:
    """The module of that name. Raises PolicyError, which names the extra that installs it, where it is missing."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        raise PolicyError(f'this needs {error.name}, which is not here: pip install -e ".[{extra}]"') from None
