"""Check of an argument that is a name or a path: detects the path of a missing file."""

from pathlib import Path

ENDINGS = frozenset(
    (
        *(".json", ".mjcf", ".npy", ".npz", ".onnx", ".parquet", ".pkl", ".png", ".pt", ".pth", ".py", ".safetensors"),
        *(".stl", ".toml", ".urdf", ".xml", ".yaml", ".yml", ".zip"),
    )
)
"""Endings of the files that users name. An option value such as `noise=0.2` does not end in one of them."""


def missing_file_message(text: str) -> str | None:
    """Return the message `there is no file or folder x/y` for the path of a missing file, else None.

    A text is a path if it has a separator, begins with `~`, or has one of ENDINGS; any other text is a name.
    In `FILE.py:NAME` the part before the colon is the path.
    """
    file, colon, _ = text.rpartition(":")
    path = file if colon and file.lower().endswith(".py") else text
    ending = Path(path).suffix.lower()
    if not (ending in ENDINGS or any(sign in path for sign in "/\\") or path.startswith("~")):
        return None
    try:
        if Path(path).exists():
            return None
    except (OSError, ValueError):  # The system rejects the text as a file name, so no file has this name.
        pass
    return f"there is no file {path}" if ending in ENDINGS else f"there is no file or folder {path}"
