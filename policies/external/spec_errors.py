"""The usual mistakes in a policy's description, each undone, and what is to be corrected in it then."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from policies.external.joint_mapping import map_joints
from policies.external.network_policy import with_spec_gains
from policies.external.spec import JOINT_FIELDS, Numbers, ObservationTerm, PolicySpec
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG

JointOrder = NDArray[np.intp]
"""Places of joints among the robot's, (12,)."""
Names = tuple[str, ...]

ORDERS = SIDES, ENDS, GROUPING = "left and right", "fore and hind", "joints by kind or by leg"
COMMON_ERRORS = (
    *ORDERS,
    FRAMES := "frame of velocities",
    GRAVITY := "sign of gravity",
    SCALES := "scales of observations",
    ACTIONS := "scale of actions",
    SIGNS := "signs of joints",
    HISTORY := "direction of the history",
    RATE := "control rate",
    PREVIOUS := "previous action raw or scaled",
    POSITIONS := "zero of joint positions",
    TERMS := "order of the terms",
    OBSERVED := "order of observed joints",
    CLOCK := "gait clock",
    GAINS := "servo gains",
)
"""What may be the other way round, or another's."""
GAIN_FACTORS = 0.2, 0.45, 2.2, 5.0
"""Of the described servo gains, where the policy's are not known."""
SINGLE_GAIN_FACTORS = 0.1, 10.0
"""Factors on the described stiffness or damping alone."""
ACTION_FACTORS = 0.25, 0.5, 2.0, 4.0
"""Factors on the described action scale."""
HIP_FACTORS = 0.5, 2.0
"""Factors on the described action scale of the hips: legged_gym's forks reduce it."""
RATES = 25.0, 100 / 3, 50.0, 100.0
"""Hz. Usual control rates."""
LEGGED_GYM_SCALES: dict[str, Numbers] = {
    "linear_velocity": (2.0,),
    "angular_velocity": (0.25,),
    "joint_velocity": (0.05,),
    "command": (2.0, 2.0, 0.25),
    "height_scan": (5.0,),
}
"""Scales of observation terms; other projects have 1."""
LAYOUTS = (
    (
        "linear_velocity",
        "angular_velocity",
        "projected_gravity",
        "command",
        *(OF_STATE := ("joint_position", "absolute_joint_position", "joint_velocity", "previous_action")),
    ),
    ("linear_velocity", "angular_velocity", "projected_gravity", *OF_STATE, "command"),
    ("command", "linear_velocity", "angular_velocity", "projected_gravity", *OF_STATE),
    ("angular_velocity", "linear_velocity", "projected_gravity", "command", *OF_STATE),
    ("projected_gravity", "angular_velocity", "linear_velocity", "command", *OF_STATE),
)
"""Orders of the terms in legged_gym and Isaac Lab, in mjlab and MuJoCo Playground, in HIMLoco, and in others."""
_OTHER = {SIDES: str.maketrans("lr", "rl"), ENDS: str.maketrans("fh", "hf")}
_FRAMES: tuple[Literal["body", "world"], ...] = ("body", "world")
_LINKS = "hip", "thigh", "calf"


@dataclass(frozen=True)
class Correction:
    """A description without one of the mistakes, or without several in the order of the joints."""

    error: str
    changed_setting: str
    """What the policy then runs with."""
    keys_to_correct: str
    """What to correct in the description."""
    spec: PolicySpec
    penalty: float = 0.0
    """Added to the deviation of its walk before corrections are compared."""


PENALTIES = {
    ACTIONS: 0.25,
    SIGNS: 0.1,
    PREVIOUS: 0.2,
    POSITIONS: 0.2,
    OBSERVED: 0.3,
    TERMS: 0.4,
    RATE: 0.3,
    CLOCK: 0.3,
    GAINS: 0.3,
}
"""Doubts of corrections by mistake. Smaller actions and other servos, rates and clocks improve walks with another
cause; so does another order of terms that the network hardly needs.
"""
MIRRORED_PENALTY = 0.4
"""Added where the default position turns with the signs: the same network then walks differently."""
ROBOT_GAINS_PENALTY = 0.1
"""Added for the robot's own gains, which often suit a policy as well as its own."""


