"""What the checks have found, as lines for a terminal and as JSON."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict

from quad_env.doctor.check import Entry

SCHEMA = 1
NO_CLONE = "walking and policies not looked at: they come with a clone of the project"


def lines(entry: Entry) -> Iterator[str]:
    """A line of what was seen, and two more where something is to be done."""
    found = entry.finding
    yield f"{found.result:9} {entry.name:9} {found.seen}"
    if found.remedy:
        yield f"{'':20}cause:  {found.cause}"
        yield f"{'':20}remedy: {found.remedy}"


def summary(entries: Sequence[Entry], *, clone: bool) -> str:
    """How many of each kind, in a line; without a clone what nobody has looked at."""
    counts = Counter(entry.finding.result for entry in entries)
    told = [f"{counts[kind]} {kind}" for kind in ("ok", "left out") if counts[kind]]
    for kind in ("problem", "warning"):
        if counts[kind]:
            told.insert(0, f"{counts[kind]} {kind}{'s' if counts[kind] > 1 else ''}")
    return ", ".join(told) + ("" if clone else f"; {NO_CLONE}")


def as_json(entries: Sequence[Entry], *, clone: bool) -> str:
    """The same as JSON."""
    checks = [{"name": entry.name, **asdict(entry.finding), "seconds": round(entry.seconds, 3)} for entry in entries]
    told = {"schema": SCHEMA, "policies_examined": clone, "problems": problems(entries), "checks": checks}
    return json.dumps(told, indent=2, ensure_ascii=False)


def problems(entries: Sequence[Entry]) -> int:
    """How many problems there are."""
    return sum(entry.finding.result == "problem" for entry in entries)
