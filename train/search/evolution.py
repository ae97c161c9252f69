"""A search of parameters by CMA-ES, over the unit cube of their ranges, and the rows of its account."""

import contextlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.progress import track

from evaluate.measures.metrics import Measures
from evaluate.rollouts.cluster import Report, cluster
from evaluate.rollouts.workers import WorkerLost
from policies.base import Floats
from policies.parameters import Parameters, number
from quad_env.cli.launcher import raise_on_interrupt
from quad_env.seeding import episode_seeds

Ranges = Mapping[str, tuple[float, float]]
"""Bounds of the parameters that are searched, by field name."""
MARGIN = 0.02
"""Distance from the faces of the unit cube at which a search starts at least."""


P = TypeVar("P", bound=Parameters)
Costs = Callable[[list[Floats], int], Sequence[float] | Floats]
"""Judges the points of a generation, by its number; each as if it were the only one."""


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How thoroughly a search is done: rounds, and parameter sets tried in each."""

    generations: int
    candidates: int
    seed: int = number(0, limits=(0, 2**31))
    """Seed of the search."""
    threads: int = number(2, limits=(1, 256))
    """Threads of the simulation; with --engine ray, workers of a cluster that is begun here."""
    engine: Literal["local", "ray"] = "local"
    """What judges the candidates: this process, or a Ray cluster (pip install -e ".[cluster]"), a task each. The
    outcome is the same."""
    address: str | None = None
    """Address of the Ray cluster, such as 10.0.0.1:6379; without it one is begun here and ended with the search."""

    @property
    def batch_threads(self) -> int:
        """Threads on which candidates are simulated side by side; a task of a cluster has one core."""
        return self.threads if self.engine == "local" else 1


@dataclass(frozen=True, kw_only=True)
class EpisodeEffort(Effort):
    """That of a search on drawn episodes: how many, new in each round, and how many control steps long."""

    episodes: int
    steps: int


def decode(point: Floats, start: P, ranges: Ranges, digits: int | None = None) -> P:
    """Parameters of a point of the unit cube, rounded where digits are given; those not searched are the start's."""
    values = {name: low + (high - low) * float(x) for x, (name, (low, high)) in zip(point, ranges.items(), strict=True)}
    return replace(start, **(values if digits is None else {name: round(x, digits) for name, x in values.items()}))


def encode(parameters: Parameters, ranges: Ranges) -> Floats:
    """Point of the unit cube of some parameters."""
    return np.array([(getattr(parameters, name) - low) / (high - low) for name, (low, high) in ranges.items()])


def rounded(parameters: P) -> P:
    """The parameters to four digits."""
    return replace(parameters, **{name: round(float(value), 4) for name, value in asdict(parameters).items()})


def evolve(
    effort: EpisodeEffort,
    start: P,
    ranges: Ranges,
    costs: Callable[[list[P], NDArray[np.int64]], Sequence[float] | Floats],
    *,
    spread: float,
    digits: int | None = None,
    description: str = "generations",
    **settings: Any,
) -> Iterator[P]:
    """The mean of the search distribution after each generation.

    `costs` judges a generation's candidates, all on the episodes of its seeds; `spread` is the first standard deviation
    of a parameter, as a share of its range; `settings` are those of `minimise`.
    """
    seeds = np.split(episode_seeds("search", effort.seed, effort.generations * effort.episodes), effort.generations)

    def judged(points: list[Floats], generation: int) -> Sequence[float] | Floats:
        return costs([decode(point, start, ranges, digits) for point in points], seeds[generation])

    point = np.clip(encode(start, ranges), MARGIN, 1.0 - MARGIN)
    for mean in minimise(effort, point, (0, 1), judged, spread=spread, description=description, **settings):
        yield decode(mean, start, ranges, digits)


def minimise(
    effort: Effort,
    start: Floats,
    bounds: tuple[ArrayLike, ArrayLike],
    costs: Costs,
    *,
    spread: float,
    description: str = "generations",
    **settings: Any,
) -> Iterator[Floats]:
    """The mean of CMA-ES's distribution after each generation; `settings` are further ones of the strategy."""
    import cma

    strategy = cma.CMAEvolutionStrategy(
        start,
        spread,
        {"bounds": list(bounds), "popsize": effort.candidates, "seed": effort.seed + 1, "verbose": -9, **settings},
    )
    with _where(effort, costs) as judged:
        for generation in track(range(effort.generations), description=description):
            points = strategy.ask()
            found = judged(points, generation)
            strategy.tell(points, list(found))
            print(f"best {min(found):.3f}  median {np.median(found):.3f}", flush=True)
            yield strategy.result.xfavorite


@contextlib.contextmanager
def _where(effort: Effort, costs: Costs) -> Iterator[Costs]:
    """Context in which the engine gives those costs."""
    if effort.engine == "local":
        yield costs
        return
    with cluster(effort.threads, effort.address) as spread:

        def apart(points: list[Floats], generation: int) -> list[float]:
            def judge(point: Floats, _: Report) -> float:
                return float(costs([point], generation)[0])

            found = dict(spread(judge, points))
            return [found[place] for place in range(len(points))]

        yield apart


def last(generations: Iterator[P], keep: Callable[[P], None]) -> P:
    """The outcome of the last generation; after Ctrl-C, or if the cluster is lost, that of the last one done is kept.

    Raises KeyboardInterrupt or WorkerLost with what was done.
    """
    raise_on_interrupt()
    found: list[P] = []
    try:
        found.extend(generations)
    except (KeyboardInterrupt, WorkerLost) as end:
        if not found:
            raise
        keep(found[-1])
        said = "".join(f"{each}; " for each in end.args)
        raise type(end)(f"{said}kept what was found after {len(found)} generations, not judged") from None
    return found[-1]


def changes(before: Parameters, after: Parameters, ranges: Ranges, fitted: Collection[str] = ()) -> list[str]:
    """Every parameter's range and values, as a table in Markdown."""
    lines = ["| parameter | range | before | after |", "|---|---|---|---|"]
    for name, old in asdict(before).items():
        low_high = ranges.get(name)
        span = f"{low_high[0]:g} … {low_high[1]:g}" if low_high else "fitted" if name in fitted else "fixed"
        lines.append(f"| {name} | {span} | {old:.9g} | {getattr(after, name):.9g} |")
    return lines


def judged(kind: str, rows: Iterable[tuple[str, str, Measures]]) -> list[str]:
    """What parameters are worth on episodes of some `kind`, (its name, whose parameters, measures) each, likewise."""
    lines = [
        f"| {kind} | parameters | succeeded | stalled | falls | velocity error, m/s | mean velocity error, m/s "
        "| yaw-rate error, rad/s |",
        "|---" * 8 + "|",
    ]
    for name, label, found in rows:
        errors = (found.velocity_error, found.mean_velocity_error, found.yaw_rate_error)
        counts = " | ".join(f"{int(each.sum())}/{len(each)}" for each in (found.succeeded, found.stalled, found.fell))
        figures = " | ".join(f"{value.mean():.3f}" for value in errors)
        lines.append(f"| {name} | {label} | {counts} | {figures} |")
    return lines
