"""CMA-ES over the space of a subject, in this process or on a cluster."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np
from rich.progress import track

from evaluate.rollouts.cluster import Report, cluster
from train.search.subject import Effort, Options, Seeds, Space

T = TypeVar("T")


def evolve(options: Options, effort: Effort, space: Space[T]) -> Iterator[tuple[T, list[dict[str, Any]]]]:
    """After each generation the mean of the search distribution, and its candidates with their costs."""
    import cma

    settings = {"popsize": effort.candidates, "seed": options.seed + 1, "verbose": -9}
    settings |= {"bounds": [space.low, space.high]} | ({"CMA_diagonal": True} if space.apart else {})
    strategy = cma.CMAEvolutionStrategy(space.start, effort.spread, settings)
    with _where(options, space) as costs:
        for seeds in track(space.seeds, description="generations"):
            points = strategy.ask()
            candidates = [space.decode(point) for point in points]
            found = costs(candidates, seeds)
            strategy.tell(points, list(found))
            print(f"best {min(found):.3f}  median {np.median(found):.3f}", flush=True)
            tried = [{"cost": float(cost)} | asdict(each) for cost, each in zip(found, candidates, strict=True)]  # type: ignore[call-overload]
            yield space.decode(np.clip(strategy.result.xfavorite, space.low, space.high)), tried


@contextlib.contextmanager
def _where(options: Options, space: Space[T]) -> Iterator[Any]:
    """Context in which the engine gives the costs of candidates on the episodes of some seeds."""
    if options.engine == "local":
        yield space.costs
        return
    with cluster(options.threads, options.address) as spread:

        def apart(candidates: Sequence[T], seeds: Seeds) -> list[float]:
            def cost(candidate: T, _: Report) -> float:
                return float(space.costs([candidate], seeds)[0])

            found: dict[int, float] = dict(spread(cost, candidates))
            return [found[place] for place in range(len(candidates))]

        yield apart
