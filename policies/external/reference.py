"""Parser of references to external policies, such as `my_file.py:MyPolicy` or `policy.onnx`.

An external policy is an object in a user's Python file, a model of Stable-Baselines3, or a network of another project.
The parser checks all files of the policy and reads the specification (`PolicySpec`) of a network.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

from policies.base import PolicyError
from policies.external import readers
from policies.external.networks import TORCHSCRIPT_SUFFIXES, check_is_network, is_onnx
from policies.external.packages import check_package
from policies.external.readers.settings import WRITE_TOML
from policies.external.sb3_statistics import find_statistics
from policies.external.spec import PolicySpec
from quad_env.cli.limited_process import CrashError, LimitExceededError, call, read_limited
from quad_env.files.reading import MAX_TEXT_SIZE, check_file, max_network_size
from quad_env.files.text import brief

SPEC_SUFFIXES = ".onnx", ".pt", ".jit", ".toml", ".yaml", ".yml", ".json"
"""Suffixes of policy files for which `resolve_reference` looks for a specification (`PolicySpec`).

The specification is in the policy file itself, or for .pt and .jit files in a file next to it.
"""
SUFFIXES = ".py", ".zip", *SPEC_SUFFIXES
"""Suffixes of the supported files of external policies."""
SIDECAR_SUFFIXES = ".toml", ".yaml", ".json"
"""Suffixes of the specification file of a TorchScript network (.pt, .jit), in the order of the search.

The specification file has the same folder as the network and the same name but for the suffix.
"""
UNSUPPORTED_SUFFIXES = ".pth", ".ckpt", ".h5", ".pkl"
"""Suffixes of network files that are rejected with an error that proposes supported formats."""
_REQUIRED_PACKAGES = {".onnx": "onnx", ".yaml": "yaml", ".yml": "yaml"}
"""Suffix of a file -> name of the optional Python package that is needed to read the file."""


@dataclass(frozen=True)
class PolicyReference:
    """Files and specification of an external policy; `resolve_reference` makes it."""

    file: Path
    """Path of the policy's file: Python file, network, Stable-Baselines3 model, or specification file."""
    name: str = ""
    """Name of the class or object in a Python file that is the policy; empty for other kinds of files."""
    normaliser: Path | None = None
    """File with the observation statistics (VecNormalize) of a Stable-Baselines3 model, or None."""
    spec: PolicySpec | None = None
    """Specification of the policy's network; None if its input is the environment's own observation."""
    remarks: tuple[str, ...] = ()
    """Assumptions about the policy that its files do not confirm, one line each."""

    @property
    def suffix(self) -> str:
        """Suffix of the policy's file in lower case, for example `.onnx`."""
        return self.file.suffix.lower()

    @property
    def sha256(self) -> str:
        """SHA-256 digest of the contents of all files of the policy and of its specification, hexadecimal."""
        network = None if self.spec is None else self.spec.network
        files = [file for file in dict.fromkeys((self.file, self.normaliser, network)) if file is not None]
        spec_text = "" if self.spec is None else self.spec.digest_text
        digest = hashlib.sha256()
        for file in files:
            with file.open("rb") as stream:
                while part := stream.read(2**20):
                    digest.update(part)
        digest.update(spec_text.encode())
        return digest.hexdigest()

    def __str__(self) -> str:
        return f"{self.name} in {self.file}" if self.name else str(self.file)


def is_reference(text: str | Path) -> bool:
    """Return True if a text has the form of a reference to an external policy.

    The suffix of the file must be supported (SUFFIXES), for example `.onnx`, and the text must not be the path of a
    folder. The file may be missing.
    """
    return _parse_reference(text).suffix in SUFFIXES and not Path(text).is_dir()


def unsupported_file_remedy(text: str | Path) -> str | None:
    """Return an error text with a remedy if a file has an unsupported suffix, for example `.pth`, else None."""
    suffix = Path(text).suffix
    if suffix.lower() not in UNSUPPORTED_SUFFIXES:
        return None
    return (
        f"{text}: {suffix} files (checkpoints of other learners) are not supported; export the network as "
        ".onnx (torch.onnx.export) or TorchScript .pt, load it in a class of a Python file (my_file.py:MyPolicy), or "
        "give a .zip of Stable-Baselines3 (with --trust)"
    )


def _parse_reference(text: str | Path) -> PolicyReference:
    file, colon, name = str(text).rpartition(":")
    if colon and file.lower().endswith(".py"):
        return PolicyReference(Path(file), name)
    return PolicyReference(Path(text))


