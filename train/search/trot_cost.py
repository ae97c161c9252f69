"""What a trot is worth in the search of its parameters, and the command map that undoes its response."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluate.measures.metrics import Measures, measure
from evaluate.rollouts.hardware import IDEAL, Hardware
from evaluate.rollouts.rollout import run
from policies.base import CONTROL_PERIOD, Actions, Floats, Policy
from policies.trot.open_loop import Trot, TrotParameters
from train.scenarios import practice
from train.search.command_map import response, undone, weakness
from train.search.evolution import EpisodeEffort

SCENARIO_WEIGHTS = {"flat": 0.5, "push": 0.25, "rough": 0.25}
ERROR_SCALES = {"velocity_error": 0.2, "mean_velocity_error": 0.12, "yaw_rate_error": 0.35, "overspeed": 0.02}
"""What counts as one unit of each error, m/s, m/s, rad/s, and of the share of joint readings above the rated speed.

Without the last the search leaves the robot behind that the motors could move: it stamps at 5 Hz in a deep crouch."""
WEAKEST_MAPPED = 0.1
"""Achieved per commanded velocity below which a response is not undone: the map would ask for leaps."""
MINIMUM_INTERVALS = 8
"""Command intervals needed to fit a response."""


class Panel(Policy):
    """Several policies side by side, each on its own equal share of the rows.

    Args:
        members: the policies, in the order of their shares.
        blocks: equal parts that the rows come in, such as one a scenario, in each of which each member has its share.
    """

    name = "panel"

    def __init__(self, members: Sequence[Policy], blocks: int = 1) -> None:
        super().__init__(robot=members[0].robot, control_period=members[0].control_period)
        self._members, self._blocks = members, blocks

    def _allocate(self, num_envs: int) -> None:
        for member in self._members:
            member.reset(num_envs // len(self._members))

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        shares = np.arange(len(observation)).reshape(self._blocks, len(self._members), -1)
        actions = np.empty((len(observation), self.robot.num_joints), np.float32)
        for number, member in enumerate(self._members):
            own = shares[:, number].ravel()
            actions[own] = member.act(observation[own])
        return actions


def episode_costs(measures: Measures) -> Floats:
    """Sum of the scaled errors of each episode, (episodes,); falls are billed within the errors."""
    total = np.zeros(len(measures.velocity_error))
    for name, scale in ERROR_SCALES.items():
        # A robot that fell within the first second has no overspeed: it is billed for all joints all the time.
        total += np.nan_to_num(getattr(measures, name), nan=1.0) / scale
    return total


def cost(measures: Measures, members: int) -> Floats:
    """Mean cost of each member's episodes, (members,)."""
    mean: Floats = episode_costs(measures).reshape(members, -1).mean(axis=1)
    return mean


def interval_response(measures: Measures) -> Floats:
    """Least-squares map from commanded (and 1) to achieved velocity, (4, 3), over the intervals walked to their end."""
    command, achieved = measures.commands.reshape(-1, 3), measures.mean_velocities.reshape(-1, 3)
    upright = np.isfinite(achieved).all(axis=1)
    if upright.sum() < MINIMUM_INTERVALS:
        return np.zeros((4, 3))
    return response(command[upright], achieved[upright])


def method(command: str, effort: EpisodeEffort, weights: Mapping[str, float]) -> list[str]:
    """How a search is made by that command, and what it bills on scenarios of those weights, for its account."""
    return [
        f"Written by `{command}`: CMA-ES, {effort.generations} generations of {effort.candidates} candidates, "
        f"{effort.episodes} episodes of {effort.steps * CONTROL_PERIOD:g} s a candidate on each of "
        f"{', '.join(f'{name} (weight {weight:g})' for name, weight in weights.items())}.",
        "Cost of an episode: "
        + " + ".join(f"{name} / {scale:g}" for name, scale in ERROR_SCALES.items())
        + "; falls are billed within the errors.",
    ]


def judge(
    candidates: list[TrotParameters], seeds: NDArray[np.int64], steps: int, threads: int, hardware: Hardware = IDEAL
) -> Floats:
    """Weighted cost of each candidate on all scenarios of a robot, (candidates,).

    A candidate is judged against its own linear response on flat ground, as if its command map were fitted already,
    and billed for a response that is too weak to be mapped.
    """
    members, robot = len(candidates), hardware.quadruped
    runs = {
        name: run(
            Panel([Trot(candidate, robot=robot) for candidate in candidates]),
            practice(name, "search", robot=robot),
            np.tile(seeds, members),
            nthread=threads,
            steps=steps,
            hardware=hardware,
        )
        for name in SCENARIO_WEIGHTS
    }
    flat = measure(runs["flat"])
    rows = np.split(np.arange(len(seeds) * members), members)
    maps = [
        interval_response(replace(flat, commands=flat.commands[r], mean_velocities=flat.mean_velocities[r]))
        for r in rows
    ]
    total = np.array([weakness(found) for found in maps])
    for name, weight in SCENARIO_WEIGHTS.items():
        target = np.concatenate([runs[name].command[:, r] @ m[:3] + m[3] for r, m in zip(rows, maps, strict=True)], 1)
        total += weight * cost(measure(replace(runs[name], command=target)), members)
    return total


def mapped(
    parameters: TrotParameters, seeds: NDArray[np.int64], threads: int, hardware: Hardware = IDEAL
) -> TrotParameters:
    """The same gait with the command map that undoes a robot's response to it on flat ground."""
    walks = walked(parameters, "flat", seeds, threads, hardware)
    return unless_weak(parameters, interval_response(walks))


def walked(
    parameters: TrotParameters, name: str, seeds: NDArray[np.int64], threads: int, hardware: Hardware
) -> Measures:
    """What a robot's episodes from those seeds measure on the scenario of that name."""
    robot = hardware.quadruped
    policy, scenario = Trot(parameters, robot=robot), practice(name, "search", robot=robot)
    return measure(run(policy, scenario, seeds, nthread=threads, hardware=hardware))


def unless_weak(parameters: TrotParameters, found: Floats) -> TrotParameters:
    """The parameters whose command map undoes the response `found`, (4, 3); unchanged where it is too weak for that."""
    try:
        if np.diag(found[:3]).min() < WEAKEST_MAPPED:
            raise ValueError("the response is too weak")
        return undone(parameters, found)
    except ValueError as error:
        # Not worth the loss of a long search.
        print(f"the command map stays as it is: {error}", file=sys.stderr)
        return parameters
