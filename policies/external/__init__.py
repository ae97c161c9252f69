"""Policies from outside: a class or function in a Python file, an ONNX file, a model of Stable-Baselines3."""

from policies.external.process import ExternalPolicy
from policies.external.reference import is_reference, unsupported_file_remedy

__all__ = ["ExternalPolicy", "is_reference", "unsupported_file_remedy"]
