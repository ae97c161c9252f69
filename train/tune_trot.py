"""`python -m train.tune_trot`: search the trot's parameters, so that the baseline is no straw man.

Cross-entropy method over `policies.trot.SEARCH_RANGES`: a generation of candidates is drawn from a normal distribution,
walks side by side in one batch on the same episodes, and the best quarter sets the next distribution. After the search
a least-squares fit of achieved against asked velocity sets the command map. All on seeds of the "search" family.

The cost of a candidate, m/s, averaged over flat and rough ground: velocity error + 0.5 m/rad × yaw-rate error + 1 m/s ×
fall rate; the errors, too, bill what comes after a fall the metrics' caps.
"""

import dataclasses
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluate.command_line import UsageError, fail, parse
from evaluate.metrics import Measures, measure
from evaluate.rollout import run
from policies.base import Actions, Policy
from policies.trot import SEARCH_RANGES, Trot, TrotParameters
from quad_env.seeding import episode_seeds
from train.scenarios import practice

Floats = NDArray[np.float64]

PROGRAM = "python -m train.tune_trot"
GROUNDS = ("flat", "rough")
"""Scenarios of the search."""
YAW_WEIGHT, FALL_WEIGHT = 0.5, 1.0
MAP = ("forward_gain", "forward_bias", "lateral_gain", "yaw_gain", "yaw_per_lateral")
"""Parameters of the command map."""


@dataclasses.dataclass(frozen=True)
class Options:
    """Options of the search."""

    generations: int = 15
    """Generations of candidates."""
    population: int = 20
    """Candidates a generation."""
    episodes: int = 24
    """Episodes of a candidate on each ground."""
    steps: int = 600
    """Length of an episode of the search, control steps of 10 ms."""
    spread: float = 0.2
    """Standard deviation of the first generation, as a share of each range."""
    final_episodes: int = 256
    """Episodes of 10 s on each ground that the finalists and the fitted map are judged on."""
    seed: int = 0
    """Seed of the candidates and of the episodes."""
    threads: int = 2
    """Threads of the simulation."""
    out: Path = Path("runs/trot-search.json")
    """Result of the search."""
    summary: Path = Path("policies/TROT.md")
    """Summary for readers, in Markdown."""


