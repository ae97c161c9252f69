"""Drafts of specifications: TOML files with the known fields, and comments for the missing fields.

A user completes a draft if the files of an external policy do not contain its complete specification.
"""

import os
from pathlib import Path
from typing import Any

from policies.base import PolicyError
from policies.external.readers.toml_file import as_toml

EXAMPLES = {
    "network": '"policy.onnx"',
    "control_rate": "50",
    "joints": '["FL", "FR", "RL", "RR"]',
    "default_position": "{ hip = 0, thigh = 0.8, calf = -1.5 }",
    "action_scale": "0.25",
    "stiffness": "20",
    "damping": "0.5",
    "terms": '["linear_velocity", "angular_velocity", "projected_gravity", "command", "joint_position", '
    '"joint_velocity", "previous_action"]',
}
"""Required field of a specification -> example of its value in TOML, for the comments in a draft."""
WRITE_DRAFT = "python -m quad_env doctor --policy FILE --write mine.toml writes the rest of it, to complete"
"""Remedy in the errors about incomplete specifications: the command that writes a draft."""
HEADER = "# What a policy reads and commands, as far as its files say it: docs/deployment-files.md"
"""First line of a draft, a TOML comment."""


class IncompleteSpecError(PolicyError):
    """Raised if the format of a file is known but the file lacks required fields of the specification.

    Args:
        kind: Kind of the file as a noun phrase, such as `a network`.
        known: Known fields of the `PolicySpec`: field name -> value.
        advice: Facts that help a user to write the missing fields, one line each.
        fault: Error text; empty: the text gives the kind of the file and the names of the missing fields.
        remedy: Text of the remedy; empty: the remedy proposes to write a draft (`write_draft`) and to complete it.
    """

    def __init__(
        self,
        kind: str,
        known: dict[str, Any],
        advice: tuple[str, ...] = (),
        fault: str = "",
        remedy: str = "",
    ) -> None:
        self.kind = kind
        self.known = known
        self.advice = advice
        self.missing = tuple(name for name in EXAMPLES if name not in known)
        missing = ", ".join(f"`{name}`" for name in self.missing)
        super().__init__(fault or f"it is {kind}, which does not say {missing}", remedy or WRITE_DRAFT)

    def arguments_at(self, path: Path) -> tuple[str, dict[str, Any], tuple[str, ...], str, str]:
        """Return the constructor arguments of this error, with the path of the file in the texts.

        The error text starts with the path, and the word `FILE` in the remedy is replaced by the path.
        """
        remedy = self.remedy.replace("FILE", str(path))
        return self.kind, self.known, self.advice, f"{path}: {self.fault}", remedy

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the class and its constructor arguments for pickle, because a subprocess sends this error."""
        return IncompleteSpecError, (self.kind, self.known, self.advice, self.fault, self.remedy)


def write_draft(incomplete: IncompleteSpecError, file: Path) -> None:
    """Write a draft of a specification: known fields as TOML, missing fields as comments with examples.

    The path of the network is written relative to the folder of `file`.

    Args:
        incomplete: Error with the known fields of the specification and the advice for the missing ones.
        file: Path of the TOML file that is written.
    """
    lines = [HEADER]
    lines += [f"# {advice}" for advice in incomplete.advice]
    for name, example in EXAMPLES.items():
        if name not in incomplete.known:
            lines.append(f"# {name} = {example}")
            continue
        value = incomplete.known[name]
        if isinstance(value, Path):
            value = Path(os.path.relpath(value, file.absolute().parent)).as_posix()
        lines.append(f"{name} = {as_toml(name, value)}")
    others = [(name, value) for name, value in incomplete.known.items() if name not in EXAMPLES]
    lines += [f"{name} = {as_toml(name, value)}" for name, value in others]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
