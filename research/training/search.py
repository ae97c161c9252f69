"""Search of the parameters of policies with feedback by CMA-ES, for success on many scenarios.

The new parameters are compared with the present ones on the same validation episodes, which the search does not use.
They replace the present parameters only if they are better. A search takes 26 minutes on one core, and three times as
long for the policy mpc_wbc. A file that ends in .trials.jsonl has one line for each generation, with the parameter sets
and their costs.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from evaluate.hardware import parse_robot_option
from evaluate.measures.metrics import measure
from evaluate.statistics.significance import sign_flip_test
from policies.base import Floats
from policies.mpc import parameters as mpc_parameters
from policies.parameters import ParameterFile, Parameters, parameter, scaled_ranges, search_ranges_of
from policies.shipped import models_folder
from policies.trot import integral
from policies.virtual_model import parameters as virtual_model
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scaled_name
from quad_env.seeding import episode_seeds
from train.config import check_scenarios
from train.search.cmaes import (
    MIN_EPISODE_STEPS,
    Ranges,
    SearchOptions,
    SearchProblem,
    describe_method,
    parameter_table,
    parameters_to_json,
    results_table,
    search,
)
from train.search.trials import COST_DESCRIPTION, Seeds, compare_parameters, episode_costs, run_candidates

EXERCISES = (
    *("steady", "flat=1.5", "flat=3", "push=35", "push=65", "rough=0.12", "rough=0.24", "slope=15", "slope=25"),
    *("stairs=0.1", "soft=0.02", "slippery=0.1", "force=60", "payload=20", "weak_motors=20", "slow_motors=5"),
    *("slow_motors=2", "latency=0.02", "latency=0.04", "latency=0.08", "noise=0.8", "surprise=1"),
)
"""Default scenarios of the search for the robot SimpleQuad.

For other robots, the severities are scaled to the size of the robot.
The severities range from mild ones, at which a trot succeeds, to hard ones, at which a trot rarely succeeds."""
SIGNIFICANT = 0.05
"""Significance level of the sign-flip test that compares new with present parameters, dimensionless.

New parameters are adopted only if the p-value of the test is not larger."""
ADOPTED = "The outcome is adopted."
"""Sentence in the report of a search if the new parameters replace the present parameters."""
KEPT = "Those in force are kept: the outcome is not better."
"""Sentence in the report of a search if the new parameters are rejected."""


@dataclass(frozen=True)
class SearchTarget:
    """Policy with parameters that the command `search` can optimise: parameter file and search bounds."""

    file: ParameterFile[Any]
    """File with the parameters of the policy."""
    ranges: Ranges
    """Name of an optimised parameter -> lower and upper bound, in the unit of the parameter."""

    @property
    def account_name(self) -> str:
        """File name of the report that a search for this policy writes."""
        return f"{self.file.path.stem.upper()}.md"


POLICIES = {
    "mpc_wbc": SearchTarget(mpc_parameters.FILE, mpc_parameters.SEARCH_RANGES),
    "trot_integral": SearchTarget(integral.FILE, integral.SEARCH_RANGES),
    "trot_feedback": SearchTarget(virtual_model.FILE, search_ranges_of(virtual_model.VirtualParameters)),
}
"""Name of a policy -> parameter file and bounds of the search."""


@dataclass(frozen=True, kw_only=True)
class FeedbackSearchOptions(SearchOptions):
    """Options of the command `search`: robot, policy, scenarios, and numbers of candidates and episodes."""

    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS, for example go1, or the path of an MJCF, URDF or TOML file."""
    policy: Literal["mpc_wbc", "trot_feedback", "trot_integral"] = "trot_feedback"
    """Policy for which gait and gains are optimised."""
    generations: int = parameter(22, limits=(0, 10_000))
    """Number of generations of CMA-ES; 0 to run only the comparison after the search."""
    candidates: int = parameter(16, limits=(4, 1000))
    """Number of candidates (parameter sets) in a generation."""
    episodes: int = parameter(1, limits=(1, 10_000))
    """Number of episodes of a candidate on each scenario."""
    steps: int = parameter(500, limits=(MIN_EPISODE_STEPS, 100_000))
    """Duration of an episode, control steps of 10 ms."""
    check_episodes: int = parameter(32, limits=(1, 10_000))
    """Number of validation episodes on which the result is compared with the previous parameters."""


