"""Check of names and paths: detects a text that can only be a path to a missing file."""

from pathlib import Path

ENDINGS = frozenset(
    (
        *(".json", ".mjcf", ".npy", ".npz", ".onnx", ".parquet", ".pkl", ".png", ".pt", ".pth", ".py", ".safetensors"),
        *(".stl", ".toml", ".urdf", ".xml", ".yaml", ".yml", ".zip"),
    )
)
"""Endings of the files that users name; a severity as `noise=0.2` does not end in one of them."""


def missing_file_message(text: str) -> str | None:
    """Return `there is no file or folder x/y` for a missing path; None for a name and for an existing file.

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
    except (OSError, ValueError):  # not a valid file name
        pass
    return f"there is no file {path}" if ending in ENDINGS else f"there is no file or folder {path}"
