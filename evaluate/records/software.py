"""Software of this process on which results depend, for the comparison with workers on other machines."""

from collections.abc import Sequence
from importlib import metadata

from evaluate.records.manifest import NOT_COMPARED
from evaluate.records.provenance import SOURCES, code_digest, cpu_model, versions

CODE_LENGTH = 16
"""Number of characters of the hash of the code that error messages show."""


def software_versions(packages: Sequence[str] = (), sources: Sequence[str] = ()) -> dict[str, str]:
    """Return the versions of the software on which the results of this process depend.

    Args:
        packages: Names of further installed packages.
        sources: Names of further packages of this project with code that is compared too.

    Returns:
        Name -> version. `code` is the hash of this project's code, and `processor` the name of the processor.
    """
    own = {name: str(version) for name, version in versions().items() if name not in NOT_COMPARED}
    others = {name: metadata.version(name) for name in packages}
    return {**own, **others, "code": code_digest((*SOURCES, *sources))[:CODE_LENGTH], "processor": cpu_model()}
