"""Drafts: a TOML with the known fields of an incomplete policy, and the rest as comments to fill in."""

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
"""Fields that every specification has, with an example of each, as TOML."""
WRITE_DRAFT = "python -m quad_env doctor --policy FILE --write mine.toml writes the rest of it, to complete"
HEADER = "# What a policy reads and commands, as far as its files say it: docs/deployment-files.md"


class IncompleteSpecError(PolicyError):
    """Raised for a file of a known kind without a complete policy.

    Args:
        kind: Kind of the file, a noun phrase.
        known: Fields of a `PolicySpec` that it gives.
        advice: Facts on the missing fields, a line each.
        fault: Error text instead of the kind and the missing fields.
        remedy: Remedy instead of a draft.
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
        """Return the arguments of the same error with the path of the file."""
        remedy = self.remedy.replace("FILE", str(path))
        return self.kind, self.known, self.advice, f"{path}: {self.fault}", remedy

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the arguments for pickle: files are read in a limited process."""
        return IncompleteSpecError, (self.kind, self.known, self.advice, self.fault, self.remedy)


def write_draft(incomplete: IncompleteSpecError, file: Path) -> None:
    """Write the known fields as TOML, and the rest as comments.

    Args:
        incomplete: Known fields and advice. The network is written relative to the file's folder.
        file: TOML to write.
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
