"""Policies of other projects and of users: Python, ONNX, TorchScript and Stable-Baselines3 files."""

from policies.external.process import ExternalPolicy
from policies.external.reference import is_reference, unsupported_file_remedy

__all__ = ["ExternalPolicy", "is_reference", "unsupported_file_remedy"]
