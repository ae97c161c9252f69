"""Digests of the descriptions of trained policies: `python -m research seal FOLDER…` adds them.

The description is the file `policy.json` in the folder of the policy. The digest is the SHA-256 hash of all other
fields of the file; older files have no digest. `policies.load` refuses a file with a digest if its content was changed
later.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from policies import bundle
from policies.description import DIGEST, description_digest
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.writing import write_atomically


@dataclass(frozen=True)
class SealOptions:
    """Options of the command `seal`: folders of the trained policies."""

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of the trained policies that get a digest, for example models/residual."""


def main(options: SealOptions) -> int:
    """Run the command `seal`: write the digest (hash) into each policy's description, and print it.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.
    """
    for folder in options.folders:
        print(f"{folder}: {seal(folder)}")
    return 0


def seal(folder: Path) -> str:
    """Add a digest (SHA-256 hash of all other fields) to policy.json, a trained policy's description.

    Args:
        folder: Folder of the trained policy.

    Returns:
        The digest.

    Raises:
        UsageError: The description is missing, or it already has a digest that does not match its content.
    """
    file = folder / bundle.DESCRIPTION
    if not file.is_file():
        raise UsageError(f"FOLDER: {folder} has no {bundle.DESCRIPTION}")
    description = parse_json(read_bytes(file))
    digest = description_digest(description)
    if description.setdefault(DIGEST, digest) != digest:
        raise UsageError(f"FOLDER: {file} is not as it was written ({DIGEST} differs)")
    write_atomically(file, (json.dumps(description, indent=2, allow_nan=False) + "\n").encode())
    return digest
