"""What a gait's numbers are worth in their search: does the robot step as the gait says, and go where it is sent."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.observers import Step
from evaluate.rollouts.strides import Strides, walked
from policies.base import Floats
from policies.gaits.parameters import NO_LIMITS, GaitParameters, searched_parameters
from policies.gaits.policy import Gaits
from train.search.command_map import response, weakness

TOP_SPEED = {"walk": 0.4}
"""Fastest forward command of the search, m/s, by gait; OTHER_TOP_SPEED for those not named."""
OTHER_TOP_SPEED = 0.8
SETTLING = 150
"""Control steps that are not judged."""
DUTY_SCALE, OFFSET_SCALE = 0.05, 0.05
"""What counts as one unit of the worst foot's error of duty factor and of phase, cycles."""
TILT_SCALE = 0.24
"""What counts as one unit of the largest tilt, rad."""
TARGET_RATE_SCALE = 15.0
"""What counts as one unit of the fastest target, rad/s."""
OVERSPEED_SCALE = 0.03
"""What counts as one unit of the share of joint readings above the rated speed."""
VELOCITY_SCALES = np.array([0.05, 0.05, 0.1])
"""What counts as one unit of the mean velocity beside the robot's own linear response, m/s, m/s, rad/s."""
LARGEST_UNITS = 6.0
"""Most that one error of an episode is billed."""
FALL_COST = 40.0
FEWEST = 8
"""Episodes without a fall that a response can be fitted to."""


def commands(gait: str, count: int, rng: np.random.Generator) -> Floats:
    """Commands of `count` episodes, (count, 3): half straight ahead, half all over the gait's range."""
    top = TOP_SPEED.get(gait, OTHER_TOP_SPEED)
    straight = count // 2
    drawn: Floats = rng.uniform([-0.3 * top, -0.3, -0.6], [top, 0.3, 0.6], (count, 3))
    drawn[:straight] = 0.0
    drawn[:straight, 0] = top * np.linspace(0.3, 1.0, straight)
    return drawn


def shared_walk(
    gait: str, candidates: list[GaitParameters], command: Floats, seeds: NDArray[np.int64], steps: int, threads: int
) -> list[Strides]:
    """The settled part of the same episodes, commands (n, 3) and seeds (n,), walked by each candidate side by side.

    They follow every command, whatever their limits: a response to slower commands than asked for would be another's.
    All begin in the stance of the gait in force.
    """
    members, unlimited = len(candidates), [replace(candidate, **NO_LIMITS) for candidate in candidates]
    member = np.repeat(np.arange(members), len(seeds))

    policy = Gaits(gait, parameters=dict.fromkeys(("stand", gait), searched_parameters()[gait]))

    def begin(step: Step) -> None:
        if step.number == 0:
            for number, candidate in enumerate(unlimited):
                policy.request(gait, member == number, parameters=candidate)

    commands, every_seed = np.tile(command, (members, 1)), np.tile(seeds, members)
    found = walked(policy, commands, every_seed, begin, steps=steps, nthread=threads).since(SETTLING)
    return [found.of(member == number) for number in range(members)]


def cost(strides: Strides, command: Floats) -> float:
    """Mean over the episodes of the scaled errors, plus what the response to the commands (n, 3) lacks."""
    units = (
        np.minimum(np.abs(strides.duty_errors()).max(axis=1) / DUTY_SCALE, LARGEST_UNITS)
        + np.minimum(np.nan_to_num(np.abs(strides.offset_errors()).max(axis=1), nan=1.0) / OFFSET_SCALE, LARGEST_UNITS)
        + np.minimum(strides.tilt.max(axis=0) / TILT_SCALE, LARGEST_UNITS)
        + strides.target_rate / TARGET_RATE_SCALE
        + strides.overspeed.mean(axis=0) / OVERSPEED_SCALE
    )
    total = float(np.where(strides.fell, FALL_COST, units).mean())
    upright = ~strides.fell
    if upright.sum() < FEWEST:
        return total + FALL_COST
    velocity = strides.heading_velocity.mean(axis=0)
    found = response(command[upright], velocity[upright])
    beside = np.abs(velocity[upright] - command[upright] @ found[:3] - found[3]).mean(axis=0)
    return total + float((beside / VELOCITY_SCALES).sum() + weakness(found))
