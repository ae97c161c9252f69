"""Drafts of incomplete specifications: TOML with comments in place of the missing fields."""

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
"""Name of each required field of a specification -> example of its value as TOML."""
WRITE_DRAFT = "python -m quad_env doctor --policy FILE --write mine.toml writes the rest of it, to complete"
HEADER = "# What a policy reads and commands, as far as its files say it: docs/deployment-files.md"


class IncompleteSpecError(PolicyError):
    """Raised if the format of a file is known but the file lacks fields of the specification.

    Args:
        kind: Kind of the file, a noun phrase.
        known: Known fields of the `PolicySpec`: name -> value.
        advice: Facts about the missing fields, one line each.
        fault: Error text; empty: the text gives the kind and the missing fields.
        remedy: Remedy; empty: the remedy is to write a draft.
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
        """Return the constructor arguments of the same error, with the path of the file in fault and remedy."""
        remedy = self.remedy.replace("FILE", str(path))
        return self.kind, self.known, self.advice, f"{path}: {self.fault}", remedy

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the class and its arguments for pickle, because a subprocess sends this error."""
        return IncompleteSpecError, (self.kind, self.known, self.advice, self.fault, self.remedy)


def write_draft(incomplete: IncompleteSpecError, file: Path) -> None:
    """Write the known fields as TOML, and a comment with an example for each missing field.

    The path of the network is written relative to the folder of `file`.

    Args:
        incomplete: Error with the known fields and the advice.
        file: TOML file to write.
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
