"""Search of a robot's open-loop trot by CMA-ES: `python -m train search trot` writes the file that the policy reads.

Candidates and their costs are in a file that ends in .trials.jsonl, a line for each generation, with the mean of the
distribution after it, which is all that Ctrl-C leaves.
"""

import sys
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.progress import track

from evaluate.measures.metrics import Measures, measure
from evaluate.rollouts.hardware import IDEAL, Hardware, hardware_of
from evaluate.rollouts.rollout import run
from policies.base import Floats
from policies.parameters import number, scaled_parameters, scaled_ranges
from policies.shipped import folder_of
from policies.trot.open_loop import FILE, SEARCH_RANGES, Trot, TrotParameters, searched_parameters
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from train.curriculum import practice
from train.search.cmaes import Effort, Panel, Seeds, Subject, as_json, changes, method, results, rounded, search

SCENARIO_WEIGHTS = {"flat": 0.5, "push": 0.25, "rough": 0.25}
ERROR_SCALES = {"velocity_error": 0.2, "mean_velocity_error": 0.12, "yaw_rate_error": 0.35, "overspeed": 0.02}
"""What counts as one unit of each error, m/s, m/s, rad/s, and of the share of joint readings above the rated speed.

Without the last the search finds gaits that no motor could move: steps of 5 Hz in a deep crouch."""
COMMAND_MAP = ("forward_gain", "forward_bias", "lateral_gain", "yaw_gain", "yaw_per_lateral")
WEAKEST_RESPONSE = 0.7
"""Achieved per commanded velocity below which a candidate costs more, so that standing still does not win."""
WEAKNESS_WEIGHT = 10.0
WEAKEST_MAPPED = 0.1
"""Achieved per commanded velocity below which a response is not undone: the map would ask for leaps."""
MINIMUM_INTERVALS = 8
"""Command intervals needed to fit a response."""
MAP_ROUNDS = 3
"""How often the command map is fitted again with the one before in force."""
ACCOUNT = "TROT.md"


