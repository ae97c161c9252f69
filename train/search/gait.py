"""One of the gaits: the cost of its footfalls, motion and tracking, and the fit of its command map."""

import json
from dataclasses import asdict, replace

import numpy as np
from rich.progress import track

from evaluate.rollouts.observers import Step
from evaluate.rollouts.strides import Strides, walked
from policies.base import Floats
from policies.gaits.parameters import NO_LIMITS, OFFSETS, PARAMETERS_FILE, GaitParameters, searched_parameters
from policies.gaits.policy import Gaits
from quad_env.cli.command_line import UsageError
from quad_env.seeding import episode_seeds
from train.search.command_map import response, undone, weakness
from train.search.files import as_json
from train.search.subject import Effort, Options, Outcome, Ranges, Seeds, Subject, generations, rounded, unit_cube

_COMMON = {
    "frequency": (2.0, 3.6),
    "frequency_rise": (0.0, 1.5),
    "duty": (0.5, 0.65),
    "duty_fall": (0.0, 0.1),
    "body_height": (0.24, 0.44),
    "step_height": (0.04, 0.14),
    "stance_width": (0.4, 0.6),
    "stance_shift": (-0.15, 0.05),
    "servo_lead": (0.0, 0.04),
    "stance_load": (0.0, 1.5),
}
RANGES: dict[str, Ranges] = {
    "trot": _COMMON,
    "walk": _COMMON
    | {
        "frequency": (1.0, 2.2),
        "duty": (0.76, 0.82),
        "duty_fall": (0.0, 0.005),
        "stance_width": (0.4, 0.7),
        "sway": (0.0, 0.08),
    },
    "pace": _COMMON | {"sway": (0.0, 0.05), "frequency": (2.2, 3.6), "stance_width": (0.3, 0.6), "bounce": (0.0, 1.2)},
    "bound": _COMMON | {"frequency": (2.0, 3.2), "duty": (0.42, 0.52), "bounce": (0.0, 1.5)},
    "pronk": _COMMON | {"frequency": (1.8, 3.2), "duty": (0.45, 0.65), "bounce": (0.3, 1.4)},
}
"""Bounds of each gait's search by field name."""
TOP_SPEED = {"walk": 0.4}
"""Fastest forward command of the search, m/s, by gait; OTHER_TOP_SPEED for those not named."""
OTHER_TOP_SPEED = 0.8
SETTLING = 150
"""Control steps left out at the start of an episode."""
DUTY_SCALE, OFFSET_SCALE = 0.05, 0.05
"""What counts as one unit of the worst foot's error of duty factor and of phase, cycles."""
TILT_SCALE = 0.24
"""What counts as one unit of the largest tilt, rad."""
TARGET_RATE_SCALE = 15.0
"""What counts as one unit of the fastest target, rad/s."""
OVERSPEED_SCALE = 0.03
"""What counts as one unit of the share of joint readings above the rated speed."""
VELOCITY_SCALES = np.array([0.05, 0.05, 0.1])
"""What counts as one unit of the difference between mean velocity and linear response, m/s, m/s, rad/s."""
LARGEST_UNITS = 6.0
"""Largest cost of one error of an episode."""
FALL_COST = 40.0
FEWEST = 8
"""Episodes without a fall that a response can be fitted to."""
MAP_ROUNDS = 3
"""How often the command map is fitted again with the one before in force."""


def subject(options: Options, effort: Effort) -> Subject[GaitParameters]:
    """The search of a gait; the outcome is its part of the file of all gaits. Raises UsageError without a gait."""
    if options.gait is None:
        raise UsageError(f"--gait must be one of {', '.join(OFFSETS)}")
    gait, start = options.gait, searched_parameters()[options.gait]

    def costs(candidates: list[GaitParameters], seeds: Seeds) -> list[float]:
        command = commands(gait, len(seeds), np.random.default_rng(seeds))
        walks = shared_walk(gait, candidates, command, seeds, effort.steps, options.threads)
        return [cost(walk, command) for walk in walks]

    def conclude(found: GaitParameters) -> Outcome:
        after = fitted(gait, found, options, effort)
        gaits = searched_parameters() | {gait: after}
        text = json.dumps({name: asdict(gaits[name]) for name in sorted(OFFSETS)}, indent=2) + "\n"
        return Outcome(text, as_json(after))

    space = unit_cube(start, RANGES[gait], costs, generations(options.seed, effort))
    return Subject(start, PARAMETERS_FILE, conclude, space)


def fitted(gait: str, found: GaitParameters, options: Options, effort: Effort) -> GaitParameters:
    """The parameters with a command map fitted on fresh episodes, to four digits."""
    rng, count = np.random.default_rng((1, options.seed)), effort.check_episodes
    for done in track(range(MAP_ROUNDS), description="command map"):
        command = commands(gait, count, rng)
        seeds = episode_seeds("search", options.seed + 1_000_000 + done, count)
        (walk,) = shared_walk(gait, [found], command, seeds, 2 * effort.steps, options.threads)
        upright = ~walk.fell
        if upright.sum() < FEWEST:
            raise UsageError(f"the {gait} falls in {int(walk.fell.sum())} of {count} episodes; search on")
        found = undone(found, response(command[upright], walk.heading_velocity.mean(axis=0)[upright]))
    return rounded(found)


def commands(gait: str, count: int, rng: np.random.Generator) -> Floats:
    """Commands of `count` episodes, (count, 3): half straight forward, half anywhere in the gait's range."""
    top = TOP_SPEED.get(gait, OTHER_TOP_SPEED)
    straight = count // 2
    drawn: Floats = rng.uniform([-0.3 * top, -0.3, -0.6], [top, 0.3, 0.6], (count, 3))
    drawn[:straight] = 0.0
    drawn[:straight, 0] = top * np.linspace(0.3, 1.0, straight)
    return drawn


def shared_walk(
    gait: str, candidates: list[GaitParameters], command: Floats, seeds: Seeds, steps: int, threads: int
) -> list[Strides]:
    """Each candidate's strides on the same episodes, commands (n, 3) and seeds (n,), after they have settled.

    Limits of commands are off: the response is to the commands as given. All start in the stance of the gait in force.
    """
    members, unlimited = len(candidates), [replace(candidate, **NO_LIMITS) for candidate in candidates]
    member = np.repeat(np.arange(members), len(seeds))

    policy = Gaits(gait, parameters=dict.fromkeys(("stand", gait), searched_parameters()[gait]))

    def start(step: Step) -> None:
        if step.number == 0:
            for number, candidate in enumerate(unlimited):
                policy.request(gait, member == number, parameters=candidate)

    commands, every_seed = np.tile(command, (members, 1)), np.tile(seeds, members)
    found = walked(policy, commands, every_seed, start, steps=steps, nthread=threads).since(SETTLING)
    return [found.of(member == number) for number in range(members)]


def cost(strides: Strides, command: Floats) -> float:
    """Mean of the scaled errors over the episodes, plus the cost of a weak response to the commands (n, 3)."""
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
    off = np.abs(velocity[upright] - command[upright] @ found[:3] - found[3]).mean(axis=0)
    return total + float((off / VELOCITY_SCALES).sum() + weakness(found))