class SideBySide(Policy):
    """Several policies in one batch, each with the same number of rows, in order."""

    name = "side by side"

    def __init__(self, candidates: Sequence[Policy]) -> None:
        super().__init__()
        self._candidates = tuple(candidates)

    def _allocate(self, num_envs: int) -> None:
        for candidate in self._candidates:
            candidate.reset(num_envs // len(self._candidates))

    def _restart(self, mask: NDArray[np.bool_]) -> None:
        for candidate, part in zip(self._candidates, np.split(mask, len(self._candidates)), strict=True):
            candidate.reset_where(part)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        parts = np.split(observation, len(self._candidates))
        return np.concatenate([c.act(part) for c, part in zip(self._candidates, parts, strict=True)])


@dataclasses.dataclass(frozen=True)
class Verdict:
    """Mean metrics of one candidate on one ground."""

    fall_rate: float
    velocity_error: float
    mean_velocity_error: float
    yaw_rate_error: float

    @property
    def cost(self) -> float:
        """What the search makes least of, m/s."""
        return self.velocity_error + YAW_WEIGHT * self.yaw_rate_error + FALL_WEIGHT * self.fall_rate


Verdicts = list[dict[str, Verdict]]
"""Of each candidate, ground -> verdict."""


def judge(candidates: Sequence[TrotParameters], seeds: NDArray[np.int64], steps: int, threads: int) -> Verdicts:
    """Every candidate on the same episodes of each ground."""
    group = SideBySide([Trot(parameters) for parameters in candidates])
    verdicts: Verdicts = [{} for _ in candidates]
    for ground in GROUNDS:
        everyone = np.tile(seeds, len(candidates))
        measures = measure(run(group, practice(ground, "search"), everyone, nthread=threads, steps=steps))
        for index, rows in enumerate(np.split(np.arange(len(everyone)), len(candidates))):
            verdicts[index][ground] = verdict(measures, rows)
    return verdicts


def verdict(measures: Measures, rows: NDArray[np.intp]) -> Verdict:
    """Means over those episodes."""
    return Verdict(
        fall_rate=float(measures.fell[rows].mean()),
        velocity_error=float(measures.velocity_error[rows].mean()),
        mean_velocity_error=float(measures.mean_velocity_error[rows].mean()),
        yaw_rate_error=float(measures.yaw_rate_error[rows].mean()),
    )


def cost(verdicts: dict[str, Verdict]) -> float:
    """Cost of one candidate, mean over the grounds, m/s."""
    return sum(each.cost for each in verdicts.values()) / len(verdicts)


def to_unit(parameters: TrotParameters) -> Floats:
    """The searched parameters as shares of their ranges, clipped to 0 … 1, shape (k,)."""
    values = dataclasses.asdict(parameters)
    shares = np.array([(values[name] - low) / (high - low) for name, (low, high) in SEARCH_RANGES.items()])
    return shares.clip(0.0, 1.0)


def from_unit(shares: Floats) -> TrotParameters:
    """The inverse of `to_unit`; parameters that are not searched keep their defaults."""
    ranges = zip(SEARCH_RANGES.items(), shares, strict=True)
    return TrotParameters(**{name: float(low + share * (high - low)) for (name, (low, high)), share in ranges})


def cross_entropy(
    costs: Callable[[list[Floats], int], list[float]], start: Floats, options: Options
) -> list[tuple[float, Floats]]:
    """Best candidate and last mean of each generation, (cost, shares); `costs` is told the generation too."""
    generator = np.random.default_rng(episode_seeds("search", options.seed, 1))
    mean, deviation = start, np.full(len(start), options.spread)
    elite = max(options.population // 4, 2)
    history = []
    for generation in range(options.generations):
        drawn = generator.normal(mean, deviation, (options.population - 1, len(start)))
        candidates = [mean, *np.clip(drawn, 0.0, 1.0)]
        found = costs(candidates, generation)
        order = np.argsort(found)
        history += [(found[0], mean), (found[order[0]], candidates[order[0]])]
        best = np.stack([candidates[i] for i in order[:elite]])
        # Half of the old distribution is kept, so that a handful of lucky candidates cannot end the search early.
        mean = 0.5 * mean + 0.5 * best.mean(axis=0)
        deviation = 0.5 * deviation + 0.5 * np.maximum(best.std(axis=0), 0.01)
    return [*history, (float("nan"), mean)]


def search(options: Options, report: Callable[[float, str], None]) -> list[TrotParameters]:
    """Finalists: the defaults, the last mean, and the best candidates of the last five generations."""

    def costs(candidates: list[Floats], generation: int) -> list[float]:
        seeds = episode_seeds("search", options.seed, options.episodes * (generation + 1))[-options.episodes :]
        verdicts = judge([from_unit(shares) for shares in candidates], seeds, options.steps, options.threads)
        found = [cost(each) for each in verdicts]
        report((generation + 1) / options.generations, f"cost of the mean {found[0]:.3f}, best {min(found):.3f} m/s")
        return found

    history = cross_entropy(costs, to_unit(TrotParameters()), options)
    return [TrotParameters(), from_unit(history[-1][1]), *(from_unit(shares) for _, shares in history[-11:-1])]


def fitted(parameters: TrotParameters, seeds: NDArray[np.int64], threads: int) -> TrotParameters:
    """The same gait with the command map that undoes what it makes of the velocities asked of it on flat ground.

    Least squares over command intervals, u asked of the gait and v achieved: forward v = a u + b, lateral v = a u,
    yaw rate ω = a u + c u_lateral; each is solved for u.
    """
    measures = measure(run(Trot(parameters), practice("flat", "search"), seeds, nthread=threads))
    command, achieved = measures.commands.reshape(-1, 3), measures.mean_velocities.reshape(-1, 3)
    upright = np.isfinite(achieved).all(axis=1)
    command, achieved = command[upright], achieved[upright]
    forward = parameters.forward_gain * command[:, 0] + parameters.forward_bias
    lateral = parameters.lateral_gain * command[:, 1]
    yaw = parameters.yaw_gain * command[:, 2] + parameters.yaw_per_lateral * command[:, 1]
    a_forward, b_forward = _least_squares(achieved[:, 0], forward, np.ones(len(forward)))
    (a_lateral,) = _least_squares(achieved[:, 1], lateral)
    a_yaw, c_lateral = _least_squares(achieved[:, 2], yaw, lateral)
    return dataclasses.replace(
        parameters,
        forward_gain=1.0 / a_forward,
        forward_bias=-b_forward / a_forward,
        lateral_gain=1.0 / a_lateral,
        yaw_gain=1.0 / a_yaw,
        yaw_per_lateral=-c_lateral / (a_yaw * a_lateral),
    )


def _least_squares(target: Floats, *columns: Floats) -> list[float]:
    solution, *_ = np.linalg.lstsq(np.stack(columns, axis=1), target, rcond=None)
    return [float(value) for value in solution]


def tune(options: Options, report: Callable[[float, str], None]) -> dict[str, Any]:
    """The whole search; gives the result as JSON types."""
    finalists = search(options, report)
    # Another seed, so that the finalists are judged on episodes that no generation saw.
    seeds = episode_seeds("search", options.seed + 1, 2 * options.final_episodes)
    first, second = np.split(seeds, 2)
    verdicts = judge(finalists, first[: max(options.final_episodes // 4, 1)], 1000, options.threads)
    winner = finalists[int(np.argmin([cost(each) for each in verdicts]))]
    mapped = fitted(winner, first, options.threads)
    contest = [TrotParameters(), winner, mapped]
    outcome = judge(contest, second, 1000, options.threads)
    chosen = int(np.argmin([cost(each) for each in outcome]))
    return {
        "schema": 1,
        "options": {key: str(value) if isinstance(value, Path) else value for key, value in vars(options).items()},
        "parameters": _rounded(contest[chosen]),
        "contest": [
            {"name": name, "parameters": _rounded(entry), "cost": cost(each), "grounds": _figures(each)}
            for name, entry, each in zip(("defaults", "searched", "map fitted"), contest, outcome, strict=True)
        ],
    }


def _rounded(parameters: TrotParameters) -> dict[str, float]:
    return {name: round(value, 4) for name, value in dataclasses.asdict(parameters).items()}


def _figures(verdicts: dict[str, Verdict]) -> dict[str, dict[str, float]]:
    return {ground: dataclasses.asdict(each) for ground, each in verdicts.items()}


def markdown(result: dict[str, Any]) -> str:
    """The outcome for readers."""
    options = result["options"]
    lines = [
        "# How the trot was tuned",
        "",
        f"Written by `{PROGRAM} --seed {options['seed']}`: {options['generations']} generations of "
        f"{options['population']} candidates, each on {options['episodes']} episodes of {options['steps']} steps on "
        "flat and on rough ground, on seeds and a surface of the search's own; then the command map fitted by least "
        "squares.",
        "",
        "| parameter | range searched | chosen |",
        "|---|---|---|",
    ]
    for name, value in result["parameters"].items():
        low_high = SEARCH_RANGES.get(name)
        lines.append(f"| {name} | {f'{low_high[0]:g} … {low_high[1]:g}' if low_high else '–'} | {value:g} |")
    lines += [
        "",
        f"Judged on {options['final_episodes']} further episodes of 10 s a ground:",
        "",
        "| parameters | ground | falls | velocity error m/s | mean velocity error m/s | yaw-rate error rad/s |",
        "|---|---|---|---|---|---|",
    ]
    for entry in result["contest"]:
        for ground, figures in entry["grounds"].items():
            lines.append(
                f"| {entry['name']} | {ground} | {figures['fall_rate']:.1%} | {figures['velocity_error']:.3f} "
                f"| {figures['mean_velocity_error']:.3f} | {figures['yaw_rate_error']:.3f} |"
            )
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Run the command; gives the exit code."""
    from rich.progress import Progress

    try:
        options = parse(Options, arguments, program=PROGRAM, description="Search the trot's parameters.")
        _check(options)
        with Progress() as progress:
            task = progress.add_task("search", total=1.0)
            result = tune(options, lambda share, text: progress.update(task, completed=share, description=text))
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(result, indent=2) + "\n")
        options.summary.write_text(markdown(result))
    except (UsageError, OSError) as error:
        return fail(str(error))
    except KeyboardInterrupt:
        print("stopped; nothing was written", file=sys.stderr)
        return 130
    print(markdown(result))
    return 0


def _check(options: Options) -> None:
    for name in ("generations", "episodes", "steps", "final_episodes", "threads"):
        if getattr(options, name) < 1:
            raise UsageError(f"--{name.replace('_', '-')} must be at least 1, got {getattr(options, name)}")
    if options.population < 3:
        raise UsageError(f"--population must be at least 3, got {options.population}")
    if options.steps <= 100:
        raise UsageError(f"--steps must be above 100, the first second being settling time, got {options.steps}")


if __name__ == "__main__":
    raise SystemExit(main())
