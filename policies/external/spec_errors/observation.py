"""Corrections of the observation terms in an external policy's specification.

They change the frames, signs, scales, histories, conventions or order of the terms.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import Literal

from policies.external.spec import Numbers, PolicySpec, SpecTerm
from policies.external.spec_errors.correction import (
    CLOCK,
    FRAMES,
    GRAVITY,
    HISTORY,
    POSITIONS,
    PREVIOUS,
    SCALES,
    TERMS,
    Correction,
    numbers_in_words,
)

LEGGED_GYM_SCALES: dict[str, Numbers] = {
    "linear_velocity": (2.0,),
    "angular_velocity": (0.25,),
    "joint_velocity": (0.05,),
    "command": (2.0, 2.0, 0.25),
    "height_scan": (5.0,),
}
"""Name of an observation term -> scale of the term in legged_gym; in other projects the scale is 1."""
CLOCK_FACTORS = 0.5, 2.0
"""Tried factors on the frequency of the gait clock in a specification."""
CLOCK_THRESHOLD = 0.1
"""Norm of the velocity command (m/s, rad/s) below which the gait clock of some projects is (0, 0)."""
_JOINT_STATE = "joint_position", "absolute_joint_position", "joint_velocity", "previous_action"
TERM_ORDERS = (
    ("linear_velocity", "angular_velocity", "projected_gravity", "command", *_JOINT_STATE),
    ("linear_velocity", "angular_velocity", "projected_gravity", *_JOINT_STATE, "command"),
    ("command", "linear_velocity", "angular_velocity", "projected_gravity", *_JOINT_STATE),
    ("angular_velocity", "linear_velocity", "projected_gravity", "command", *_JOINT_STATE),
    ("projected_gravity", "angular_velocity", "linear_velocity", "command", *_JOINT_STATE),
)
"""Orders of the observation terms in other projects, which are tried as corrections.

The first order is used by legged_gym and Isaac Lab, the second by mjlab and MuJoCo Playground, the third by HIMLoco.
"""
_FRAMES: tuple[Literal["body", "world"], ...] = ("body", "world")
_OTHER_POSITION = {
    "joint_position": "absolute_joint_position",
    "absolute_joint_position": "joint_position",
}
"""Name of an observation term with joint angles -> the other term, with another zero of the angles."""


def change_frames(spec: PolicySpec) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another frame of the velocities.

    The linear velocity of the trunk, its angular velocity or both are in the base frame (`body`) or the world frame.
    """
    both = "linear_velocity", "angular_velocity"
    for frame in _FRAMES:
        for names in (both, both[:1], both[1:]):
            terms = tuple(replace(term, frame=frame) if term.name in names else term for term in spec.terms)
            if terms != spec.terms:
                changed = " and ".join(term.name for term in terms if term.name in names)
                changed_setting = f"{changed} in the {frame} frame"
                yield Correction(FRAMES, changed_setting, f"`frame` of {changed}", replace(spec, terms=terms))


def reverse_gravity(spec: PolicySpec) -> Iterator[Correction]:
    """Yield the candidate correction of a policy's specification with the opposite sign of gravity."""

    def reverse(term: SpecTerm) -> SpecTerm:
        reversed_term = replace(term, scale=tuple(-factor for factor in term.scale))
        return reversed_term if term.name == "projected_gravity" else term

    changed_setting = "projected_gravity the other way"
    keys = "the sign of `scale` of projected_gravity"
    yield Correction(GRAVITY, changed_setting, keys, _map_terms(spec, reverse))


def change_scales(spec: PolicySpec) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with other scales of the observation terms.

    In each correction, one term has legged_gym's scale, the scale 1, or the specified scale multiplied or divided by
    legged_gym's scale. In two more corrections, all terms that legged_gym scales (LEGGED_GYM_SCALES) have legged_gym's
    scales, or all of them have the scale 1.
    """
    for name, legged_gym_scale in LEGGED_GYM_SCALES.items():
        for term in spec.terms:
            if term.name != name:
                continue
            smaller = tuple(factor * other for factor, other in _paired(term.scale, legged_gym_scale))
            larger = tuple(factor / other for factor, other in _paired(term.scale, legged_gym_scale))
            for scale in (legged_gym_scale, (1.0,), smaller, larger):
                changed_setting = f"{name} scaled by {numbers_in_words(scale)}"
                changed = _map_terms(spec, _scale_setter({name: scale}))
                yield Correction(SCALES, changed_setting, f"`scale` of {name}", changed)
    ones: dict[str, Numbers] = dict.fromkeys(LEGGED_GYM_SCALES, (1.0,))
    for changed_setting, scales in (
        ("legged_gym's scales of observations", LEGGED_GYM_SCALES),
        ("no scales of observations", ones),
    ):
        changed = _map_terms(spec, _scale_setter(scales))
        yield Correction(SCALES, changed_setting, "`scale` of all terms", changed)


def change_history(spec: PolicySpec) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another order of the history.

    The newest control step is at the other end of the history, or the history has the other layout (by term or by
    time), or both.
    """
    if all(term.history == 1 for term in spec.terms):
        return
    newest: Literal["first", "last"] = "last" if spec.history_newest == "first" else "first"
    layout: Literal["term", "time"] = "time" if spec.history_layout == "term" else "term"
    direction = f"the newest step of the history {newest}"
    reversed_spec = replace(spec, history_newest=newest)
    yield Correction(HISTORY, direction, "`history_newest`", reversed_spec)
    if layout == "term" or len({term.history for term in spec.terms}) == 1:
        by_layout = f"the history by {layout}"
        yield Correction(HISTORY, by_layout, "`history_layout`", replace(spec, history_layout=layout))
        both = replace(reversed_spec, history_layout=layout)
        yield Correction(HISTORY, f"{by_layout} and {direction}", "`history_layout` and `history_newest`", both)


