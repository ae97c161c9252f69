"""Check of the files that a user's model file names, before MuJoCo opens them.

Each file, such as a mesh or an included model, must be regular (no device or pipe) and not too large.
"""

import os
import re
from collections.abc import Iterator
from pathlib import Path

from quad_env.files.reading import check_file, read_bytes
from quad_env.robots.structure import ModelError

_FILES = re.compile(rb"""\b(?:file|filename)\s*=\s*(["'])([^"'<>\0]{1,1000})\1""")
"""Pattern of an attribute of MJCF or URDF that names a file."""
_FOLDERS = re.compile(rb"""\b(?:meshdir|texturedir|assetdir)\s*=\s*(["'])([^"'<>\0]{1,1000})\1""")
"""Pattern of an attribute of MJCF or URDF that names the folder of meshes or textures."""
MODEL_SUFFIXES = (".xml", ".mjcf", ".urdf")
"""Endings of the names of model files; a model file can name further files, which are checked, too."""
_MAX_FILES = 5000
"""Largest number of files that are checked for one model; further files that the model names are not checked."""
_MAX_FILE_SIZE = 2**28
"""Largest valid size of a file that a model names, bytes; the largest published meshes have 50 MiB."""


def referenced_files(path: Path) -> list[Path]:
    """Return the files that a model and its included models name, after a check.

    Args:
        path: MJCF or URDF file of the user's model.

    Returns:
        Paths of the files that exist, without `path` itself.

    Raises:
        ModelError: A model cannot be read, or a named file is too large or not regular.
    """
    waiting = [path]
    checked = set[Path]()
    existing = []
    while waiting:
        model = waiting.pop()
        try:
            text = read_bytes(model)
        except OSError as error:
            raise ModelError(f"{model.name} cannot be read ({error.strerror})") from None
        for file in _named_files(text, path.parent):
            if file in checked or len(checked) > _MAX_FILES:
                continue
            checked.add(file)
            if not _is_regular(file):
                continue
            existing.append(file)
            if file.suffix.lower() in MODEL_SUFFIXES:
                waiting.append(file)
    return existing


def _named_files(text: bytes, folder: Path) -> Iterator[Path]:
    """Yield the possible paths of each file that a model names.

    A path may be relative to the model's folder, or to a mesh, texture or asset folder that the model names. All
    combinations are yielded, although most of these paths do not exist.

    Args:
        text: Content of a model file, which names other files.
        folder: Folder of the main model file.

    Yields:
        A path.
    """
    folders = {b"", *(match[2] for match in _FOLDERS.finditer(text))}
    for match in _FILES.finditer(text):
        for inner in folders:
            yield folder / os.fsdecode(inner) / os.fsdecode(match[2])


def _is_regular(file: Path) -> bool:
    """Return True for a regular file, False for a folder or a missing file, which MuJoCo itself reports.

    Raises ModelError for a file that is too large or not regular.
    """
    try:
        check_file(file, _MAX_FILE_SIZE)
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return False
    except OSError as error:
        if file.is_dir():
            return False
        raise ModelError(f"the file {file.name} that it names cannot be read: {error.strerror}") from None
    return True