@dataclass(frozen=True, kw_only=True)
class Options(Effort):
    """Which robot's trot is searched, and how thoroughly."""

    subject: Annotated[Literal["trot"], tyro.conf.Positional] = "trot"
    """trot: the open-loop trot."""
    robot: str | None = None
    """Robot: a name of quad_env.ROBOTS such as go1, or the path of its MJCF, URDF or TOML."""
    # Two command intervals an episode, enough to fit a response.
    episodes: int = number(10, limits=(MINIMUM_INTERVALS, 10_000))
    """Episodes of a candidate in each scenario and round."""
    check_episodes: int = number(108, limits=(MINIMUM_INTERVALS // 2, 10_000))
    """Fresh episodes on which the command map is fitted and the outcome compared with the parameters before."""


def main(options: Options) -> int:
    """Search, conclude, write; the exit code. Raises UsageError."""
    return search(subject, options)


def subject(options: Options) -> Subject[TrotParameters]:
    """The search of a robot's trot: from SimpleQuad's, or for another robot from that of dynamic similarity."""
    hardware = hardware_of(options.robot or Hardware.robot)
    robot, threads, own = hardware.quadruped, options.threads, hardware.quadruped == SIMPLE_QUAD
    start = TrotParameters() if own else scaled_parameters(searched_parameters(), robot)
    ranges = scaled_ranges(SEARCH_RANGES, TrotParameters, robot)

    def costs(candidates: list[TrotParameters], seeds: Seeds) -> Floats:
        return candidate_costs(candidates, seeds, options.steps, threads, hardware)

    def conclude(found: TrotParameters) -> tuple[str, str]:
        fresh = episode_seeds("search", options.seed + 2_000_000, MAP_ROUNDS * options.check_episodes)
        for seeds in track(np.split(fresh, MAP_ROUNDS), description="command map"):
            found = mapped(found, seeds, threads, hardware)
        after = rounded(found)
        seeds = episode_seeds("search", options.seed + 1_000_000, options.check_episodes)
        both = [(name, label, of) for name in SCENARIO_WEIGHTS for label, of in (("before", start), ("after", after))]
        walks = ((name, label, walked(of, name, seeds, threads, hardware)) for name, label, of in both)
        table = results(track(walks, description="comparison", total=len(both)))
        lines = [*introduction(options), "", *changes(start, after, ranges, COMMAND_MAP), ""]
        lines += [f"On {options.check_episodes} fresh search episodes of 10 s a scenario:", "", *table]
        return as_json(after), "\n".join(lines) + "\n"

    file = FILE.path if own else folder_of(robot) / FILE.path.name
    return Subject(start, ranges, costs, conclude, file, ACCOUNT)


def introduction(options: Options) -> list[str]:
    """Heading of the account, and how the search was made."""
    scenarios = ", ".join(f"{name} (weight {weight:g})" for name, weight in SCENARIO_WEIGHTS.items())
    terms = " + ".join(f"{name} / {scale:g}" for name, scale in ERROR_SCALES.items())
    return [
        "# The trot's parameters",
        "",
        method("python -m train search trot", options, scenarios),
        f"Cost of an episode: {terms}; the errors count the steps after a fall.",
        "Each candidate is evaluated against its own linear response on flat ground; the command map is fitted by "
        "least squares afterwards.",
    ]


def cost(measures: Measures, members: int) -> Floats:
    """Mean over each member's episodes, (members,), of the sum of scaled errors, which count the steps after a fall."""
    total = np.zeros(len(measures.velocity_error))
    for name, scale in ERROR_SCALES.items():
        # A robot that fell within the first second has no overspeed: all joints count as too fast all the time.
        total += np.nan_to_num(getattr(measures, name), nan=1.0) / scale
    return np.asarray(total.reshape(members, -1).mean(axis=1))


def interval_response(measures: Measures) -> Floats:
    """Least-squares map from commanded (and 1) to achieved velocity, (4, 3), over the intervals without a fall."""
    command, achieved = measures.commands.reshape(-1, 3), measures.mean_velocities.reshape(-1, 3)
    upright = np.isfinite(achieved).all(axis=1)
    if upright.sum() < MINIMUM_INTERVALS:
        return np.zeros((4, 3))
    inputs = np.column_stack((command[upright], np.ones(upright.sum())))
    return np.asarray(np.linalg.lstsq(inputs, achieved[upright], rcond=None)[0], np.float64)


def weakness(found: Floats) -> float:
    """Cost of a response (4, 3) whose velocities are too small compared with the commanded ones."""
    return WEAKNESS_WEIGHT * float(np.clip(WEAKEST_RESPONSE - np.diag(found[:3]), 0.0, None).sum())


def candidate_costs(
    candidates: list[TrotParameters], seeds: Seeds, steps: int, threads: int, hardware: Hardware = IDEAL
) -> Floats:
    """Weighted cost of each candidate on all scenarios of a robot, (candidates,).

    A candidate is evaluated against its own linear response on flat ground, as if its command map were fitted already,
    plus a cost for a response that is too weak to be mapped.
    """
    members, robot = len(candidates), hardware.quadruped
    panel = Panel([Trot(candidate, robot=robot) for candidate in candidates])
    walk = partial(run, panel, seeds=np.tile(seeds, members), nthread=threads, steps=steps, hardware=hardware)
    runs = {name: walk(practice(name, "search", robot=robot)) for name in SCENARIO_WEIGHTS}
    flat, rows = measure(runs["flat"]), np.split(np.arange(len(seeds) * members), members)
    each = [replace(flat, commands=flat.commands[r], mean_velocities=flat.mean_velocities[r]) for r in rows]
    maps = list(map(interval_response, each))
    total = np.array([weakness(found) for found in maps])
    for name, weight in SCENARIO_WEIGHTS.items():
        target = np.concatenate([runs[name].command[:, r] @ m[:3] + m[3] for r, m in zip(rows, maps, strict=True)], 1)
        total += weight * cost(measure(replace(runs[name], command=target)), members)
    return total


def mapped(parameters: TrotParameters, seeds: Seeds, threads: int, hardware: Hardware = IDEAL) -> TrotParameters:
    """The same gait with the command map that undoes a robot's response to it on flat ground."""
    return unless_weak(parameters, interval_response(walked(parameters, "flat", seeds, threads, hardware)))


def walked(parameters: TrotParameters, name: str, seeds: Seeds, threads: int, hardware: Hardware) -> Measures:
    """Measures of a robot's episodes from those seeds on the scenario of that name."""
    robot = hardware.quadruped
    policy, scenario = Trot(parameters, robot=robot), practice(name, "search", robot=robot)
    return measure(run(policy, scenario, seeds, nthread=threads, hardware=hardware))


def undone(parameters: TrotParameters, found: Floats) -> TrotParameters:
    """The same gait with the command map that undoes the response `found`, (4, 3), to the map in force.

    With u asked of the gait and v achieved: forward v = a u + b, lateral v = a u, yaw rate ω = a u + c u_lateral.
    Raises ValueError where the response is too weak for the parameters' limits.
    """
    return replace(
        parameters,
        forward_gain=parameters.forward_gain / found[0, 0],
        forward_bias=parameters.forward_bias - parameters.forward_gain * found[3, 0] / found[0, 0],
        lateral_gain=parameters.lateral_gain / found[1, 1],
        yaw_gain=parameters.yaw_gain / found[2, 2],
        yaw_per_lateral=(parameters.yaw_per_lateral - parameters.yaw_gain * found[1, 2] / found[2, 2]) / found[1, 1],
    )


def unless_weak(parameters: TrotParameters, found: Floats) -> TrotParameters:
    """The parameters whose command map undoes the response `found`, (4, 3); unchanged where it is too weak for that."""
    try:
        if np.diag(found[:3]).min() < WEAKEST_MAPPED:
            raise ValueError("the response is too weak")
        return undone(parameters, found)
    except ValueError as error:
        # Not worth the loss of a long search.
        print(f"the command map is unchanged: {error}", file=sys.stderr)
        return parameters