def corrections(described: PolicySpec, robot: Robot, count: int = 1) -> Iterator[Correction]:
    """Each of MISTAKES undone; or so many of ORDERS together, by which Isaac Lab's order differs from Unitree's."""
    seen = [described]
    for correction in _all(described, robot, count):
        if correction.spec not in seen:
            seen.append(correction.spec)
            yield replace(correction, penalty=correction.penalty + PENALTIES.get(correction.error, 0.0))


def second_corrections(first: Correction, robot: Robot) -> Iterator[Correction]:
    """Yield a second correction of another kind on top of a first one."""
    for second in corrections(first.spec, robot):
        if second.error != first.error:
            yield Correction(
                f"{first.error} and {second.error}",
                f"{first.changed_setting} and {second.changed_setting}",
                f"{first.keys_to_correct} and {second.keys_to_correct}",
                second.spec,
                first.penalty + second.penalty,
            )


def _all(described: PolicySpec, robot: Robot, count: int) -> Iterator[Correction]:
    for mistakes in combinations(ORDERS, count):
        yield from _reordered(described, mistakes, robot)
    if count > 1:
        return
    for undo in (
        _reframed,
        _turned,
        _with_other_scales,
        _with_other_actions,
        _with_other_timing,
        _with_other_numbers,
        _with_other_term_order,
    ):
        yield from undo(described)
    yield from _with_other_signs(described, robot)
    yield from _with_other_observed_order(described, robot)
    yield from _with_other_gains(described, robot)