def resolve_reference(text: str | Path, trust: bool) -> PolicyReference:
    """Parse a reference to an external policy, check all files of the policy, and read its specification.

    Args:
        text: Path of a policy file, or `FILE.py:NAME` for a class or object in a Python file.
        trust: True to accept files in which code can be hidden, for example pickles.

    Returns:
        Reference with absolute paths, from which the subprocess of the policy loads the policy.

    Raises:
        PolicyError: A file is missing, unreadable, incomplete or not trusted; the message is one line.
    """
    if not str(text).isprintable():
        raise PolicyError(f"{brief(str(text))}: a policy's name must be printable")
    parsed = _parse_reference(text)
    _check_readable(parsed.file)
    if parsed.suffix == ".py" and not parsed.name:
        raise PolicyError(f"name the policy in {parsed.file} after a colon, as in {parsed.file}:MyPolicy")
    reference = replace(parsed, file=parsed.file.absolute())
    if reference.suffix in TORCHSCRIPT_SUFFIXES:
        check_is_network(parsed.file)
    if reference.suffix in SPEC_SUFFIXES:
        reference = replace(reference, spec=_find_spec(parsed.file))
    network = reference.file if reference.spec is None else reference.spec.network
    if network != reference.file:
        _check_readable(network)
    if reference.spec is not None:
        check_is_network(network)
    if reference.suffix == ".zip":
        return _with_statistics(reference, trust)
    if reference.suffix != ".py" and not is_onnx(network) and not trust:
        _raise_untrusted(network)
    return reference


def _with_statistics(model: PolicyReference, trust: bool) -> PolicyReference:
    """Return the reference to a Stable-Baselines3 model with the file of its observation statistics.

    The statistics (VecNormalize) are the mean and variance that normalise the model's observations. Raises
    PolicyError if `trust` is False, or if the statistics may belong to another model.
    """
    try:
        statistics, is_certain = find_statistics(model.file)
    except PolicyError:
        if trust:
            raise
        statistics = None
        is_certain = True
    if not trust:
        _raise_untrusted(*(file for file in (model.file, statistics) if file is not None))
    remark = f"its observations are normalised by {statistics}, the only statistics of its run"
    return replace(model, normaliser=statistics, remarks=() if is_certain else (remark,))


def _raise_untrusted(*files: Path) -> NoReturn:
    """Raise the PolicyError for files that can run hidden code, if the user did not give --trust."""
    names = " and ".join(map(str, files))
    them = "it" if len(files) == 1 else "them"
    origin = "it comes" if len(files) == 1 else "they come"
    raise PolicyError(
        f"loading {names} can run code that is hidden in {them}: give --trust if you know where {origin} from"
    )


def _check_readable(file: Path) -> None:
    """Raise PolicyError if the file is missing, cannot be read, or is too large."""
    if not file.is_file():
        raise PolicyError(f"there is no file {file}")
    try:
        check_file(file, MAX_TEXT_SIZE if file.suffix.lower() == ".py" else max_network_size())
    except OSError as error:
        raise PolicyError(f"cannot read {file} ({error.strerror})") from None


def _find_spec(file: Path) -> PolicySpec | None:
    """Return the specification of the policy in a network file or specification file.

    The specification of a TorchScript network is in a file next to the network, see SIDECAR_SUFFIXES. Returns None for
    an ONNX file that contains no specification. Raises PolicyError if a file has a fault, or if a TorchScript network
    has no specification.
    """
    if file.suffix.lower() not in TORCHSCRIPT_SUFFIXES:
        spec = _read_spec(file)
        return None if spec is None else replace(spec, network=spec.network.absolute())
    sidecars = [sidecar for suffix in SIDECAR_SUFFIXES if (sidecar := file.with_suffix(suffix)).is_file()]
    spec = _read_spec(sidecars[0]) if sidecars else None
    if spec is None:
        name = file.with_suffix(SIDECAR_SUFFIXES[0]).name
        fault = f"{file} does not say how its network is run"
        remedy = f"{WRITE_TOML} next to it as {name}"
        raise readers.IncompleteSpecError("a network", {"network": file.absolute()}, fault=fault, remedy=remedy)
    return _check_network(replace(spec, network=file.absolute()))


def _read_spec(file: Path) -> PolicySpec | None:
    """Read the specification that a file contains, in a subprocess with limits on time and memory.

    The limits are needed because users may give files that are slow or large to parse. Returns None if the file
    contains no specification. Raises PolicyError if the file has a fault, or if the subprocess exceeds a limit.
    """
    package = _REQUIRED_PACKAGES.get(file.suffix.lower())
    if package is not None:
        check_package(package)
    try:
        return read_limited(readers.read, file)  # type: ignore[no-any-return]
    except (LimitExceededError, CrashError) as error:
        raise PolicyError(f"{file}: {error}") from None


def _check_network(spec: PolicySpec) -> PolicySpec:
    """Check a user's specification against its network, in a subprocess with limits on time and memory.

    Returns the same specification. Raises PolicyError if network and specification contradict each other, or if the
    subprocess exceeds a limit.
    """
    try:
        return call(readers.check_network_matches, spec, True)  # type: ignore[no-any-return]
    except (LimitExceededError, CrashError) as error:
        raise PolicyError(f"{spec.network}: {error}") from None


def draft_without_spec(file: Path) -> readers.IncompleteSpecError | None:
    """Return the error for a network file without a specification, from which a draft can be written.

    A draft is an incomplete specification file that the user completes. The only field that the error knows is the path
    of the network. Returns None if the file is missing or has no suffix of a network.
    """
    if not file.is_file() or file.suffix.lower() not in (".onnx", *TORCHSCRIPT_SUFFIXES):
        return None
    return readers.IncompleteSpecError("a network without a description", {"network": file.absolute()})
