"""Search of the parameters of policies with feedback by CMA-ES, for success on many scenarios.

The outcome is compared with the parameters in force on the same episodes of the "validation" family, which the search
has not seen, and adopted only where it is better. A search takes 26 minutes on one core, three times as long for
mpc_wbc. Candidates and their costs are in a file that ends in .trials.jsonl, a line for each generation.
"""

from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.progress import track

from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import Measures, measure
from evaluate.measures.outcomes import OUTCOMES, RULES, SUCCESS_RULE
from evaluate.measures.tracking import VELOCITY_CAP
from evaluate.rollouts.rollout import STEPS, Recorder, advance, batch_of, begin
from evaluate.statistics.significance import sign_flip_test
from policies.base import Floats, Policy
from policies.mpc import parameters as mpc_parameters
from policies.parameters import ParameterFile, Parameters, number
from policies.residual_bases import BASES
from policies.trot import feedback_parameters, integral
from quad_env.scenarios.scenario import Scenario
from quad_env.seeding import episode_seeds
from train.config import check_scenarios
from train.curriculum import Purpose, practice
from train.search.cmaes import (
    SHORTEST,
    Effort,
    Panel,
    Ranges,
    Seeds,
    Subject,
    as_json,
    changes,
    method,
    results,
    search,
)

EXERCISES = (
    *("flat=1.5", "flat=3", "push=35", "push=65", "rough=0.12", "rough=0.24", "slope=15", "slope=25", "stairs=0.1"),
    *("soft=0.02", "slippery=0.1", "force=60", "payload=20", "weak_motors=20", "slow_motors=5", "slow_motors=2"),
    *("latency=0.02", "latency=0.04", "latency=0.08", "noise=0.8", "surprise=1"),
)
"""Scenarios of the search, all of one weight: from where a trot succeeds to where it seldom does."""
OUTCOME_COSTS = dict(zip(OUTCOMES, (0.0, 1.0, 1.5, 2.0, 2.0, 2.0), strict=True))
"""Cost of an episode's outcome; the graded costs on top add up to less than the step to the next one."""
DEVIATION_COST, ERROR_COST, OVERSPEED_COST = 0.25, 0.15, 0.1
"""Largest graded cost: of the worst command interval, the velocity error, and the share of joint readings above the
rated speed, without which a search finds gaits that no motor could move."""
LARGEST_DEVIATION = 4.0
"""Deviation from the command, per allowed deviation, at which its cost is largest."""
LARGEST_OVERSPEED = 0.1
"""Share of joint readings above the rated speed at which their cost is largest."""
WORDS = (
    "Cost of an episode: "
    + ", ".join(f"{name} {cost:g}" for name, cost in OUTCOME_COSTS.items())
    + f", and on top of that up to {DEVIATION_COST:g} for the worst command interval, as a share of "
    f"{LARGEST_DEVIATION:g} times what is allowed, {ERROR_COST:g} for the velocity error, as a share of "
    f"{VELOCITY_CAP:g} m/s, and {OVERSPEED_COST:g} for overspeed, as a share of {LARGEST_OVERSPEED:g}."
)
"""The cost in words."""
SIGNIFICANT = 0.05
"""Largest p-value with which a smaller cost counts as smaller."""
ADOPTED, KEPT = "The outcome is adopted.", "Those in force are kept: the outcome is not better."
AT_ONCE = 7
"""Scenarios simulated at once: the more, the faster, and the more memory their records take."""


@dataclass(frozen=True)
class Searched:
    """A policy that can be searched."""

    file: ParameterFile[Any]
    ranges: Ranges

    @property
    def account(self) -> str:
        """Name of the account of a search."""
        return f"{self.file.path.stem.upper()}.md"


POLICIES = {
    "mpc_wbc": Searched(mpc_parameters.FILE, mpc_parameters.SEARCH_RANGES),
    "trot_feedback": Searched(feedback_parameters.FILE, feedback_parameters.SEARCH_RANGES),
    "trot_integral": Searched(integral.FILE, integral.SEARCH_RANGES),
}


@dataclass(frozen=True, kw_only=True)
class Options(Effort):
    """Which policy is searched, on what, and how thoroughly."""

    policy: Literal["mpc_wbc", "trot_feedback", "trot_integral"] = "trot_feedback"
    """Policy whose gait and gains are searched."""
    generations: int = number(22, limits=(0, 10_000))
    """Rounds; 0 only does what follows the search."""
    candidates: int = number(16, limits=(4, 1000))
    """Parameter sets tried in a round."""
    episodes: int = number(1, limits=(1, 10_000))
    """Episodes of a candidate in each scenario and round."""
    steps: int = number(500, limits=(SHORTEST, 100_000))
    """Length of an episode, control steps of 10 ms."""
    check_episodes: int = number(32, limits=(1, 10_000))
    """Fresh episodes on which the outcome is compared with the parameters before."""
    exercises: tuple[str, ...] = EXERCISES
    """Scenarios, all of one weight, such as flat push=42."""
    start: Path | None = None
    """Parameters that the search starts from, JSON, instead of those in force."""


def main(options: Options) -> int:
    """Search, conclude, write; the exit code. Raises UsageError."""
    return search(subject, options)


