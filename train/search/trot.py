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
"""Names of the scenarios on which the trot search simulates the candidates by default.

The linear response of the gait to velocity commands is measured on the first scenario."""
COMMAND_MAP = ("forward_gain", "forward_bias", "lateral_gain", "yaw_gain", "yaw_per_lateral")
"""Names of the trot parameters that CMA-ES does not search, but that are fitted by least squares afterwards.

The parameters define the command map, which converts a velocity command to the input of the gait."""
MIN_RESPONSE = 0.7
"""Ratio of achieved to commanded velocity below which a candidate of the trot search has an extra cost.

Without the extra cost, a candidate that stands still would have the lowest cost."""
WEAK_RESPONSE_WEIGHT = 2.0
"""Weight of the extra cost of a trot that responds too weakly to commands.

The cost is this weight times (`MIN_RESPONSE` - ratio), summed over forward velocity, lateral velocity and yaw rate. The
ratio is the achieved velocity divided by the commanded velocity."""
MIN_INVERTIBLE_RESPONSE = 0.1
"""Smallest ratio of achieved to commanded velocity for which the command map of a trot is fitted.

The command map converts a velocity command to the input of the gait.

For a smaller ratio, the fitted command map would command very large steps."""
MIN_INTERVALS = 6
"""Smallest number of command intervals without a fall to which the linear response of a gait is fitted.

A command interval is the time during which the velocity command is constant.
"""
MAP_ROUNDS = 3
"""Number of successive fits of the command map (from velocity command to gait input) of a trot.

Each fit measures the response of the gait with the command map of the previous fit."""
ACCOUNT = "TROT.md"
"""File name of the Markdown report of the trot search."""


@dataclass(frozen=True, kw_only=True)
class TrotSearchOptions(SearchOptions):
    """Command-line options of the parameter search of a robot's open-loop trot."""

    subject: Annotated[Literal["trot"], tyro.conf.Positional] = "trot"
    """Policy with the searched parameters; trot: the open-loop trot."""
    robot: str | None = None
    """Robot: a name of quad_env.ROBOTS like go1, or the path of its MJCF, URDF or TOML."""
    # The smallest valid number of episodes is MIN_INTERVALS // 2, because an episode has two command intervals, each
    # with a constant command, and the fit of the gait's linear response needs MIN_INTERVALS command intervals.
    episodes: int = parameter(6, limits=(MIN_INTERVALS // 2, 10_000))
    """Number of episodes per candidate, scenario and generation."""
    check_episodes: int = parameter(48, limits=(MIN_INTERVALS // 2, 10_000))
    """Number of new episodes per scenario for the fit of the command map and the comparison with the old parameters."""


def main(options: TrotSearchOptions) -> int:
    """Run the trot search, write its files and return the exit code.

    Raises UsageError if the options are not valid or a file cannot be written.
    """
    return search(make_search_problem, options)


def make_search_problem(options: TrotSearchOptions) -> SearchProblem[TrotParameters]:
    """Return the definition of the parameter search for the trot of a robot.

    The search starts from the trot of SimpleQuad. For another robot, the parameters are scaled by dynamic similarity to
    its size.
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
        """Return the mean cost of each candidate on the episodes with the given `seeds`, (candidates,)."""
        return candidate_costs(candidates, seeds, options.steps, threads, hardware, scenario_names)

    def finalize(parameters: TrotParameters) -> tuple[str, str]:
        """Fit the command map (from velocity command to gait input), and compare the trot with the start parameters.

        Returns the contents of the parameter file (JSON) and of the report (Markdown).
        """
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
        Response matrix R of each candidate, (members, 4, 3). A command interval has a constant velocity command with
        the components f (forward), l (lateral) and y (yaw rate). The mean velocity (forward, lateral, yaw rate) in the
        interval is modelled as the row vector (f, l, y, 1) times R. R is fitted to the intervals without a fall. R is
        zero if a candidate has fewer than MIN_INTERVALS intervals without a fall.
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
    """Return the extra cost of a trot that responds too weakly to velocity commands.

    `response`, (4, 3), is the response matrix of `fit_command_response`. See `MIN_RESPONSE` and `WEAK_RESPONSE_WEIGHT`.
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
    """Compute the cost of each candidate of the trot search, averaged over all episodes and scenarios.

    The command map (from velocity command to gait input) of a candidate is fitted after the search. So the tracking
    error of an episode is not the difference from the command, but from the velocity that the candidate's linear
    response predicts for the command. The response is measured on the first scenario. A weak response has an extra
    cost.

    Args:
        candidates: Parameters of each candidate.
        seeds: Seeds of the episodes, the same for every candidate.
        steps: Length of an episode, control steps.
        threads: Number of simulation threads.
        hardware: Hardware settings of the robots.
        scenario_names: Names of the scenarios.

    Returns:
        Mean cost of each candidate, (candidates,).
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
    """Fit the command map of a trot to its measured response on the first scenario of the search.

    The command map converts a velocity command to the input of the gait.

    Args:
        parameters: Parameters of the trot.
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
    """Return the parameters of a trot with the command map that inverts its measured response.

    The command map converts a velocity command to the input of the gait. With the inverted response, the robot moves at
    the commanded velocity. The model of the gait has an input u and an achieved velocity v (yaw rate: ω) in each
    direction, with constants a, b and c; u_lateral is the lateral input:

        forward: v = a u + b
        lateral: v = a u
        yaw rate: ω = a u + c u_lateral

    Raises ValueError if the new parameters exceed their limits, because the response is too weak.

    Args:
        parameters: Parameters of the gait with which the response was measured.
        response: Linear response of the gait, (4, 3), see `fit_command_response`.

    Returns:
        The parameters with the new command map, which converts a velocity command to the input of the gait.
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
    """Return the parameters of a trot with the command map that inverts its measured response, if possible.

    The command map converts a velocity command to the input of the gait. The parameters are unchanged if the response
    is too weak.

    Args:
        parameters: Parameters of the trot.
        response: Linear response of the gait to commands, (4, 3), see `fit_command_response`.

    Returns:
        The new parameters.
    """
    if np.diag(response[:3]).min() < MIN_INVERTIBLE_RESPONSE:
        return _keep_map(parameters, "the response is too weak")
    try:
        return invert_command_response(parameters, response)
    except ValueError as error:
        return _keep_map(parameters, str(error))


def _keep_map(parameters: TrotParameters, reason: str) -> TrotParameters:
    """Print the `reason` why the map from command to gait input is not fitted; return the parameters unchanged.

    The function raises no error, because an error would lose the result of a long search.
    """
    print(f"the command map is unchanged: {reason}", file=sys.stderr)
    return parameters