def main(options: FeedbackSearchOptions) -> int:
    """Run the command `search`: optimise the parameters and write the files of the search.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.
    """
    return search(make_problem, options)


def make_problem(options: FeedbackSearchOptions) -> SearchProblem[Parameters]:
    """Define the search problem for a policy: start parameters, bounds, cost function, output files.

    The search starts from the present parameters of the policy, or from the parameter file in the option `start`.

    Args:
        options: Options of the command.

    Returns:
        The search problem for CMA-ES.
    """
    name = options.policy
    threads = options.threads
    hardware = parse_robot_option(options.robot)
    robot = hardware.robot_model
    target = POLICIES[name]
    file = target.file
    exercises = options.exercises or tuple(scaled_name(exercise, robot) for exercise in EXERCISES)
    check_scenarios("--exercises", exercises, robot)
    in_force = file.load_for_robot(robot)
    start = file.read(options.start) if options.start else in_force
    ranges = scaled_ranges(target.ranges, file.kind, robot)

    def costs(candidates: list[Parameters], seeds: Seeds) -> Floats:
        """Return the mean cost of each parameter set in `candidates`, (candidates,), dimensionless.

        The mean is over all scenarios, and over the episodes with the given `seeds`.
        """
        walks = run_candidates(name, candidates, exercises, seeds, "search", options.steps, threads, hardware)
        episode_values = [episode_costs(measure(walk)) for walk in walks]
        mean: Floats = np.reshape(episode_values, (len(exercises), len(candidates), -1)).mean(axis=(0, 2))
        return mean

    def conclude(after: Parameters) -> tuple[str, str]:
        """Compare the new parameters `after` with the present ones; return JSON and a report in Markdown.

        The JSON text has the new parameters if they are significantly better, otherwise the present ones.
        """
        seeds = episode_seeds("validation", options.seed, options.check_episodes)
        walks, differences = compare_parameters(name, in_force, after, exercises, seeds, threads, hardware)
        is_better, decision = adoption_decision(differences)
        method = describe_method("python -m research search", options, ", ".join(exercises))
        lines = [f"# The parameters of {name}", "", method, COST_DESCRIPTION, ""]
        lines += [decision, "", *parameter_table(in_force, after, ranges), "", *results_table(walks)]
        return parameters_to_json(after if is_better else in_force), "\n".join(lines) + "\n"

    path = file.path if robot == SIMPLE_QUAD else models_folder(robot) / file.path.name
    return SearchProblem(start, ranges, costs, conclude, path, target.account_name, digits=4, diagonal=True)


def adoption_decision(differences: Floats) -> tuple[bool, str]:
    """Decide if the parameters that a search has found replace the present parameters.

    Args:
        differences: Mean cost of an episode with the new parameters minus mean cost with the present parameters, for
            each of n validation seeds, (n,), dimensionless.

    Returns:
        is_better: True if the cost is significantly smaller with the new parameters.
        report: Sentence with the decision and its reason.
    """
    difference = float(differences.mean())
    p_value = sign_flip_test(differences)
    is_better = difference < 0.0 and p_value <= SIGNIFICANT
    return is_better, (
        f"**{ADOPTED if is_better else KEPT}** On {len(differences)} validation seeds, 10 s a scenario, "
        f"an episode of the outcome costs {abs(difference):.3g} {'less' if difference < 0.0 else 'more'} than one "
        f"of those in force, p = {p_value:.2g}; it is adopted where it costs less with p of at "
        f"most {SIGNIFICANT:g}."
    )
