"""What names a policy from outside: `my_file.py:MyPolicy`, a network's file, or one that describes how it is run."""

import hashlib
import itertools
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

from policies.base import PolicyError
from policies.external import readers
from policies.external.network_kind import TORCHSCRIPT_SUFFIXES, check_is_network, is_onnx
from policies.external.packages import check_package
from policies.external.readers.settings import WRITE_TOML
from policies.external.spec import PolicySpec
from quad_env.cli.limited_process import CrashError, LimitExceededError, call, read_limited
from quad_env.files.reading import MAX_TEXT_SIZE, check_file, max_network_size
from quad_env.files.text import brief

SPEC_SUFFIXES = ".onnx", ".pt", ".jit", ".toml", ".yaml", ".yml", ".json"
"""Ends of the names of files that may describe a policy, or that one next to them describes."""
SUFFIXES = ".py", ".zip", *SPEC_SUFFIXES
"""How the names of files end that are read."""
SIDECAR_SUFFIXES = ".toml", ".yaml", ".json"
"""Endings of files that describe the .pt or .jit of their name."""
_NEEDED = {".onnx": "onnx", ".yaml": "yaml", ".yml": "yaml"}
"""Packages that read files of these kinds."""
UNSUPPORTED_SUFFIXES = ".pth", ".ckpt", ".h5", ".pkl"
"""Files of networks that are not read."""
STATISTICS_NAMES = "vecnormalize.pkl", "vec_normalize.pkl"
"""Usual names of the statistics of a model of Stable-Baselines3."""
_STATISTICS_NAME = re.compile(r"normali[sz]e|vec_?norm")
"""Part of other names of statistics."""
BEST_MODEL_FOLDERS = "best_model", "best", "best_models", "eval"
"""Folders of a run's best model; its statistics lie in the run's folder under any name."""
MAX_FOLDERS = 1000
"""Largest number of entries of a model's folder that are searched for folders with statistics."""


@dataclass(frozen=True)
class PolicyReference:
    """A file, and in a Python file the name of what is to be the policy."""

    file: Path
    name: str = ""
    normaliser: Path | None = None
    """Statistics of the observations of a model of Stable-Baselines3, its VecNormalize, None if there are none."""
    spec: PolicySpec | None = None
    """How its network is run; None of a policy that acts on our observation by itself."""
    remarks: tuple[str, ...] = ()
    """Assumptions, a line each."""

    @property
    def suffix(self) -> str:
        """One of KINDS."""
        return self.file.suffix.lower()

    @property
    def sha256(self) -> str:
        """SHA-256 of all its files."""
        network = None if self.spec is None else self.spec.network
        files = [file for file in dict.fromkeys((self.file, self.normaliser, network)) if file is not None]
        said = "" if self.spec is None else self.spec.digest_text
        found = hashlib.sha256()
        for file in files:
            with file.open("rb") as stream:
                while part := stream.read(2**20):
                    found.update(part)
        found.update(said.encode())
        return found.hexdigest()

    def __str__(self) -> str:
        return f"{self.name} in {self.file}" if self.name else str(self.file)


def is_reference(text: str | Path) -> bool:
    """Whether a text names a policy from outside; a folder is none, whatever it is called."""
    return _read(text).suffix in SUFFIXES and not Path(text).is_dir()


def unsupported_file_remedy(text: str | Path) -> str | None:
    """What to do about a file of a kind that is not read; None for what is no such file."""
    if Path(text).suffix.lower() not in UNSUPPORTED_SUFFIXES:
        return None
    return (
        f"{text}: {Path(text).suffix} files (checkpoints of other learners) are not supported; export the network as "
        ".onnx (torch.onnx.export) or TorchScript .pt, load it in a class of a Python file (my_file.py:MyPolicy), or "
        "give a .zip of Stable-Baselines3 (with --trust)"
    )


def _read(text: str | Path) -> PolicyReference:
    file, colon, name = str(text).rpartition(":")
    return PolicyReference(Path(file), name) if colon and file.lower().endswith(".py") else PolicyReference(Path(text))


def resolve_reference(text: str | Path, trust: bool) -> PolicyReference:
    """What a text names, wherever the process that loads it stands, if it is there and may be loaded. Raises
    PolicyError, which says what is missing."""
    if not str(text).isprintable():
        raise PolicyError(f"{brief(str(text))}: a policy's name has printable characters alone")
    reference = _read(text)
    _check_file(reference.file)
    if reference.suffix == ".py" and not reference.name:
        raise PolicyError(f"name the policy in {reference.file} after a colon, as in {reference.file}:MyPolicy")
    found = replace(reference, file=reference.file.absolute())
    if found.suffix in TORCHSCRIPT_SUFFIXES:
        check_is_network(reference.file)
    if found.suffix in SPEC_SUFFIXES:
        found = replace(found, spec=_description(reference.file))
    loaded = found.file if found.spec is None else found.spec.network
    if loaded != found.file:
        _check_file(loaded)
    if found.spec is not None:
        check_is_network(loaded)
    if found.suffix == ".zip":
        return _with_normaliser(found, trust)
    if found.suffix != ".py" and not is_onnx(loaded) and not trust:
        raise _distrusted(loaded)
    return found


def _with_normaliser(model: PolicyReference, trust: bool) -> PolicyReference:
    """Return a model of Stable-Baselines3 with the statistics of its observations. Raises PolicyError."""
    try:
        normaliser, is_beside = _normaliser(model.file)
    except PolicyError:
        if trust:
            raise
        normaliser = None
        is_beside = True
    if not trust:
        raise _distrusted(*(file for file in (model.file, normaliser) if file is not None))
    remark = f"its observations are normalised by {normaliser}, the only statistics of its run"
    return replace(model, normaliser=normaliser, remarks=() if is_beside else (remark,))