def joint_order_in_words(joints: Names, robot: Robot) -> str:
    """The order of a description's joints in words, such as `FL FR RL RR by leg`."""
    order = map_joints(joints, robot).joint_ids
    legs = dict.fromkeys(robot.leg_names[place // JOINTS_PER_LEG] for place in order.tolist())
    by_leg, by_kind = _grouped(order)
    grouping = "by leg" if np.array_equal(order, by_leg) else "by kind" if np.array_equal(order, by_kind) else "mixed"
    return f"{' '.join(legs).upper().replace('H', 'R')} {grouping}"


def _grouped(order: JointOrder) -> tuple[JointOrder, JointOrder]:
    """Those joints by leg and by kind; legs, and joints of a leg, in the order in which they come first."""
    parts = np.divmod(order, JOINTS_PER_LEG)
    legs, links = (np.unique(part, return_index=True)[1][part] for part in parts)  # where each comes first
    return order[np.lexsort((links, legs))], order[np.lexsort((legs, links))]


def _changed(joints: Names, mistakes: Iterable[str], robot: Robot) -> Names:
    """Those joints without the mistakes in their order."""
    order = before = map_joints(joints, robot).joint_ids
    for mistake in mistakes:
        if mistake == GROUPING:
            by_leg, by_kind = _grouped(order)
            order = by_kind if np.array_equal(order, by_leg) else by_leg
        else:
            others = np.array([robot.leg_names.index(leg.translate(_OTHER[mistake])) for leg in robot.leg_names])
            order = JOINTS_PER_LEG * others[order // JOINTS_PER_LEG] + order % JOINTS_PER_LEG
    return tuple(joints[np.flatnonzero(before == place)[0]] for place in order)


def _reordered(described: PolicySpec, mistakes: Names, robot: Robot) -> Iterator[Correction]:
    """Other names for the joints; and then their figures in the order of their names, where that is another."""
    joints, observed = _changed(described.joints, mistakes, robot), described.observed_joints
    observed = observed and _changed(observed, mistakes, robot)
    alone = replace(described, joints=joints, observed_joints=observed)
    kind, words = " and ".join(mistakes), joint_order_in_words(joints, robot)
    yield Correction(kind, f"the joint order {words}", "`joints`", alone)
    moved = [described.joints.index(name) for name in joints]
    figures: dict[str, Any] = {name: getattr(described, name) for name in JOINT_FIELDS}
    figures = {name: values and tuple(values[place] for place in moved) for name, values in figures.items()}
    if (together := replace(alone, **figures)) != alone:
        words = f"joints and their figures in the order {words}"
        yield Correction(kind, words, "`joints` and what is in its order", together)


def _with_other_observed_order(described: PolicySpec, robot: Robot) -> Iterator[Correction]:
    """Yield other orders of the observed joints alone: the actions' order, or one without a mistake in an order."""
    own = described.observed_joints or described.joints
    orders = [described.joints, *(_changed(own, (mistake,), robot) for mistake in ORDERS)]
    for order in orders:
        words = f"joints observed in the order {joint_order_in_words(order, robot)}"
        observed = order if order != described.joints else None
        yield Correction(OBSERVED, words, "`observed_joints`", replace(described, observed_joints=observed))


def _with_terms(described: PolicySpec, change: Callable[[ObservationTerm], ObservationTerm]) -> PolicySpec:
    """Return the description with each of its terms changed."""
    return replace(described, terms=tuple(map(change, described.terms)))


def _reframed(described: PolicySpec) -> Iterator[Correction]:
    """The velocities in the body's frame and in the world's, both of them and each alone."""
    both = "linear_velocity", "angular_velocity"
    for frame in _FRAMES:
        for names in (both, both[:1], both[1:]):
            changed = tuple(replace(term, frame=frame) if term.name in names else term for term in described.terms)
            if changed != described.terms:
                which = " and ".join(term.name for term in changed if term.name in names)
                keys, words = f"`frame` of {which}", f"{which} in the {frame} frame"
                yield Correction(FRAMES, words, keys, replace(described, terms=changed))


def _turned(described: PolicySpec) -> Iterator[Correction]:
    """Gravity the other way."""

    def turned(term: ObservationTerm) -> ObservationTerm:
        other = replace(term, scale=tuple(-each for each in term.scale))
        return other if term.name == "projected_gravity" else term

    words = "projected_gravity the other way"
    keys = "the sign of `scale` of projected_gravity"
    yield Correction(GRAVITY, words, keys, _with_terms(described, turned))


def _with_other_scales(described: PolicySpec) -> Iterator[Correction]:
    """Yield each scale of an observation as in legged_gym, as 1, or times a factor; and all of them together."""
    for name, theirs in LEGGED_GYM_SCALES.items():
        for term in described.terms:
            if term.name != name:
                continue
            less = tuple(mine * each for mine, each in _pairs(term.scale, theirs))
            more = tuple(mine / each for mine, each in _pairs(term.scale, theirs))
            for scale in (theirs, (1.0,), less, more):
                words = f"{name} scaled by {_numbers(scale)}"
                changed = _with_terms(described, _scaled({name: scale}))
                yield Correction(SCALES, words, f"`scale` of {name}", changed)
    ones: dict[str, Numbers] = dict.fromkeys(LEGGED_GYM_SCALES, (1.0,))
    for words, scales in (
        ("legged_gym's scales of observations", LEGGED_GYM_SCALES),
        ("no scales of observations", ones),
    ):
        yield Correction(SCALES, words, "`scale` of all terms", _with_terms(described, _scaled(scales)))


def _pairs(mine: Numbers, theirs: Numbers) -> Iterable[tuple[float, float]]:
    """Return pairs of two scales, where one number stands for all."""
    width = max(len(mine), len(theirs))
    return zip(mine * (width // len(mine)), theirs * (width // len(theirs)), strict=True)


def _scaled(scales: dict[str, Numbers]) -> Callable[[ObservationTerm], ObservationTerm]:
    """Return a function that gives terms those scales, with limits that clip at the same values."""
    return lambda term: replace(term, scale=scales[term.name]) if term.name in scales else term


def _numbers(values: Numbers) -> str:
    """Return numbers in words: one for all, each of a few, or the least and the largest."""
    if len({*values}) == 1:
        return f"{values[0]:g}"
    if len(values) > 3:
        return f"{min(values):g} to {max(values):g}"
    return " ".join(f"{value:g}" for value in values)


def _with_other_actions(described: PolicySpec) -> Iterator[Correction]:
    """Yield other action scales, and actions without the default position as an offset."""
    for factor in ACTION_FACTORS:
        scale = tuple(factor * each for each in described.action_scale)
        words = f"an action_scale of {_numbers(scale)}"
        yield Correction(ACTIONS, words, "`action_scale`", replace(described, action_scale=scale))
    hips = ["hip" in name.lower() or "haa" in name.lower() or name.lower().endswith("hx") for name in described.joints]
    for factor in HIP_FACTORS if sum(hips) == 4 else ():
        scale = tuple(factor * each if hip else each for each, hip in zip(described.action_scale, hips, strict=True))
        words = f"{factor:g} times the action_scale of the hips"
        yield Correction(ACTIONS, words, "`action_scale`", replace(described, action_scale=scale))
    zeros = (0.0,) * len(described.joints)
    for words, offset in (("targets from the default position", None), ("targets from zero", zeros)):
        yield Correction(POSITIONS, words, "`action_offset`", replace(described, action_offset=offset))


def _with_other_timing(described: PolicySpec) -> Iterator[Correction]:
    """Yield other control rates, and a history in another direction or layout."""
    for rate in dict.fromkeys((*RATES, 0.5 * described.control_rate, min(2.0 * described.control_rate, RATES[-1]))):
        words = f"a control rate of {rate:.4g} Hz"
        yield Correction(RATE, words, "`control_rate`", replace(described, control_rate=rate))
    if all(term.history == 1 for term in described.terms):
        return
    newest: Literal["first", "last"] = "last" if described.history_newest == "first" else "first"
    layout: Literal["term", "time"] = "time" if described.history_layout == "term" else "term"
    words = f"the newest step of the history {newest}"
    keys = "`history_newest`"
    reversed_ = replace(described, history_newest=newest)
    yield Correction(HISTORY, words, keys, reversed_)
    if layout == "term" or len({term.history for term in described.terms}) == 1:
        by = f"the history by {layout}"
        yield Correction(HISTORY, by, "`history_layout`", replace(described, history_layout=layout))
        together = replace(reversed_, history_layout=layout)
        yield Correction(HISTORY, f"{by} and {words}", f"`history_layout` and {keys}", together)


def _with_other_numbers(described: PolicySpec) -> Iterator[Correction]:
    """Yield the other meaning of the previous action, another zero of joint positions, and other clock settings."""
    names = {term.name for term in described.terms}
    if "previous_action" in names:
        other: Literal["raw", "scaled"] = "scaled" if described.previous_action == "raw" else "raw"
        words = f"the previous action {other}"
        yield Correction(PREVIOUS, words, "`previous_action`", replace(described, previous_action=other))
    pair = {"joint_position": "absolute_joint_position", "absolute_joint_position": "joint_position"}
    if names & pair.keys():
        changed = _with_terms(described, lambda term: replace(term, name=pair.get(term.name, term.name)))
        words = " and ".join(term.name for term in changed.terms if term.name in pair)
        yield Correction(POSITIONS, f"{words} observed", "the term of the joint positions", changed)
    for term in described.terms:
        if term.name == "gait_clock":
            threshold = 0.0 if term.zero_below else 0.1
            words = (
                f"a clock that is zero below a command of {threshold:g}" if threshold else "a clock that always runs"
            )
            changed = _with_clock(described, term.clock, threshold)
            yield Correction(CLOCK, words, "`zero_below` of gait_clock", changed)
            for factor in (0.5, 2.0):
                clock = factor * term.clock
                changed = _with_clock(described, clock, term.zero_below)
                yield Correction(CLOCK, f"a clock of {clock:g} Hz", "`clock` of gait_clock", changed)


def _with_clock(described: PolicySpec, clock: float, zero_below: float) -> PolicySpec:
    """Return the description with another clock."""
    change = partial(replace, clock=clock, zero_below=zero_below)
    return _with_terms(described, lambda term: change(term) if term.name == "gait_clock" else term)


def _with_other_term_order(described: PolicySpec) -> Iterator[Correction]:
    """Yield the terms in another project's order, or with two neighbours swapped."""
    terms = described.terms
    orders = [_sorted_by(layout, terms) for layout in LAYOUTS]
    orders += [(*terms[:at], terms[at + 1], terms[at], *terms[at + 2 :]) for at in range(len(terms) - 1)]
    for order in orders:
        words = f"the terms in the order {', '.join(term.name for term in order)}"
        yield Correction(TERMS, words, "`terms`", replace(described, terms=order))


def _sorted_by(layout: Names, terms: tuple[ObservationTerm, ...]) -> tuple[ObservationTerm, ...]:
    """Return the terms of a layout in its order, the others where they are."""
    known = iter(sorted((term for term in terms if term.name in layout), key=lambda term: layout.index(term.name)))
    return tuple(next(known) if term.name in layout else term for term in terms)


def _with_other_signs(described: PolicySpec, robot: Robot) -> Iterator[Correction]:
    """Yield reversed joints by link, on all legs or on one side; the default position turns with them or stays."""
    legs, links = np.divmod(map_joints(described.joints, robot).joint_ids, JOINTS_PER_LEG)
    is_right = np.array([robot.leg_names[leg].endswith("r") for leg in legs])
    every = np.ones(len(legs), np.bool_)
    choices = [("", every, chosen) for chosen in ((1, 2), (0,), (2,), (1,), (0, 1, 2))]
    choices += [
        (f" of the {side} legs", mask, chosen)
        for side, mask in (("right", is_right), ("left", ~is_right))
        for chosen in ((0,), (0, 1, 2), (1, 2))
    ]
    for where, mask, chosen in choices:
        turns = np.where(mask & np.isin(links, chosen), -1.0, 1.0)
        signs = turns if described.signs is None else turns * described.signs
        which = f"{' and '.join(_LINKS[link] for link in chosen)}{where}"
        words = f"the sign of {which} the other way"
        values = None if (signs == 1.0).all() else tuple(signs.tolist())
        alone = replace(described, signs=values)
        yield Correction(SIGNS, words, f"`signs` of {which}", alone)
        default = tuple((turns * described.default_position + 0.0).tolist())
        offset = described.action_offset and tuple((turns * described.action_offset + 0.0).tolist())
        both = replace(alone, default_position=default, action_offset=offset)
        words = f"{words}, default position too"
        keys = f"`signs` and `default_position` of {which}"
        yield Correction(SIGNS, words, keys, both, MIRRORED_PENALTY)


def _with_other_gains(described: PolicySpec, robot: Robot) -> Iterator[Correction]:
    """Yield the described gains with one of them far off, the robot's own, and both far off."""
    own, gains = map_joints(described.joints, robot).joint_ids, np.array((described.stiffness, described.damping))
    robots = np.array((robot.servo_stiffness, robot.servo_damping))[:, own]
    single = [np.array(pair)[:, None] * gains for each in SINGLE_GAIN_FACTORS for pair in ((1.0, each), (each, 1.0))]
    others = [(0.0, each) for each in (*(factor * gains for factor in GAIN_FACTORS), *single)]
    for doubt, values in ((ROBOT_GAINS_PENALTY, robots), *others):
        stiffness, damping = values.tolist()
        changed = replace(described, stiffness=tuple(stiffness), damping=tuple(damping))
        words = f"servo gains of {with_spec_gains(robot, changed).servo}"
        yield Correction(GAINS, words, "`stiffness` and `damping`", changed, doubt)
