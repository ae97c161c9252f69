"""`python -m benchmarks.mpc`: what model-predictive control costs one robot, and many robots with their physics.

Robots walk on flat ground in search episodes. Beside the wall time stands the processor's: what else runs on the
machine lengthens the one, not the other.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.support.bars import check
from benchmarks.support.command import Common, Outcome, cell, command, table
from benchmarks.support.measure import Floats, interleave, spread
from evaluate.rollouts import rollout
from policies.base import Actions
from policies.mpc.parameters import searched_parameters
from policies.mpc.policy import MpcWbc
from policies.mpc.quadratic_program import Programs, Solutions, solve
from quad_env.cli.command_line import check_numbers
from quad_env.cli.launcher import launch
from quad_env.config import TaskConfig
from quad_env.seeding import episode_seeds

PERIOD = 1.0 / TaskConfig().control_rate
PLAN, TORQUES, ACTION = "plan's program, assembled and solved", "torques' program, solved", "the whole action"


@dataclass(frozen=True)
class Options(Common):
    """One robot's calls, and many robots in real time."""

    rounds: int = 5
    """Interleaved rounds of many robots (count)."""
    envs: tuple[int, ...] = (1, 16, 64)
    """Numbers of robots (count)."""
    threads: int = 2
    """Of the physics (count)."""
    steps: int = 200
    """Control steps of a round (count)."""
    calls: int = 1000
    """Of one robot, over which the percentiles are (count)."""
    plan_periods: tuple[float, ...] = (0.0, 0.02, 0.03)
    """Between two plans, s; 0 for one at every control step."""


class Timed(MpcWbc):
    """Keeps what its parts cost: pairs of wall and processor time, s."""

    def __init__(self, plan_period: float = 0.0) -> None:
        self.costs: dict[str, list[tuple[float, float]]] = {PLAN: [], TORQUES: [], ACTION: []}
        super().__init__(replace(searched_parameters(), plan_period=plan_period), solver=self._solved)

    def _solved(self, programs: Programs) -> Solutions:
        began = _clocks()
        found = solve(programs)
        if programs.equalities:
            self.costs[TORQUES].append(_since(began))
        return found

    def _plan(self, *arguments: Any, **named: Any) -> Any:
        began = _clocks()
        found = super()._plan(*arguments, **named)
        self.costs[PLAN].append(_since(began))
        return found

    def _act(self, observation: Actions) -> Actions:
        began = _clocks()
        actions = super()._act(observation)
        self.costs[ACTION].append(_since(began))
        return actions


def measure(options: Options) -> Outcome:
    """One robot's parts, then robots together."""
    if options.quick:
        options = replace(options, rounds=1, envs=(1, 2), steps=5, calls=10, plan_periods=(0.0,))
    check_numbers(options, {"steps": (1, rollout.STEPS), "plan_periods": (0.0, 0.2)})
    one = Timed()
    while len(one.costs[ACTION]) < options.calls:
        seeds = episode_seeds("search", len(one.costs[ACTION]), 1)
        rollout.roll_out(one, "flat", seeds, steps=min(options.calls, rollout.STEPS))
    parts = {name: 1e3 * np.array(pairs) for name, pairs in one.costs.items()}
    heads = ("median", "99th percentile", "median, processor", "99th, processor")
    rows = table("One robot, every call, ms", "", *heads)
    for name, both in parts.items():
        rows.add_row(name, *(f"{value:.3f}" for value in np.percentile(both, (50, 99), axis=0).T.ravel()))
    figures: dict[str, object] = {"one_robot_ms": {name: both.tolist() for name, both in parts.items()}}
    together = table("Robots with their physics, robot-seconds a second", "plan period, s", *map(str, options.envs))
    rates: dict[float, dict[int, Floats]] = {}
    for period in options.plan_periods:
        rates[period] = _rates(period, options)
        together.add_row(f"{period:g}", *(cell(spread(rates[period][n]), 1) for n in options.envs))
    figures["real_time"] = {str(period): {str(n): each for n, each in of.items()} for period, of in rates.items()}
    typical = rates[options.plan_periods[0]]
    most = max(options.envs)
    checks = (
        check("mpc solve", float(np.median(parts[PLAN][:, 0]))),
        check("mpc slow solve", float(np.percentile(parts[PLAN][:, 0], 99))),
        check("mpc real time", PERIOD * 1e3 / float(np.median(parts[ACTION][:, 0]))),
        check("mpc many robots", float(np.median(typical[most]))),
    )
    return Outcome(figures, (rows, together), checks)


def _rates(plan_period: float, options: Options) -> dict[int, Floats]:
    """Robot-seconds a second of wall time for each number of robots, (rounds,)."""

    def subject(count: int) -> float:
        policy = MpcWbc(replace(searched_parameters(), plan_period=plan_period))
        walked = [0]
        began = time.perf_counter()
        rollout.roll_out(
            policy,
            "flat",
            episode_seeds("search", 0, count),
            lambda step: walked.__setitem__(0, step.number) or False,
            steps=options.steps,
            nthread=options.threads,
        )
        return (time.perf_counter() - began) / (count * walked[0] * PERIOD)

    subjects = {str(count): (lambda count=count: subject(count)) for count in options.envs}
    title = f"mpc, a plan every {plan_period:g} s" if plan_period else "mpc, a plan every control step"
    return {int(count): 1.0 / seconds for count, seconds in interleave(subjects, options.rounds, title).items()}


def _clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def _since(began: tuple[float, float]) -> tuple[float, float]:
    wall, processor = _clocks()
    return wall - began[0], processor - began[1]


main = command(Options, measure, "benchmarks.mpc", __doc__)

if __name__ == "__main__":
    raise SystemExit(launch(main))
