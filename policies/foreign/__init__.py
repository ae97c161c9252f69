"""Policies from outside: a class or function in a Python file, an ONNX file, a model of Stable-Baselines3."""

from policies.foreign.policy import Foreign
from policies.foreign.reference import is_reference, unsupported

__all__ = ["Foreign", "is_reference", "unsupported"]
