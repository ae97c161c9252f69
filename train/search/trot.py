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
from policies.shipped import models_folder
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
"""Default scenarios of the search. The response to commands is measured on the first scenario."""
COMMAND_MAP = ("forward_gain", "forward_bias", "lateral_gain", "yaw_gain", "yaw_per_lateral")
"""Names of the parameters of the command map, which are fitted after the search.

The command map converts a velocity command to the input of the gait."""
MIN_RESPONSE = 0.7
"""Smallest ratio of achieved to commanded velocity that has no extra cost.

Without the extra cost a candidate that stands still would have the lowest cost."""
WEAK_RESPONSE_WEIGHT = 2.0
"""Factor of the extra cost: cost per unit of (`MIN_RESPONSE` - ratio), for each of the three velocities."""
MIN_INVERTIBLE_RESPONSE = 0.1
"""Smallest ratio of achieved to commanded velocity for which the command map is fitted.

For a smaller ratio the map would command very large steps."""
MIN_INTERVALS = 6
"""Smallest number of command intervals to which a response is fitted."""
MAP_ROUNDS = 3
"""Number of successive fits of the command map. Each fit measures the response with the map of the previous fit."""
ACCOUNT = "TROT.md"
"""File name of the report of the search."""


@dataclass(frozen=True, kw_only=True)
class TrotSearchOptions(SearchOptions):
    """Options of the search of a robot's trot."""

    subject: Annotated[Literal["trot"], tyro.conf.Positional] = "trot"
    """trot: the open-loop trot."""
    robot: str | None = None
    """Robot: a name of quad_env.ROBOTS like go1, or the path of its MJCF, URDF or TOML."""
    # An episode has two command intervals, so that the smallest number of episodes suffices to fit a response.
    episodes: int = parameter(6, limits=(MIN_INTERVALS // 2, 10_000))
    """Episodes of a candidate in each scenario and round."""
    check_episodes: int = parameter(48, limits=(MIN_INTERVALS // 2, 10_000))
    """Fresh episodes on which the command map is fitted and the outcome compared with the old parameters."""


def main(options: TrotSearchOptions) -> int:
    """Run the search, write its files and return the exit code. Raises UsageError."""
    return search(make_search_problem, options)


def make_search_problem(options: TrotSearchOptions) -> SearchProblem[TrotParameters]:
    """Return the search problem for the trot of a robot.

    The search starts from the trot of SimpleQuad, scaled by dynamic similarity if the robot is another one.
    """
    threads = options.threads
    hardware = parse_robot_option(options.robot or HardwareConfig.robot)
    robot = hardware.robot_model
    is_simple_quad = robot == SIMPLE_QUAD
    start = TrotParameters() if is_simple_quad else scaled_parameters(searched_parameters(), robot)
    start = FILE.read(options.start) if options.start else start
    scenario_names = options.exercises or EXERCISES
    check_scenarios("--exercises", scenario_names, robot)
    ranges = scaled_ranges(SEARCH_RANGES, TrotParameters, robot)

    def costs(candidates: list[TrotParameters], seeds: Seeds) -> Floats:
        """Return the cost of each of the `candidates` on the episodes with the given `seeds`."""
        return candidate_costs(candidates, seeds, options.steps, threads, hardware, scenario_names)

    def finalize(parameters: TrotParameters) -> tuple[str, str]:
        """Fit the command map, compare with the start, and return the texts of parameter file and report."""
        fresh = episode_seeds("search", options.seed + 2_000_000, MAP_ROUNDS * options.check_episodes)
        for seeds in track(np.split(fresh, MAP_ROUNDS), description="command map"):
            parameters = fit_command_map(parameters, seeds, threads, hardware, scenario_names)
        after = round_parameters(parameters)
        seeds = episode_seeds("validation", options.seed, options.check_episodes)
        walks, _ = compare_parameters("trot", start, after, scenario_names, seeds, threads, hardware)
        method = describe_method("python -m train search trot", options, ", ".join(scenario_names))
        lines = ["# The trot's parameters", "", method, COST_DESCRIPTION]
        lines += ["Commands are those that a candidate's linear response on flat ground would be mapped to; the map is"]
        lines += ["fitted by least squares afterwards.", "", *parameter_table(start, after, ranges, COMMAND_MAP), ""]
        lines += [f"On {options.check_episodes} validation episodes of 10 s a scenario:", "", *results_table(walks)]
        return parameters_to_json(after), "\n".join(lines) + "\n"

    file = FILE.path if is_simple_quad else models_folder(robot) / FILE.path.name
    return SearchProblem(start, ranges, costs, finalize, file, ACCOUNT)


def fit_command_response(walk: Episodes, members: int) -> Floats:
    """Fit the linear response of each candidate to its commands by least squares.

    Args:
        walk: Record of the episodes, ordered by candidate, with equally many episodes for each candidate.
        members: Number of candidates.

    Returns:
        Matrix R of each candidate, (members, 4, 3). The mean velocity in a command interval is modelled as
        (forward, lateral, yaw-rate command, 1) R. R is fitted to the intervals without a fall, and zero if a candidate
        has fewer than MIN_INTERVALS of them.
    """
    measures = measure(walk)
    command = measures.commands.reshape(members, -1, 3)
    achieved = measures.mean_velocities.reshape(members, -1, 3)
    upright = np.asarray(np.isfinite(achieved).all(axis=-1))
    response = np.zeros((members, 4, 3))
    for member in np.flatnonzero(upright.sum(axis=1) >= MIN_INTERVALS):
        rows = upright[member]
        inputs = np.column_stack((command[member, rows], np.ones(rows.sum())))
        response[member] = np.linalg.lstsq(inputs, achieved[member, rows], rcond=None)[0]
    return response


def weak_response_cost(response: Floats) -> float:
    """Return the extra cost of a `response`, (4, 3), that is too weak for its commands.

    See `MIN_RESPONSE` and `WEAK_RESPONSE_WEIGHT`.
    """
    return WEAK_RESPONSE_WEIGHT * float(np.clip(MIN_RESPONSE - np.diag(response[:3]), 0.0, None).sum())


def candidate_costs(
    candidates: list[TrotParameters],
    seeds: Seeds,
    steps: int,
    threads: int,
    hardware: HardwareConfig = IDEAL,
    scenario_names: Sequence[str] = EXERCISES,
) -> Floats:
    """Compute the mean cost of each candidate over all scenarios.

    The command map of a candidate is fitted after the search. So the tracking error is not measured against the
    command, but against the velocity that the candidate's linear response on the first scenario predicts for the
    command. A weak response has an extra cost.

    Args:
        candidates: Parameters of each candidate.
        seeds: Seeds of the episodes, the same for every candidate.
        steps: Length of an episode, control steps.
        threads: Number of simulation threads.
        hardware: Hardware settings of the robots.
        scenario_names: Names of the scenarios.

    Returns:
        Cost of each candidate, (candidates,).
    """
    walks = run_candidates("trot", candidates, scenario_names, seeds, "search", steps, threads, hardware)
    responses = fit_command_response(walks[0], len(candidates))
    total = np.array([weak_response_cost(response) for response in responses])
    response_of_robot = responses.repeat(len(seeds), axis=0)
    for walk in walks:
        target = np.einsum("tnc,ncd->tnd", walk.command, response_of_robot[:, :3]) + response_of_robot[:, 3]
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
    """Fit the command map of a gait to its response on the first scenario of the search.

    Args:
        parameters: Parameters of the gait.
        seeds: Seeds of the episodes.
        threads: Number of simulation threads.
        hardware: Hardware settings of the robots.
        scenario_names: Names of the scenarios of the search. Only the first one is simulated.

    Returns:
        The parameters with the command map that inverts the response; unchanged if the response is too weak.
    """
    (walk,) = run_candidates(
        "trot", [parameters], scenario_names[:1], seeds, "search", threads=threads, hardware=hardware
    )
    return try_invert_command_response(parameters, fit_command_response(walk, 1)[0])


def invert_command_response(parameters: TrotParameters, response: Floats) -> TrotParameters:
    """Return the parameters of a gait with the command map that inverts its measured response.

    The model of the gait has an input u and an achieved velocity v in each direction, with constants a, b and c:

        forward: v = a u + b
        lateral: v = a u
        yaw rate: ω = a u + c u_lateral

    Raises ValueError if the new parameters exceed their limits, because the response is too weak.

    Args:
        parameters: Parameters of the gait with which the response was measured.
        response: Linear response of the gait, (4, 3), see `fit_command_response`.

    Returns:
        The parameters with the new command map.
    """
    return replace(
        parameters,
        forward_gain=parameters.forward_gain / response[0, 0],
        forward_bias=parameters.forward_bias - parameters.forward_gain * response[3, 0] / response[0, 0],
        lateral_gain=parameters.lateral_gain / response[1, 1],
        yaw_gain=parameters.yaw_gain / response[2, 2],
        yaw_per_lateral=(
            (parameters.yaw_per_lateral - parameters.yaw_gain * response[1, 2] / response[2, 2]) / response[1, 1]
        ),
    )


def try_invert_command_response(parameters: TrotParameters, response: Floats) -> TrotParameters:
    """Return `parameters` with the command map that inverts `response`, (4, 3).

    The parameters are unchanged if the response is too weak.

    Args:
        parameters: Parameters of the trot.
        response: Measured response to the command, (4, 3).

    Returns:
        The parameters.
    """
    if np.diag(response[:3]).min() < MIN_INVERTIBLE_RESPONSE:
        return _keep_map(parameters, "the response is too weak")
    try:
        return invert_command_response(parameters, response)
    except ValueError as error:
        return _keep_map(parameters, str(error))


def _keep_map(parameters: TrotParameters, reason: str) -> TrotParameters:
    """Print the reason, and return the parameters unchanged.

    No error is raised, because an error would lose the result of a long search.
    """
    print(f"the command map is unchanged: {reason}", file=sys.stderr)
    return parameters
