"""The usual mistakes in a policy's description, each undone, and what is to be corrected in it then."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from policies.foreign.described import with_gains
from policies.foreign.description import OF_JOINTS, PolicyDescription, Term
from policies.foreign.joints import joints_of
from quad_env.robots.anatomy import JOINTS_PER_LEG
from quad_env.robots.robot import Robot

Order = NDArray[np.intp]
"""Places of joints among the robot's, (12,)."""
Names = tuple[str, ...]

ORDERS = SIDES, ENDS, GROUPING = "left and right", "fore and hind", "joints by kind or by leg"
MISTAKES = (*ORDERS, FRAMES := "frame of velocities", GRAVITY := "sign of gravity", GAINS := "servo gains")
"""What may be the other way round, or another's."""
FACTORS = 0.2, 0.45, 2.2, 5.0
"""Of the described servo gains, where the policy's are not known."""
_OTHER = {SIDES: str.maketrans("lr", "rl"), ENDS: str.maketrans("fh", "hf")}
_FRAMES: tuple[Literal["body", "world"], ...] = ("body", "world")


@dataclass(frozen=True)
class Correction:
    """A description without one of the mistakes, or without several in the order of the joints."""

    mistake: str
    words: str
    """What the policy then runs with."""
    keys: str
    """What to correct in the description."""
    description: PolicyDescription


def corrections(described: PolicyDescription, robot: Robot, count: int = 1) -> Iterator[Correction]:
    """Each of MISTAKES undone; or so many of ORDERS together, by which Isaac Lab's order differs from Unitree's."""
    for mistakes in combinations(ORDERS, count):
        yield from _reordered(described, mistakes, robot)
    if count == 1:
        yield from _reframed(described)
        yield from _turned(described)
        yield from _with_other_gains(described, robot)


def order_of(joints: Names, robot: Robot) -> str:
    """The order of a description's joints in words, such as `FL FR RL RR by leg`."""
    order = joints_of(joints, robot).places
    legs = dict.fromkeys(robot.leg_names[place // JOINTS_PER_LEG] for place in order.tolist())
    by_leg, by_kind = _grouped(order)
    grouping = "by leg" if np.array_equal(order, by_leg) else "by kind" if np.array_equal(order, by_kind) else "mixed"
    return f"{' '.join(legs).upper().replace('H', 'R')} {grouping}"


def _grouped(order: Order) -> tuple[Order, Order]:
    """Those joints by leg and by kind; legs, and joints of a leg, in the order in which they come first."""
    parts = np.divmod(order, JOINTS_PER_LEG)
    legs, links = (np.unique(part, return_index=True)[1][part] for part in parts)  # where each comes first
    return order[np.lexsort((links, legs))], order[np.lexsort((legs, links))]


def _changed(joints: Names, mistakes: Names, robot: Robot) -> Names:
    """Those joints without the mistakes in their order."""
    order = before = joints_of(joints, robot).places
    for mistake in mistakes:
        if mistake == GROUPING:
            by_leg, by_kind = _grouped(order)
            order = by_kind if np.array_equal(order, by_leg) else by_leg
        else:
            others = np.array([robot.leg_names.index(leg.translate(_OTHER[mistake])) for leg in robot.leg_names])
            order = JOINTS_PER_LEG * others[order // JOINTS_PER_LEG] + order % JOINTS_PER_LEG
    return tuple(joints[np.flatnonzero(before == place)[0]] for place in order)


def _reordered(described: PolicyDescription, mistakes: Names, robot: Robot) -> Iterator[Correction]:
    """Other names for the joints; and then their figures in the order of their names, where that is another."""
    joints, observed = _changed(described.joints, mistakes, robot), described.observed_joints
    observed = observed and _changed(observed, mistakes, robot)
    alone = replace(described, joints=joints, observed_joints=observed)
    kind, words = " and ".join(mistakes), order_of(joints, robot)
    yield Correction(kind, f"the joint order {words}", "`joints`", alone)
    moved = [described.joints.index(name) for name in joints]
    figures: dict[str, Any] = {name: getattr(described, name) for name in OF_JOINTS}
    figures = {name: values and tuple(values[place] for place in moved) for name, values in figures.items()}
    if (together := replace(alone, **figures)) != alone:
        words = f"joints and their figures in the order {words}"
        yield Correction(kind, words, "`joints` and what is in its order", together)


def _reframed(described: PolicyDescription) -> Iterator[Correction]:
    """The velocities in the body's frame and in the world's, both of them and each alone."""
    both = "linear_velocity", "angular_velocity"
    for frame in _FRAMES:
        for names in (both, both[:1], both[1:]):
            changed = tuple(replace(term, frame=frame) if term.name in names else term for term in described.terms)
            if changed != described.terms:
                which = " and ".join(term.name for term in changed if term.name in names)
                keys, words = f"`frame` of {which}", f"{which} in the {frame} frame"
                yield Correction(FRAMES, words, keys, replace(described, terms=changed))


def _turned(described: PolicyDescription) -> Iterator[Correction]:
    """Gravity the other way."""

    def turned(term: Term) -> Term:
        other = replace(term, scale=tuple(-each for each in term.scale))
        return other if term.name == "projected_gravity" else term

    if (terms := tuple(map(turned, described.terms))) != described.terms:
        words, keys = "projected_gravity the other way", "the sign of `scale` of projected_gravity"
        yield Correction(GRAVITY, words, keys, replace(described, terms=terms))


def _with_other_gains(described: PolicyDescription, robot: Robot) -> Iterator[Correction]:
    """The robot's own servo gains, and gains far off."""
    own, gains = joints_of(described.joints, robot).places, np.array((described.stiffness, described.damping))
    robots = np.array((robot.servo_stiffness, robot.servo_damping))[:, own]
    for stiffness, damping in (each.tolist() for each in (robots, *(factor * gains for factor in FACTORS))):
        changed = replace(described, stiffness=tuple(stiffness), damping=tuple(damping))
        words = f"servo gains of {with_gains(robot, changed).servo}"
        yield Correction(GAINS, words, "`stiffness` and `damping`", changed)
