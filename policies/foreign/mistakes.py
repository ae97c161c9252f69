"""The usual mistakes in a policy's description, each undone, and what is to be corrected in it then."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.foreign.description import PolicyDescription
from policies.foreign.joints import joints_of
from quad_env.cli.format import spread
from quad_env.robots.anatomy import JOINTS_PER_LEG
from quad_env.robots.robot import Robot

Order = NDArray[np.intp]
"""Places of joints among the robot's, (12,)."""
Names = tuple[str, ...]

SIDES, ENDS, GROUPING = "left and right", "fore and hind", "by kind or by leg"
FRAMES, GRAVITY, GAINS = "frame of velocities", "sign of gravity", "servo gains"
MISTAKES = SIDES, ENDS, GROUPING, FRAMES, GRAVITY, GAINS
"""Whatever may be in each other's place; the first three of the joints."""
IN_ORDER = "default_position", "action_scale", "stiffness", "damping", "action_offset", "target_clip"
"""What a description gives in the order of its `joints`."""
VELOCITIES = "linear_velocity", "angular_velocity"
FACTORS = 0.2, 0.45, 2.2, 5.0
"""Of the described servo gains, where the policy's are not known."""
ALIKE = 0.2
"""Largest difference between gains that are taken for the same, as a share."""
_OTHER = {SIDES: str.maketrans("lr", "rl"), ENDS: str.maketrans("fh", "hf")}


@dataclass(frozen=True)
class Correction:
    """A description without one of the mistakes."""

    mistake: str
    """What is undone."""
    words: str
    """What the policy then runs with."""
    keys: str
    """What to correct in the description."""
    description: PolicyDescription


def corrections(described: PolicyDescription, robot: Robot) -> Iterator[Correction]:
    """Each of MISTAKES undone by itself, some in several ways."""
    for mistake in (SIDES, ENDS, GROUPING):
        yield from _reordered(described, (mistake,), robot)
    yield from _reframed(described)
    yield from _turned(described)
    yield from _with_other_gains(described, robot)


def combined(described: PolicyDescription, robot: Robot) -> Iterator[Correction]:
    """Two or three mistakes of the joints' order undone at once, by which Isaac Lab's order is not Unitree's."""
    for count in (2, 3):
        for mistakes in combinations((SIDES, ENDS, GROUPING), count):
            yield from _reordered(described, mistakes, robot)


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


def _changed(order: Order, mistake: str, robot: Robot) -> Order:
    """Those joints without that mistake."""
    if mistake == GROUPING:
        by_leg, by_kind = _grouped(order)
        return by_kind if np.array_equal(order, by_leg) else by_leg
    others = np.array([robot.leg_names.index(leg.translate(_OTHER[mistake])) for leg in robot.leg_names])
    return JOINTS_PER_LEG * others[order // JOINTS_PER_LEG] + order % JOINTS_PER_LEG


def _reordered(described: PolicyDescription, mistakes: Names, robot: Robot) -> Iterator[Correction]:
    """Other names for the joints; and then their figures in the order of their names, where that is another."""
    called = dict(zip(joints_of(described.joints, robot).places.tolist(), described.joints, strict=True))

    def names(joints: Names) -> Names:
        order = joints_of(joints, robot).places
        for mistake in mistakes:
            order = _changed(order, mistake, robot)
        return tuple(called[place] for place in order.tolist())

    joints = names(described.joints)
    observed = None if described.observed_joints is None else names(described.observed_joints)
    alone = replace(described, joints=joints, observed_joints=observed)
    kind, words = " and ".join(mistakes), order_of(joints, robot)
    yield Correction(kind, f"the joint order {words}", "`joints`", alone)
    moved = [described.joints.index(name) for name in joints]
    figures: dict[str, Any] = {name: getattr(described, name) for name in IN_ORDER}
    figures = {name: values and tuple(values[place] for place in moved) for name, values in figures.items()}
    if (together := replace(alone, **figures)) != alone:
        keys = "`joints` and what is in its order"
        yield Correction(kind, f"joints and their figures in the order {words}", keys, together)


def _reframed(described: PolicyDescription) -> Iterator[Correction]:
    """All velocities in the body's frame, and in the world's; and each alone in the other one."""
    frames: dict[str, Any] = {term.name: term.frame for term in described.terms if term.name in VELOCITIES}
    others: list[dict[str, Any]] = [dict.fromkeys(frames, frame) for frame in ("body", "world")]
    others += [frames | {name: "world" if frame == "body" else "body"} for name, frame in frames.items()]
    for place, found in enumerate(others):
        if found == frames or found in others[:place]:
            continue
        terms = tuple(replace(term, frame=found.get(term.name, term.frame)) for term in described.terms)
        names = " and ".join(name for name in frames if found[name] != frames[name])
        frame = next(found[name] for name in frames if found[name] != frames[name])
        yield Correction(
            FRAMES, f"{names} in the {frame} frame", f"`frame` of {names}", replace(described, terms=terms)
        )


def _turned(described: PolicyDescription) -> Iterator[Correction]:
    """Gravity the other way."""
    terms = tuple(
        replace(term, scale=tuple(-each for each in term.scale)) if term.name == "projected_gravity" else term
        for term in described.terms
    )
    if terms != described.terms:
        words = "projected_gravity the other way"
        yield Correction(GRAVITY, words, "the sign of `scale` of projected_gravity", replace(described, terms=terms))


def _with_other_gains(described: PolicyDescription, robot: Robot) -> Iterator[Correction]:
    """The robot's own servo gains, where those of the policy are not the same; and gains far off."""
    own = joints_of(described.joints, robot).places
    gains = np.array((described.stiffness, described.damping))
    robots = np.array([np.broadcast_to(each, 12)[own] for each in (robot.servo_stiffness, robot.servo_damping)])
    others = [] if np.allclose(robots, gains, rtol=ALIKE) else [robots]
    for stiffness, damping in (each.tolist() for each in (*others, *(factor * gains for factor in FACTORS))):
        words = f"servo gains of {spread(stiffness)} N·m/rad and {spread(damping)} N·m·s/rad"
        found = replace(described, stiffness=tuple(stiffness), damping=tuple(damping))
        yield Correction(GAINS, words, "`stiffness` and `damping`", found)
