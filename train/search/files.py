"""Files of a search: checked before it starts, and not lost where they cannot be written."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from quad_env.cli.command_line import UsageError
from quad_env.files.writing import make_writable_folder, write_atomically


def check(out: Path, account: str = "") -> None:
    """Raise UsageError, one line, where no parameters can be written, with their account, if any, next to them."""
    if out.is_dir() or out.name == account:
        reserved = f", and not {account}, which the account goes to" if account else ""
        raise UsageError(f"--out must be a file{reserved}; got {out}")
    if not out.parent.is_dir():
        raise UsageError(f"no folder {out.parent}; make it, or choose another --out")
    try:
        make_writable_folder(out.parent)
    except OSError as error:
        raise UsageError(f"cannot write into {out.parent} ({error.strerror}); choose another --out") from None


def as_json(parameters: Any) -> str:
    """The parameters as the text of a file."""
    return json.dumps(asdict(parameters), indent=2) + "\n"


def save(path: Path, text: str, *, show: bool = False) -> None:
    """Write the text, and print it where asked for or where it would be lost. Raises UsageError where it cannot be."""
    problem = ""
    try:
        write_atomically(path, text.encode())
    except OSError as error:
        problem = f"cannot write {path} ({error.strerror or error}): its contents are on standard output"
    if show or problem:
        print(text, flush=True)
    if problem:
        raise UsageError(problem)
