"""Common errors in specifications of policies, independent of the code that finds them."""

from collections.abc import Callable
from dataclasses import replace

from policies.external.spec import PolicySpec, SpecTerm

JOINT_VALUES = "default_position", "action_scale", "stiffness", "damping", "signs"
FRONT_HIND = {"f": "h", "h": "f", "r": "f"}
LEFT_RIGHT = {"l": "r", "r": "l"}


def _renamed(name: str, place: int, others: dict[str, str]) -> str:
    """Return a joint's name with another letter for its leg, in the same case."""
    letter = others[name[place].lower()]
    letter = {"h": "r"}.get(letter, letter) if name[0].isupper() and place == 0 else letter
    return name[:place] + (letter.upper() if name[place].isupper() else letter) + name[place + 1 :]


def sides(described: PolicySpec) -> PolicySpec:
    """Swap left and right."""
    return replace(described, joints=tuple(_renamed(name, 1, LEFT_RIGHT) for name in described.joints))


def ends(described: PolicySpec) -> PolicySpec:
    """Swap fore and hind."""
    return replace(described, joints=tuple(_renamed(name, 0, FRONT_HIND) for name in described.joints))


def grouping(described: PolicySpec) -> PolicySpec:
    """Order joints by leg instead of by kind, or the reverse, and reorder their values accordingly."""
    joints = described.joints
    is_by_kind = joints[0].partition("_")[0] != joints[1].partition("_")[0]
    moved = [joints[4 * link + leg] for leg in range(4) for link in range(3)]
    if not is_by_kind:
        moved = [joints[3 * leg + link] for link in range(3) for leg in range(4)]
    places = [joints.index(name) for name in moved]
    figures = {name: getattr(described, name) for name in JOINT_VALUES}
    figures = {name: values and tuple(values[place] for place in places) for name, values in figures.items()}
    return replace(described, joints=tuple(moved), **figures)


def _terms(described: PolicySpec, change: Callable[[SpecTerm], SpecTerm]) -> PolicySpec:
    return replace(described, terms=tuple(map(change, described.terms)))


def frames(described: PolicySpec) -> PolicySpec:
    """Observe velocities in the world frame."""
    return _terms(described, lambda term: replace(term, frame="world") if "r_velocity" in term.name else term)


def gravity(described: PolicySpec) -> PolicySpec:
    """Let gravity point up."""
    return _terms(described, lambda term: replace(term, scale=(-1.0,)) if term.name == "projected_gravity" else term)


def _other_scale(described: PolicySpec, name: str, pair: tuple[float, float]) -> PolicySpec:
    def change(term: SpecTerm) -> SpecTerm:
        return replace(term, scale=(pair[pair[0] == term.scale[0]],)) if term.name == name else term

    return _terms(described, change)


def turn_scale(described: PolicySpec) -> PolicySpec:
    """Scale the angular velocity by 0.25 instead of 1, or the reverse."""
    return _other_scale(described, "angular_velocity", (0.25, 1.0))


def speed_scale(described: PolicySpec) -> PolicySpec:
    """Scale the joint velocities by 0.05 instead of 1, or the reverse."""
    return _other_scale(described, "joint_velocity", (0.05, 1.0))


def action_scale(described: PolicySpec) -> PolicySpec:
    """Multiply the action scale by four."""
    return replace(described, action_scale=tuple(4.0 * each for each in described.action_scale))


def signs(described: PolicySpec) -> PolicySpec:
    """Reverse thighs and calves and keep the default position of the policy's files."""
    given = described.signs or (1.0,) * 12
    other = tuple(-each if "hip" not in name else each for each, name in zip(given, described.joints, strict=True))
    return replace(described, signs=other)


def history(described: PolicySpec) -> PolicySpec:
    """Reverse the history; no change without one."""
    return replace(described, history_newest="last" if described.history_newest == "first" else "first")


def rate(described: PolicySpec) -> PolicySpec:
    """Halve the control rate."""
    return replace(described, control_rate=described.control_rate / 2)


def damping(described: PolicySpec) -> PolicySpec:
    """Multiply the damping by ten."""
    return replace(described, damping=tuple(10.0 * each for each in described.damping))


def gains(described: PolicySpec) -> PolicySpec:
    """Use the servo gains of another robot."""
    return replace(described, stiffness=(20.0,) * 12, damping=(0.5,) * 12)


def order_of_terms(described: PolicySpec) -> PolicySpec:
    """Move the command to the end of the observation, or after gravity if the command is already at the end."""
    (command,) = (term for term in described.terms if term.name == "command")
    (clock,) = (term for term in described.terms if term.name == "gait_clock")
    others = [term for term in described.terms if term.name not in ("command", "gait_clock")]
    names = [term.name for term in others]
    before = described.terms.index(command)
    place = len(others) if before <= names.index("projected_gravity") + 1 else names.index("projected_gravity") + 1
    return replace(described, terms=(*others[:place], command, *others[place:], clock))


def positions(described: PolicySpec) -> PolicySpec:
    """Observe absolute joint positions instead of positions relative to the default position."""
    other = "absolute_joint_position"
    return _terms(described, lambda term: replace(term, name=other) if term.name == "joint_position" else term)


PLANTED_ERRORS: dict[str, Callable[[PolicySpec], PolicySpec]] = {
    each.__name__: each
    for each in (
        sides,
        ends,
        grouping,
        frames,
        gravity,
        turn_scale,
        speed_scale,
        action_scale,
        signs,
        history,
        rate,
        damping,
        gains,
        order_of_terms,
        positions,
    )
}
