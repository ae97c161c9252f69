"""Check of a command-line value that can be a name or a path; the check detects a missing file."""

from pathlib import Path

ENDINGS = frozenset(
    (
        *(".json", ".mjcf", ".npy", ".npz", ".onnx", ".parquet", ".pkl", ".png", ".pt", ".pth", ".py", ".safetensors"),
        *(".stl", ".toml", ".urdf", ".xml", ".yaml", ".yml", ".zip"),
    )
)
"""Endings of file names; a command-line value with one of these endings is a path.

Other endings do not make a value a path, because other values can contain a dot, such as `noise=0.2`.
"""


def missing_file_message(text: str) -> str | None:
    """Return an error message such as `there is no file x.toml` if a text is the path of a missing file.

    A text is a path if it contains a slash or backslash, begins with `~`, or ends with one of ENDINGS. Any other text
    is a name. In `FILE.py:NAME`, the part before the colon is the path. None is returned for a name, and for the path
    of an existing file or folder.
    """
    file, colon, _ = text.rpartition(":")
    path = file if colon and file.lower().endswith(".py") else text
    ending = Path(path).suffix.lower()
    if not (ending in ENDINGS or any(sign in path for sign in "/\\") or path.startswith("~")):
        return None
    try:
        if Path(path).exists():
            return None
    except (OSError, ValueError):  # No file can have this name, because the system rejects it.
        pass
    return f"there is no file {path}" if ending in ENDINGS else f"there is no file or folder {path}"