def change_conventions(spec: PolicySpec) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another meaning of one term.

    They change the form of the previous action (raw or scaled), the zero of the joint positions (default position or
    0 rad), or the frequency or the threshold of a gait clock.
    """
    names = {term.name for term in spec.terms}
    if "previous_action" in names:
        other: Literal["raw", "scaled"] = "scaled" if spec.previous_action == "raw" else "raw"
        changed = replace(spec, previous_action=other)
        yield Correction(PREVIOUS, f"the previous action {other}", "`previous_action`", changed)
    if names & _OTHER_POSITION.keys():
        changed = _map_terms(spec, lambda term: replace(term, name=_OTHER_POSITION.get(term.name, term.name)))
        positions = " and ".join(term.name for term in changed.terms if term.name in _OTHER_POSITION)
        yield Correction(POSITIONS, f"{positions} observed", "the term of the joint positions", changed)
    for term in spec.terms:
        if term.name == "gait_clock":
            yield from _change_clock(spec, term)


def _change_clock(spec: PolicySpec, term: SpecTerm) -> Iterator[Correction]:
    """Yield candidate corrections of a specification with another gait clock in place of `term`.

    The gait clock has another frequency or another threshold. The threshold is the norm of the velocity command below
    which the clock is (0, 0).
    """
    threshold = 0.0 if term.zero_below else CLOCK_THRESHOLD
    gated = f"a clock that is zero below a command of {threshold:g}"
    changed_setting = gated if threshold else "a clock that always runs"
    changed = _with_clock(spec, term.clock, threshold)
    yield Correction(CLOCK, changed_setting, "`zero_below` of gait_clock", changed)
    for factor in CLOCK_FACTORS:
        frequency = factor * term.clock
        changed = _with_clock(spec, frequency, term.zero_below)
        yield Correction(CLOCK, f"a clock of {frequency:g} Hz", "`clock` of gait_clock", changed)


def change_term_order(spec: PolicySpec) -> Iterator[Correction]:
    """Yield candidate corrections of a policy's specification with another order of the observation terms.

    The terms are in the order of another project (TERM_ORDERS), or two adjacent terms are swapped.
    """
    terms = spec.terms
    orders = [_sort_terms(terms, names) for names in TERM_ORDERS]
    orders += [(*terms[:index], terms[index + 1], terms[index], *terms[index + 2 :]) for index in range(len(terms) - 1)]
    for order in orders:
        changed_setting = f"the terms in the order {', '.join(term.name for term in order)}"
        yield Correction(TERMS, changed_setting, "`terms`", replace(spec, terms=order))


def _sort_terms(terms: tuple[SpecTerm, ...], names: tuple[str, ...]) -> tuple[SpecTerm, ...]:
    """Return observation terms in the order of the term names `names`; other terms keep their positions."""
    known = [term for term in terms if term.name in names]
    in_order = iter(sorted(known, key=lambda term: names.index(term.name)))
    return tuple(next(in_order) if term.name in names else term for term in terms)


def _map_terms(spec: PolicySpec, change: Callable[[SpecTerm], SpecTerm]) -> PolicySpec:
    """Return the specification in which each observation term is replaced by the result of `change(term)`."""
    return replace(spec, terms=tuple(map(change, spec.terms)))


def _with_clock(spec: PolicySpec, frequency: float, zero_below: float) -> PolicySpec:
    """Return the specification with another frequency, Hz, and threshold of the gait clock.

    The gait clock is (0, 0) if the norm of the velocity command is below the threshold `zero_below`.
    """
    change = partial(replace, clock=frequency, zero_below=zero_below)
    return _map_terms(spec, lambda term: change(term) if term.name == "gait_clock" else term)


def _scale_setter(scales: dict[str, Numbers]) -> Callable[[SpecTerm], SpecTerm]:
    """Return a function that sets the scale of an observation term to its scale in `scales`.

    `scales` maps names of terms to scales. The function returns other terms unchanged.
    """
    return lambda term: replace(term, scale=scales[term.name]) if term.name in scales else term


def _paired(scale: Numbers, other: Numbers) -> Iterable[tuple[float, float]]:
    """Return pairs of corresponding factors of two scales of an observation term.

    A scale with a single factor for all values of the term is repeated.
    """
    width = max(len(scale), len(other))
    return zip(scale * (width // len(scale)), other * (width // len(other)), strict=True)
