"""What names a policy from outside: `my_file.py:MyPolicy`, `my_file.onnx` or `my_file.zip`."""

from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from policies.base import PolicyError
from quad_env.files import check_file

KINDS = {".py": "Python", ".onnx": "ONNX", ".zip": "Stable-Baselines3"}
"""What a file holds, by how its name ends."""
_NEEDS = {".onnx": ("onnxruntime", "onnx"), ".zip": ("stable_baselines3", "train")}
"""Package that reads a file, and the extra that installs it."""


@dataclass(frozen=True)
class Reference:
    """A file, and in a Python file the name of what is to be the policy."""

    file: Path
    name: str = ""

    @property
    def suffix(self) -> str:
        """One of KINDS."""
        return self.file.suffix.lower()

    def __str__(self) -> str:
        return f"{self.name} in {self.file}" if self.name else str(self.file)


def is_reference(text: str | Path) -> bool:
    """Whether a text names a policy from outside; a folder is none, whatever it is called."""
    return _read(text).suffix in KINDS and not Path(text).is_dir()


def _read(text: str | Path) -> Reference:
    file, colon, name = str(text).rpartition(":")
    return Reference(Path(file), name) if colon and file.lower().endswith(".py") else Reference(Path(text))


def checked(text: str | Path, trust: bool) -> Reference:
    """What a text names, wherever the process that loads it stands, if it is there and may be loaded.

    Raises PolicyError, which says what is missing.
    """
    reference = _read(text)
    if not reference.file.is_file():
        raise PolicyError(f"there is no file {reference.file}")
    try:
        check_file(reference.file)
    except OSError as error:
        raise PolicyError(f"cannot read {reference.file} ({error.strerror})") from None
    if reference.suffix == ".py" and not reference.name:
        raise PolicyError(f"name the policy in {reference.file} after a colon, as in {reference.file}:MyPolicy")
    if reference.suffix == ".zip" and not trust:
        raise PolicyError(
            f"loading {reference.file} can run code that is hidden in it: give --trust if you know where it comes from"
        )
    package, extra = _NEEDS.get(reference.suffix, ("", ""))
    if package and find_spec(package) is None:
        raise PolicyError(f'{reference.file} needs {package}, which is not here: pip install -e ".[{extra}]"')
    return replace(reference, file=reference.file.absolute())