def _distrusted(*files: Path) -> PolicyError:
    """Return the error for files that are not to be loaded without --trust."""
    names = " and ".join(map(str, files))
    them = "it" if len(files) == 1 else "them"
    where = "it comes" if len(files) == 1 else "they come"
    return PolicyError(
        f"loading {names} can run code that is hidden in {them}: give --trust if you know where {where} from"
    )


def _check_file(file: Path) -> None:
    """Raise PolicyError unless it is there and can be read."""
    if not file.is_file():
        raise PolicyError(f"there is no file {file}")
    try:
        check_file(file, MAX_TEXT_SIZE if file.suffix.lower() == ".py" else max_network_size())
    except OSError as error:
        raise PolicyError(f"cannot read {file} ({error.strerror})") from None


def _description(file: Path) -> PolicySpec | None:
    """What a file says of the policy, or of a .pt the file of its name next to it; None of an ONNX that says nothing.

    Raises PolicyError.
    """
    if file.suffix.lower() in TORCHSCRIPT_SUFFIXES:
        found_at = [place for end in SIDECAR_SUFFIXES if (place := file.with_suffix(end)).is_file()]
        found = _read_description(found_at[0]) if found_at else None
        if found is None:
            name = file.with_suffix(SIDECAR_SUFFIXES[0]).name
            fault = f"{file} does not say how its network is run"
            remedy = f"{WRITE_TOML} next to it as {name}"
            raise readers.IncompleteSpecError("a network", {"network": file.absolute()}, fault=fault, remedy=remedy)
        return _whole(replace(found, network=file.absolute()))
    found = _read_description(file)
    return None if found is None else replace(found, network=found.network.absolute())


def _read_description(file: Path) -> PolicySpec | None:
    """Read a file's description in a limited process, since it may take all time or memory. Raises PolicyError."""
    if (needed := _NEEDED.get(file.suffix.lower())) is not None:
        check_package(needed)
    try:
        return read_limited(readers.read, file)  # type: ignore[no-any-return]
    except (LimitExceededError, CrashError) as error:
        raise PolicyError(f"{file}: {error}") from None


def _whole(found: PolicySpec) -> PolicySpec:
    """Check a description with the network next to it in a limited process. Raises PolicyError."""
    try:
        return call(readers.check_network_matches, found, True)  # type: ignore[no-any-return]
    except (LimitExceededError, CrashError) as error:
        raise PolicyError(f"{found.network}: {error}") from None


def draft_without_spec(file: Path) -> readers.IncompleteSpecError | None:
    """Return the known fields of a network's file without a description; None for other files."""
    if not file.is_file() or file.suffix.lower() not in (".onnx", *TORCHSCRIPT_SUFFIXES):
        return None
    return readers.IncompleteSpecError("a network without a description", {"network": file.absolute()})


def _normaliser(model: Path) -> tuple[Path | None, bool]:
    """Return the VecNormalize file of a model, and whether it lies where only this model's does.

    Stable-Baselines3's `CheckpointCallback` puts `PREFIX_vecnormalize_N_steps.pkl` next to `PREFIX_N_steps.zip`.
    `EvalCallback` has its own folder for `best_model.zip`; the statistics lie in the run's folder above it. RL Zoo puts
    them into the folder `ENV` next to `ENV.zip` and `best_model.zip`.

    Raises PolicyError where files near the model could be that of another one.
    """
    start, _, end = model.stem.rpartition("_steps")[0].rpartition("_")
    own = [f"{model.stem}_vecnormalize.pkl", f"{start}_vecnormalize_{end}_steps.pkl"]
    places = [model.parent / name for name in (*own, *STATISTICS_NAMES)]
    places += [model.with_suffix("") / name for name in STATISTICS_NAMES]
    if there := [place for place in places if place.is_file()]:
        return there[0], True
    others = _statistics_in(model.parent)
    near = [place for folder in _folders_in(model.parent) for place in _statistics_in(folder)]
    above = _statistics_in(model.parent.parent) if model.parent.name in BEST_MODEL_FOLDERS else []
    above += [
        place for name in STATISTICS_NAMES if (place := model.parent.parent / name).is_file() and place not in above
    ]
    found = near or above
    if not others and len(found) == 1:
        return found[0], False
    if not found and model.parent.name in BEST_MODEL_FOLDERS:  # those of the run's checkpoints
        found = [place for folder in _folders_in(model.parent.parent) for place in _statistics_in(folder)]
    if others or found:
        names = ", ".join(os.path.relpath(file, model.parent) for file in others or found)
        raise PolicyError(
            f"{model} may be trained on normalised observations: next to it is {names}; rename the one "
            f"that belongs to it to {own[0]}, or move the model into a folder of its own"
        )
    return None, True


def _statistics_in(folder: Path) -> list[Path]:
    """Return the files in a folder that may be a VecNormalize, whose `save` adds no ending to a name."""
    return sorted(
        file
        for file in folder.glob("*")
        if _STATISTICS_NAME.search(file.name.lower()) and file.suffix in ("", ".pkl", ".pickle") and file.is_file()
    )


def _folders_in(folder: Path) -> list[Path]:
    """Return the first folders in a folder, by name."""
    return sorted(each for each in itertools.islice(folder.iterdir(), MAX_FOLDERS) if each.is_dir())
