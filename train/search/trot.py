"""Search of a robot's open-loop trot by CMA-ES: `python -m train search trot` writes the file that the policy reads.

Candidates and their costs are in a file that ends in .trials.jsonl, a line for each generation, with the mean of the
distribution after it, which is all that Ctrl-C leaves.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
import tyro
from rich.progress import track

from evaluate.hardware import IDEAL, HardwareConfig, parse_robot_option
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from policies.base import Floats
from policies.parameters import parameter, scaled_parameters, scaled_ranges
from policies.shipped import folder_of
from policies.trot.open_loop import FILE, SEARCH_RANGES, TrotParameters, searched_parameters
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.seeding import episode_seeds
from train.config import check_scenarios
from train.search.cmaes import (
    SearchOptions,
    SearchProblem,
    describe_method,
    parameter_table,
    parameters_to_json,
    results_table,
    round_parameters,
    search,
)
from train.search.trials import COST_DESCRIPTION, Seeds, compare_parameters, episode_costs, run_candidates

EXERCISES = ("flat", "push", "rough")
"""Usual scenarios of the search; the response to commands is measured on the first."""
COMMAND_MAP = ("forward_gain", "forward_bias", "lateral_gain", "yaw_gain", "yaw_per_lateral")
MIN_RESPONSE = 0.7
"""Achieved per commanded velocity below which a candidate costs more, so that standing still does not win."""
WEAK_RESPONSE_WEIGHT = 2.0
MIN_INVERTIBLE_RESPONSE = 0.1
"""Achieved per commanded velocity below which a response is not undone: the map would ask for leaps."""
MIN_INTERVALS = 6
"""Command intervals needed to fit a response."""
MAP_ROUNDS = 3
"""How often the command map is fitted again with the one before in force."""
ACCOUNT = "TROT.md"


@dataclass(frozen=True, kw_only=True)
class TrotSearchOptions(SearchOptions):
    """Which robot's trot is searched, and how thoroughly."""

    make_search_problem: Annotated[Literal["trot"], tyro.conf.Positional] = "trot"
    """trot: the open-loop trot."""
    robot: str | None = None
    """Robot: a name of quad_env.ROBOTS such as go1, or the path of its MJCF, URDF or TOML."""
    # Two command intervals each, enough to fit a response.
    episodes: int = parameter(6, limits=(MIN_INTERVALS // 2, 10_000))
    """Episodes of a candidate in each scenario and round."""
    check_episodes: int = parameter(48, limits=(MIN_INTERVALS // 2, 10_000))
    """Fresh episodes on which the command map is fitted and the outcome compared with the parameters before."""


def main(options: TrotSearchOptions) -> int:
    """Search, conclude, write; the exit code. Raises UsageError."""
    return search(subject, options)


def subject(options: TrotSearchOptions) -> SearchProblem[TrotParameters]:
    """The search of a robot's trot: from SimpleQuad's, or for another robot from that of dynamic similarity."""
    hardware, threads = parse_robot_option(options.robot or HardwareConfig.robot), options.threads
    robot, own = hardware.robot_model, hardware.robot_model == SIMPLE_QUAD
    start = TrotParameters() if own else scaled_parameters(searched_parameters(), robot)
    start = FILE.read(options.start) if options.start else start
    scenario_names = options.exercises or EXERCISES
    check_scenarios("--exercises", scenario_names, robot)
    ranges = scaled_ranges(SEARCH_RANGES, TrotParameters, robot)

    def costs(candidates: list[TrotParameters], seeds: Seeds) -> Floats:
        return candidate_costs(candidates, seeds, options.steps, threads, hardware, scenario_names)

    def conclude(found: TrotParameters) -> tuple[str, str]:
        fresh = episode_seeds("search", options.seed + 2_000_000, MAP_ROUNDS * options.check_episodes)
        for seeds in track(np.split(fresh, MAP_ROUNDS), description="command map"):
            found = fit_command_map(found, seeds, threads, hardware, scenario_names)
        after, seeds = round_parameters(found), episode_seeds("validation", options.seed, options.check_episodes)
        walks, _ = compare_parameters("trot", start, after, scenario_names, seeds, threads, hardware)
        how = describe_method("python -m train search trot", options, ", ".join(scenario_names))
        lines = ["# The trot's parameters", "", how, COST_DESCRIPTION]
        lines += ["Commands are those that a candidate's linear response on flat ground would be mapped to; the map is"]
        lines += ["fitted by least squares afterwards.", "", *parameter_table(start, after, ranges, COMMAND_MAP), ""]
        lines += [f"On {options.check_episodes} validation episodes of 10 s a scenario:", "", *results_table(walks)]
        return parameters_to_json(after), "\n".join(lines) + "\n"

    file = FILE.path if own else folder_of(robot) / FILE.path.name
    return SearchProblem(start, ranges, costs, conclude, file, ACCOUNT)


def fit_command_response(walk: Episodes, members: int) -> Floats:
    """Least-squares map of each member from commanded (and 1) to achieved velocity, (members, 4, 3), over the intervals
    without a fall; zeros where these are too few."""
    measures = measure(walk)
    command, achieved = (each.reshape(members, -1, 3) for each in (measures.commands, measures.mean_velocities))
    upright, found = np.asarray(np.isfinite(achieved).all(axis=-1)), np.zeros((members, 4, 3))
    for member in np.flatnonzero(upright.sum(axis=1) >= MIN_INTERVALS):
        rows = upright[member]
        inputs = np.column_stack((command[member, rows], np.ones(rows.sum())))
        found[member] = np.linalg.lstsq(inputs, achieved[member, rows], rcond=None)[0]
    return found


def weak_response_cost(found: Floats) -> float:
    """Cost of a response (4, 3) whose velocities are too small compared with the commanded ones."""
    return WEAK_RESPONSE_WEIGHT * float(np.clip(MIN_RESPONSE - np.diag(found[:3]), 0.0, None).sum())


def candidate_costs(
    candidates: list[TrotParameters],
    seeds: Seeds,
    steps: int,
    threads: int,
    hardware: HardwareConfig = IDEAL,
    scenario_names: Sequence[str] = EXERCISES,
) -> Floats:
    """Mean cost of each candidate over all scenarios of a robot, (candidates,).

    A candidate is evaluated against its own linear response on flat ground, as if its command map were fitted already,
    plus a cost for a response that is too weak to be mapped.
    """
    walks = run_candidates("trot", candidates, scenario_names, seeds, "search", steps, threads, hardware)
    found = fit_command_response(walks[0], len(candidates))
    total = np.array([weak_response_cost(each) for each in found])
    each_robot = found.repeat(len(seeds), axis=0)
    for walk in walks:
        target = np.einsum("tnc,ncd->tnd", walk.command, each_robot[:, :3]) + each_robot[:, 3]
        costs = episode_costs(measure(replace(walk, command=target)))
        total += costs.reshape(len(candidates), -1).mean(axis=1) / len(walks)
    return total


def fit_command_map(
    parameters: TrotParameters,
    seeds: Seeds,
    threads: int,
    hardware: HardwareConfig = IDEAL,
    scenario_names: Sequence[str] = EXERCISES,
) -> TrotParameters:
    """The same gait with the command map that undoes a robot's response to it on flat ground."""
    (walk,) = run_candidates(
        "trot", [parameters], scenario_names[:1], seeds, "search", threads=threads, hardware=hardware
    )
    return try_invert_command_response(parameters, fit_command_response(walk, 1)[0])


def invert_command_response(parameters: TrotParameters, found: Floats) -> TrotParameters:
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


def try_invert_command_response(parameters: TrotParameters, found: Floats) -> TrotParameters:
    """The parameters whose command map undoes the response `found`, (4, 3); unchanged where it is too weak for that."""
    try:
        if np.diag(found[:3]).min() < MIN_INVERTIBLE_RESPONSE:
            raise ValueError("the response is too weak")
        return invert_command_response(parameters, found)
    except ValueError as error:
        # Not worth the loss of a long search.
        print(f"the command map is unchanged: {error}", file=sys.stderr)
        return parameters
