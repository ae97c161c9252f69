"""Network of a run, in the usual places of its exporters."""

import os
from pathlib import Path
from reprlib import repr as shortened

from policies.base import PolicyError

NAMES = ("policy.onnx", "policy.pt", "policies/policy_1.pt", "policies/policy_lstm_1.pt", "policy_1.pt")
"""Of Isaac Lab, mjlab and Unitree (`exported/policy.*`) and of legged_gym (`exported/policies/policy_1.pt`)."""
PAIR = "_env", "_policy.pt"
"""Ends of Isaac Sim's samples, such as `spot_env.yaml` and `spot_policy.pt`."""


def exported(settings: Path) -> Path:
    """The network to a file of settings: in `exported` of its run, next to the file, or the only .onnx there.

    Raises PolicyError where there is none, or several.
    """
    run = settings.parent.parent if settings.parent.name == "params" else settings.parent
    folders = [run / "exported", run, settings.parent]
    names = [*NAMES, settings.stem.removesuffix(PAIR[0]) + PAIR[1]]
    named = [folder / name for folder in folders for name in names if (folder / name).is_file()]
    others = [file for folder in folders for file in sorted(folder.glob("*.onnx"))]
    found = named[:1] or list(dict.fromkeys(others))
    if len(found) == 1:
        return Path(os.path.abspath(found[0]))
    several = f"{', '.join(file.name for file in found)} lie there" if found else "none is there"
    raise PolicyError(
        f"which network belongs to {settings.name}? {several}", f"put it at {run / 'exported/policy.onnx'}"
    )


def named(folder: Path, name: str) -> Path:
    """The network of that name in a folder. Raises PolicyError where it is none."""
    try:
        if (file := folder / name).is_file():
            return Path(os.path.abspath(file))
    except (OSError, ValueError):
        pass
    raise PolicyError(f"there is no network {shortened(name)} in {folder}")
