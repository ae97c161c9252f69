"""The safety layer: `python -m research safety` prints the falls that it averts on the push axis and its false alarms.

Every episode is run without and with the layer from the same seed. A fall is averted if the same episode with the layer
ends upright or in a controlled stop; lead is the time from the layer's last alarm before it to the fall of the policy
alone. A false alarm is one in undisturbed walking: at the gait's own speed, and over the whole range of commands for a
policy that tracks commands.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

import policies
from evaluate.measures.at_rest import Motion, controlled_stops
from evaluate.rollouts.observers import Falls, Step
from evaluate.rollouts.rollout import STEPS, roll_out
from evaluate.statistics.intervals import wilson_interval
from policies.base import CONTROL_PERIOD, Policy
from policies.safety import Mode, Safe
from quad_env import OBSERVATION
from quad_env.cli.command_line import check_numbers
from quad_env.scenarios.axes import AXES
from quad_env.scenarios.named import Scenario, scenario
from quad_env.seeding import episode_seeds
from research.studies.gaits import SPEEDS

AT_ONCE = 256
"""Episodes simulated side by side."""


@dataclass(frozen=True)
class Options:
    """Score the safety layer."""

    policy: str = "trot"
    """Policy that it guards: a name, the folder of a trained one, or a file, as of python -m evaluate."""
    episodes: int = 64
    """Episodes at each level of the push axis, without and with the layer (count)."""
    hours: float = 2.0
    """Undisturbed walking, h of simulated time."""
    seed: int = 0
    """Which set of episodes (whole number from 0)."""
    seeds: Literal["search", "validation", "evaluation"] = "evaluation"
    """Family of seeds."""


@dataclass(frozen=True)
class Run:
    """Episodes of one policy, (n,) each."""

    fall_step: NDArray[np.int64]
    """STEPS where there was no fall."""
    fell: NDArray[np.bool_]
    """Fell, other than by a controlled stop."""
    stopped: NDArray[np.bool_]
    """Ended in a controlled stop."""
    alarms: tuple[NDArray[np.int64], ...]
    """Steps of the layer's alarms, in order, of each robot."""


def main(options: Options) -> int:
    """Score and print; the exit code."""
    check_numbers(options, {"episodes": (1, 65_536), "hours": (0.001, 1000.0), "seed": (0, 2**31)})
    policies.resolve(options.policy)
    _push_axis(options)
    _undisturbed(options)
    return 0


def _push_axis(options: Options) -> None:
    print(f"{'push':>9} {'falls':>6} {'averted':>8} {'of them stops':>14} {'new falls':>10} {'lead, s':>8}")
    falls = averted = 0
    for level, severity in enumerate(AXES["push"].levels):
        where = AXES["push"].scenario(severity, f"push:{level + 1}")
        seeds = episode_seeds(options.seeds, options.seed * 1000 + level, options.episodes)
        alone = run(policies.resolve(options.policy), where, seeds)
        guarded = run(Safe(policies.resolve(options.policy)), where, seeds)
        saved = alone.fell & ~guarded.fell
        leads = [lead(guarded.alarms[robot], alone.fall_step[robot]) for robot in np.flatnonzero(alone.fell)]
        middle = f"{np.median(leads):8.2f}" if leads else f"{'-':>8}"
        new = int((guarded.fell & ~alone.fell).sum())
        stops = int((saved & guarded.stopped).sum())
        print(f"{severity:5g} N·s {alone.fell.sum():6d} {saved.sum():8d} {stops:14d} {new:10d} {middle}", flush=True)
        falls, averted = falls + int(alone.fell.sum()), averted + int(saved.sum())
    low, high = wilson_interval(averted, falls)
    share = averted / falls if falls else float("nan")
    print(f"averted {averted} of {falls} falls: {share:.0%} (95 % Wilson {low:.0%} … {high:.0%})")


def _undisturbed(options: Options) -> None:
    count = max(1, round(options.hours * 3600 / (STEPS * CONTROL_PERIOD)))
    seeds = episode_seeds(options.seeds, options.seed * 1000 + 500, count)
    walks: dict[str, float | None] = {"any command": None}
    if options.policy in SPEEDS:
        walks[f"{SPEEDS[options.policy]:g} m/s"] = SPEEDS[options.policy]
    hours = count * STEPS * CONTROL_PERIOD / 3600
    for words, speed in walks.items():
        alarms = falls = 0
        for chunk in np.array_split(seeds, -(-count // AT_ONCE)):
            guarded = run(Safe(policies.resolve(options.policy)), scenario("flat"), chunk, forward=speed)
            alarms, falls = alarms + sum(map(len, guarded.alarms)), falls + int(guarded.fell.sum())
        found = f"{alarms} in {hours:.2f} h of undisturbed walking at {words}, {alarms / hours:.2f} an hour"
        print(f"false alarms: {found}; {falls} of {count} fell", flush=True)


def lead(alarms: NDArray[np.int64], fall_step: int) -> float:
    """Time from the last alarm before a fall to it, s; 0 without one."""
    before = alarms[alarms < fall_step]
    return float(fall_step - before[-1]) * CONTROL_PERIOD if len(before) else 0.0


def run(policy: Policy, where: str | Scenario, seeds: NDArray[np.int64], forward: float | None = None) -> Run:
    """One episode for each seed, side by side; with a forward command, m/s, or with the scenario's commands."""
    falls, watch = Falls(len(seeds), STEPS), _Watch()
    layer = [_Alarms(policy, falls)] if isinstance(policy, Safe) else []
    command = None if forward is None else (forward, 0.0, 0.0)
    roll_out(policy, where, seeds, falls, watch, *layer, steps=STEPS, command=command)
    stopped = controlled_stops(watch.motion(), falls.step, policy.control_period)
    raised = layer[0].steps() if layer else (np.empty(0, np.int64),) * len(seeds)
    return Run(falls.step, falls.fell & ~stopped, stopped, raised)


class _Watch:
    """Observer of the motion by which controlled stops differ from falls."""

    def __init__(self) -> None:
        self._rows: list[tuple[NDArray[np.floating], ...]] = []

    def __call__(self, step: Step) -> None:
        if step.number:
            speeds = np.abs(step.observation[:, OBSERVATION["joint_velocity"]]).max(axis=1)
            upright = -step.observation[:, OBSERVATION["projected_gravity"]][:, 2]
            self._rows.append((step.infos["height"], upright, step.infos["vertical_velocity"], speeds))

    def motion(self) -> Motion:
        """The finished record."""
        return Motion(*np.array(self._rows, np.float64).swapaxes(0, 1))


class _Alarms:
    """Observer of a safety layer's alarms before each robot's fall."""

    def __init__(self, policy: Safe, falls: Falls) -> None:
        self._policy, self._falls = policy, falls
        self._before = policy.mode
        self._raised: list[NDArray[np.bool_]] = []

    def __call__(self, step: Step) -> None:
        mode = self._policy.mode
        if step.number:
            new = (mode == Mode.CATCH) & (self._before == Mode.FOLLOW)
            self._raised.append(new & (self._falls.step >= step.number))
        self._before = mode

    def steps(self) -> tuple[NDArray[np.int64], ...]:
        """Index of the control step of each alarm, in order, of each robot."""
        return tuple(np.flatnonzero(robot) for robot in np.array(self._raised).T)
