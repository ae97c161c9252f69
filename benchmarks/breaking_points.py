"""`python -m benchmarks.breaking_points`: breaking points from four sets of levels, beside those of a dense reference.

The sets: the levels of an axis, every other of them, the middles between them, and the first, middle and last of them;
each as it is and with others placed after it, as `python -m evaluate axes --sequential` places them. All have the same
episodes, the reference has others: levels evenly over ln(severity) where the first set leaves one half open. A set
agrees where its intervals hold the figures of the other sets of its kind, placed or not, and those of the reference. No
figure depends on the machine.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from benchmarks.support.command import Outcome, Output, command, table
from evaluate.analysis.breaking_point_text import breaking_point_text
from evaluate.analysis.breaking_points import AxisBreakingPoint, breaking_points, grid, wanted
from evaluate.commands.plan import policies_asked_for
from evaluate.rollouts.experiment import Cell, LabelledPolicy, Settings, evaluation_seeds, run_cells
from evaluate.rollouts.hardware import IDEAL
from evaluate.rollouts.workers import process_pool
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.cores import available_cores
from quad_env.cli.launcher import launch
from quad_env.scenarios.axes import AXES, Axis

REFERENCE, PLACED = "reference", ", placed"


@dataclass(frozen=True)
class Options(Output):
    """Which axes and policies, and how thoroughly."""

    axes: tuple[str, ...] = ("push", "rough", "slope")
    """Names of axes."""
    policies: tuple[str, ...] = ("trot", "residual")
    """Names of policies, or folders of trained ones."""
    episodes: int = 128
    """Episodes at each level of a set (count)."""
    dense: int = 12
    """Levels of the reference (count)."""
    dense_episodes: int = 512
    """Episodes at each of them (count)."""


def measure(options: Options) -> Outcome:
    """A table for each axis; its last column says whether the intervals agree."""
    check_numbers(options, {"dense": (3, 1000), "dense_episodes": (1, 10**6)})
    if unknown := [name for name in options.axes if name not in AXES]:
        raise UsageError(f"there is no axis {', '.join(unknown)}; the axes are {', '.join(AXES)}")
    if options.quick:
        options = replace(options, axes=options.axes[:1], policies=("stand",), episodes=2, dense=3, dense_episodes=2)
    policies = policies_asked_for(options.policies, (), IDEAL)
    rows = table("Breaking points by sets of levels", "", "levels", "success breaks at", "falls break at", "agrees")
    figures: dict[str, dict[str, object]] = {}
    for axis, policy in ((AXES[name], policy) for name in options.axes for policy in policies):
        found = dict(_sets(axis, policy, options))
        rows.add_section()
        for name, (levels, points) in found.items():
            words = (breaking_point_text(point) for point in reversed(points))
            others = [each for other, (_, each) in found.items() if other == REFERENCE or _kind(other) == _kind(name)]
            agrees = "" if name == REFERENCE else "yes" if agreeing(points, others) else "no"
            rows.add_row(f"{axis.name}, {policy.label}: {name}", str(levels), *words, agrees)
        figures[f"{axis.name}, {policy.label}"] = {name: points for name, (_, points) in found.items()}
    return Outcome(figures, (rows,))


def agreeing(points: Sequence[AxisBreakingPoint], others: Sequence[Sequence[AxisBreakingPoint]]) -> bool:
    """Whether the interval of each point, of falls and of success, holds the figures of all other sets."""
    columns = zip(points, zip(*others, strict=True), strict=True)
    figures = ((point, other.severity50) for point, column in columns for other in column if other.found == "crossed")
    return all(point.ci[0] <= figure <= point.ci[1] for point, figure in figures)


def _kind(name: str) -> bool:
    """Whether levels were placed in the set of that name."""
    return name.endswith(PLACED)


def _sets(
    axis: Axis, policy: LabelledPolicy, options: Options
) -> Iterator[tuple[str, tuple[int, list[AxisBreakingPoint]]]]:
    """Each set's name, and how many levels and which breaking points it has."""
    seeds, ran = evaluation_seeds(1, options.episodes), dict[float, Cell]()

    def cells(severities: Sequence[float]) -> list[Cell]:
        ran.update((cell.scenario.severity, cell) for cell in _cells(axis, policy, set(severities) - set(ran), seeds))
        return [ran[severity] for severity in severities]

    for name, severities in _starts(axis).items():
        placed = cells(severities)
        yield name, _found(placed)
        while more := wanted(placed, grid(axis), most=1000):
            placed += cells(more)
        yield name + PLACED, _found(placed)
    ends = [np.clip(point.ci, min(axis.levels), max(axis.levels)) for point in _found(cells(axis.levels))[1]]
    dense = [float(each) for each in np.geomspace(np.min(ends), np.max(ends), options.dense)]
    yield REFERENCE, _found(_cells(axis, policy, dense, evaluation_seeds(0, options.dense_episodes)))


def _starts(axis: Axis) -> dict[str, Sequence[float]]:
    """Severities by the name of their set."""
    levels, between = axis.levels, grid(axis)
    middles = [(between.index(milder) + between.index(harder)) // 2 for milder, harder in pairwise(levels)]
    return {
        "levels": levels,
        "every other": levels[::2],
        "middles": [between[middle] for middle in middles],
        "three": (levels[0], levels[len(levels) // 2], levels[-1]),
    }


def _found(cells: Sequence[Cell]) -> tuple[int, list[AxisBreakingPoint]]:
    return len(cells), breaking_points(cells)[0]


def _cells(axis: Axis, policy: LabelledPolicy, severities: Iterable[float], seeds: np.ndarray) -> list[Cell]:
    cores = available_cores()
    settings = Settings(cores, lambda *_: None, chunk_size=-(-len(seeds) // cores), executor=process_pool(cores))
    scenarios = [axis.scenario(severity, f"{axis.name}={severity!r}") for severity in severities]
    cells = run_cells([policy], scenarios, seeds, settings)  # as they are finished
    return sorted(cells, key=lambda cell: scenarios.index(cell.scenario))


main = command(Options, measure, "benchmarks.breaking_points", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
