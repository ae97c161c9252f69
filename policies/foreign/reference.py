"""What names a policy from outside: `my_file.py:MyPolicy`, `my_file.onnx` or `my_file.zip`."""

from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from policies.base import PolicyError
from quad_env.files.reading import check_file

KINDS = {".py": "Python", ".onnx": "ONNX", ".zip": "Stable-Baselines3"}
"""What a file holds, by how its name ends."""
UNSUPPORTED = ".pt", ".pth", ".jit", ".ckpt", ".h5", ".pkl"
"""Files of networks that are not read."""
_NEEDS = {".onnx": (("onnxruntime", "onnx"), "onnx"), ".zip": (("stable_baselines3", "torch"), "train")}
"""Packages that read a file, and the extra that installs them."""


@dataclass(frozen=True)
class Reference:
    """A file, and in a Python file the name of what is to be the policy."""

    file: Path
    name: str = ""
    normaliser: Path | None = None
    """Statistics of the observations of a model of Stable-Baselines3, its VecNormalize, None if there are none."""

    @property
    def suffix(self) -> str:
        """One of KINDS."""
        return self.file.suffix.lower()

    @property
    def content(self) -> bytes:
        """All that is read of it."""
        return b"".join(file.read_bytes() for file in (self.file, self.normaliser) if file is not None)

    def __str__(self) -> str:
        return f"{self.name} in {self.file}" if self.name else str(self.file)


def is_reference(text: str | Path) -> bool:
    """Whether a text names a policy from outside; a folder is none, whatever it is called."""
    return _read(text).suffix in KINDS and not Path(text).is_dir()


def unsupported(text: str | Path) -> str | None:
    """What to do about a file of a kind that is not read; None for what is no such file."""
    if Path(text).suffix.lower() not in UNSUPPORTED:
        return None
    return (
        f"{text}: {Path(text).suffix} files (TorchScript, checkpoints of other learners) are not supported yet; export "
        "the network as .onnx (torch.onnx.export), load it in a class of a Python file (my_file.py:MyPolicy), or give "
        "a .zip of Stable-Baselines3 (with --trust)"
    )


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
    packages, extra = _NEEDS.get(reference.suffix, ((), ""))
    if missing := [package for package in packages if find_spec(package) is None]:
        raise PolicyError(f'{reference.file} needs {missing[0]}, which is not here: pip install -e ".[{extra}]"')
    found = replace(reference, file=reference.file.absolute())
    return replace(found, normaliser=_normaliser(found.file)) if found.suffix == ".zip" else found


def _normaliser(model: Path) -> Path | None:
    """The VecNormalize file of a model, as Stable-Baselines3's callbacks and its zoo call and place it.

    Raises PolicyError where files next to the model could be that of another one.
    """
    start, _, end = model.stem.rpartition("_steps")[0].rpartition("_")
    own = [f"{model.stem}_vecnormalize.pkl", f"{start}_vecnormalize_{end}_steps.pkl"]
    common = ["vecnormalize.pkl", "vec_normalize.pkl"]
    places = [model.parent / name for name in (*own, *common)] + [model.with_suffix("") / name for name in common]
    if there := [place for place in places if place.is_file()]:
        return there[0]
    if others := sorted(file.name for file in model.parent.glob("*.pkl") if "normalize" in file.name.lower()):
        raise PolicyError(
            f"{model} may be trained on normalised observations: next to it is {', '.join(others)}; rename the one "
            f"that belongs to it to {own[0]}, or move the model into a folder of its own"
        )
    return None
