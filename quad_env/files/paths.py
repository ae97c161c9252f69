"""Texts that may be names or paths: whether one can only be a path, to something that is not there."""

from pathlib import Path

ENDINGS = frozenset(
    (
        *(".json", ".mjcf", ".npy", ".npz", ".onnx", ".parquet", ".pkl", ".png", ".pt", ".pth", ".py", ".safetensors"),
        *(".stl", ".toml", ".urdf", ".xml", ".yaml", ".yml", ".zip"),
    )
)
"""Endings of the files that users name; a severity such as `noise=0.2` has none of them."""


def missing_file(text: str) -> str | None:
    """Say that a path leads nowhere: `there is no file or folder x/y`; None for a name, and for what is there.

    A text is a path if it has a separator, begins with `~`, or has one of ENDINGS. `FILE.py:NAME` is a path, too.
    """
    file, colon, _ = text.rpartition(":")
    path = file if colon and file.lower().endswith(".py") else text
    ending = Path(path).suffix.lower()
    if not (ending in ENDINGS or any(sign in path for sign in "/\\") or path.startswith("~")):
        return None
    try:
        if Path(path).exists():
            return None
    except (OSError, ValueError):  # no name that a file can have
        pass
    return f"there is no file {path}" if ending in ENDINGS else f"there is no file or folder {path}"
