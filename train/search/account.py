"""The account of a search, in Markdown: how it was made, what it changed, and the measures before and after."""

from collections.abc import Collection, Iterable
from dataclasses import asdict

from evaluate.measures.metrics import Measures
from policies.base import CONTROL_PERIOD
from policies.parameters import Parameters
from train.search.subject import Effort, Options, Ranges


def method(options: Options, effort: Effort, scenarios: str) -> str:
    """How the search was made."""
    return (
        f"Written by `{options.command}`: CMA-ES, {effort.generations} generations of {effort.candidates} candidates, "
        f"{effort.episodes} episodes of {effort.steps * CONTROL_PERIOD:g} s a candidate on each of {scenarios}."
    )


def changes(before: Parameters, after: Parameters, ranges: Ranges, fitted: Collection[str] = ()) -> list[str]:
    """Range and values of every parameter, as a table."""
    lines = ["| parameter | range | before | after |", "|---|---|---|---|"]
    for name, old in asdict(before).items():
        low_high = ranges.get(name)
        span = f"{low_high[0]:g} … {low_high[1]:g}" if low_high else "fitted" if name in fitted else "fixed"
        lines.append(f"| {name} | {span} | {old:.9g} | {getattr(after, name):.9g} |")
    return lines


def results(rows: Iterable[tuple[str, str, Measures]]) -> list[str]:
    """Measures on each scenario with the parameters before and after, (scenario, which, measures) each, as a table."""
    lines = [
        "| scenario | parameters | succeeded | stalled | falls | velocity error, m/s | mean velocity error, m/s "
        "| yaw-rate error, rad/s |",
        "|---" * 8 + "|",
    ]
    for name, label, found in rows:
        errors = (found.velocity_error, found.mean_velocity_error, found.yaw_rate_error)
        counts = " | ".join(f"{int(each.sum())}/{len(each)}" for each in (found.succeeded, found.stalled, found.fell))
        figures = " | ".join(f"{value.mean():.3f}" for value in errors)
        lines.append(f"| {name} | {label} | {counts} | {figures} |")
    return lines
