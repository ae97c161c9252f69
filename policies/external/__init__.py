"""External policies: files of users and other projects (Python, ONNX, TorchScript, Stable-Baselines3)."""

from policies.external.process import ExternalPolicy
from policies.external.reference import is_reference, unsupported_file_remedy

__all__ = ["ExternalPolicy", "is_reference", "unsupported_file_remedy"]