def subject(options: Options) -> Subject[Parameters]:
    """The search of a policy with feedback, from the parameters in force or given."""
    name, exercises = options.policy, options.exercises
    searched = POLICIES[name]
    check_scenarios("--exercises", exercises)
    file = searched.file
    start, in_force = (file.read(path) for path in (options.start or file.path, file.path))

    def made(parameters: Sequence[Parameters]) -> list[Policy]:
        return [BASES[name].make(parameters=each) for each in parameters]

    def costs(candidates: list[Parameters], seeds: Seeds) -> Floats:
        return candidate_costs(made(candidates), exercises, seeds, options.steps, options.threads)

    def conclude(after: Parameters) -> tuple[str, str]:
        seeds = episode_seeds("validation", options.seed, options.check_episodes)
        old, new = made((in_force, after))
        walks, differences = compared(old, new, exercises, seeds, options.threads)
        better, words = judged(differences)
        how = method("python -m research search", options, ", ".join(exercises))
        lines = [f"# The parameters of {name}", "", how, WORDS, ""]
        lines += [words, "", *changes(in_force, after, searched.ranges), "", *results(walks)]
        return as_json(after if better else in_force), "\n".join(lines) + "\n"

    return Subject(start, searched.ranges, costs, conclude, file.path, searched.account, digits=4, apart=True)


def episode_costs(measures: Measures) -> Floats:
    """Cost of each episode, (episodes,): of its outcome, and of how far it was from a better one."""
    outcome = np.array([OUTCOME_COSTS[each] for each in measures.outcome])
    deviation = RULES[SUCCESS_RULE].deviations(measures.commands, measures.mean_velocities)
    # An interval that was not completed has the largest cost.
    worst = np.minimum(np.nan_to_num(deviation, nan=np.inf), LARGEST_DEVIATION).max(axis=1) / LARGEST_DEVIATION
    overspeed = np.minimum(np.nan_to_num(measures.overspeed, nan=1.0) / LARGEST_OVERSPEED, 1.0)
    error = measures.velocity_error / VELOCITY_CAP
    graded: Floats = DEVIATION_COST * worst + ERROR_COST * error + OVERSPEED_COST * overspeed
    return outcome + graded


def candidate_costs(
    candidates: Sequence[Policy], exercises: Sequence[str], seeds: Seeds, steps: int, threads: int
) -> Floats:
    """Mean cost of each candidate over the scenarios and seeds, (candidates,)."""
    costs = [episode_costs(measures) for measures in walked(candidates, exercises, seeds, "search", steps, threads)]
    mean: Floats = np.reshape(costs, (len(exercises), len(candidates), -1)).mean(axis=(0, 2))
    return mean


def walked(
    members: Sequence[Policy],
    exercises: Sequence[str],
    seeds: Seeds,
    purpose: Purpose,
    steps: int = STEPS,
    threads: int = 1,
) -> list[Measures]:
    """Measures of episodes from those seeds on each scenario, on ground of that purpose, member after member."""
    panel, scenarios = Panel(members, len(exercises)), [practice(each, purpose) for each in exercises]
    every_seed = np.tile(seeds, len(members))
    return [measure(each) for each in run_each(panel, scenarios, every_seed, nthread=threads, steps=steps)]


def run_each(
    policy: Policy, scenarios: Sequence[str | Scenario], seeds: Seeds, *, nthread: int = 1, steps: int = STEPS
) -> list[Episodes]:
    """The records of one episode for each seed on each of the scenarios, all walked side by side.

    The policy acts for all at once, scenario after scenario: for one whose time hardly depends on how many robots it
    moves that is many times faster. What is the policy's own, such as its phase, is not in the records.
    """
    recorders = [Recorder(None, seeds, steps) for _ in scenarios]
    with ExitStack() as stack:
        envs = [batch_of(policy, scenario, len(seeds), steps=steps, nthread=nthread) for scenario in scenarios]
        for env in envs:
            stack.enter_context(closing(env))
            policy.check_fits(env.robot, env.dt)
        now = [begin(env, seeds, None) for env in envs]
        policy.reset(num_envs=len(envs) * len(seeds), seed=0)
        for recorder, step in zip(recorders, now, strict=True):
            recorder(step)
        going = list(range(len(envs)))
        while going:
            actions = np.split(policy.act(np.concatenate([step.observation for step in now])), len(envs))
            for number in going.copy():
                now[number], ended = advance(now[number], actions[number])
                recorders[number](now[number])
                if ended:  # its robots stay as they are
                    going.remove(number)
    return [recorder.episodes() for recorder in recorders]


def judged(differences: Floats) -> tuple[bool, str]:
    """Whether the outcome costs significantly less than the parameters in force, by the difference of each seed; the
    decision and its reason, in words."""
    difference, p_value = float(differences.mean()), sign_flip_test(differences)
    better = difference < 0.0 and p_value <= SIGNIFICANT
    return better, (
        f"**{ADOPTED if better else KEPT}** On {len(differences)} validation seeds, 10 s a scenario, "
        f"an episode of the outcome costs {abs(difference):.3g} {'less' if difference < 0.0 else 'more'} than one "
        f"of those in force, p = {p_value:.2g}; it is adopted where it costs less with p of at "
        f"most {SIGNIFICANT:g}."
    )


def compared(
    in_force: Policy, outcome: Policy, exercises: Sequence[str], seeds: Seeds, threads: int
) -> tuple[list[tuple[str, str, Measures]], Floats]:
    """Both on the same full episodes of those seeds, on ground of the validation: scenario, `before` for the parameters
    in force or `after`, and measures of each walk; cost of the outcome less that of those in force, mean over the
    scenarios, of each seed, (seeds,)."""
    walks: list[tuple[str, str, Measures]] = []
    differences = np.zeros(len(seeds))
    groups = [exercises[first : first + AT_ONCE] for first in range(0, len(exercises), AT_ONCE)]
    for group in track(groups, description="comparison"):
        before, after = (walked([each], group, seeds, "validation", threads=threads) for each in (in_force, outcome))
        for exercise, old, new in zip(group, before, after, strict=True):
            walks += [(exercise, "before", old), (exercise, "after", new)]
            differences += episode_costs(new) - episode_costs(old)
    return walks, differences / len(exercises)
