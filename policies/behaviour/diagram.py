"""The diagram of the behaviours, drawn from the transition table: `python -m policies.behaviour.diagram`.

It writes docs/behaviour.md: a Mermaid state diagram, which code hosts draw, and the table in words.
"""

import sys
from pathlib import Path

from policies.behaviour.transitions import TIME_LIMIT, TRANSITIONS, State, Transition
from quad_env.files.writing import write_atomically

FILE = Path(__file__).resolve().parents[2] / "docs" / "behaviour.md"
ANYWHERE = 3
"""A transition from more states than this is drawn once, from a box of its own."""


def diagram() -> str:
    """The whole page."""
    return "\n".join(
        (
            "# Behaviours",
            "",
            "Made by `python -m policies.behaviour.diagram` from `policies/behaviour/transitions.py`.",
            "",
            "```mermaid",
            "stateDiagram-v2",
            *(f"    {state.label}" for state in State),
            *(line for number, row in enumerate(TRANSITIONS) for line in _arrows(number, row)),
            "```",
            "",
            "| from | request | if | to | reason in the log |",
            "|---|---|---|---|---|",
            *(_table_row(row) for row in TRANSITIONS),
            "",
            "A state is `late` after: " + ", ".join(f"{s.label} {limit:g} s" for s, limit in TIME_LIMIT.items()) + ".",
            "",
        )
    )


def _label(row: Transition) -> str:
    return f"{row.request} [{row.guard}]" if row.request and row.guard else row.request or f"[{row.guard}]"


def _arrows(number: int, row: Transition) -> list[str]:
    if len(row.sources) <= ANYWHERE:
        return [f"    {source.label} --> {row.target.label}: {_label(row)}" for source in row.sources]
    box = f"from_{number}"
    name = "any state" if len(row.sources) == len(State) else ", ".join(source.label for source in row.sources)
    return [f'    state "{name}" as {box}', f"    {box} --> {row.target.label}: {_label(row)}"]


def _table_row(row: Transition) -> str:
    sources = "any" if len(row.sources) == len(State) else ", ".join(source.label for source in row.sources)
    return f"| {sources} | {row.request} | {row.guard} | {row.target.label} | {row.reason} |"


def main() -> int:
    """Write the page; the exit code."""
    try:
        FILE.parent.mkdir(exist_ok=True)
        write_atomically(FILE, diagram().encode())
    except OSError as error:
        print(f"error: cannot write {FILE} ({error.strerror})", file=sys.stderr)
        return 2
    print(FILE)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
