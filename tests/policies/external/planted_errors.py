"""Mistakes in descriptions of policies as people make them, without what finds them."""

from collections.abc import Callable
from dataclasses import replace

from policies.external.spec import ObservationTerm, PolicySpec

FIGURES = "default_position", "action_scale", "stiffness", "damping", "signs"
FRONT_HIND = {"f": "h", "h": "f", "r": "f"}
LEFT_RIGHT = {"l": "r", "r": "l"}


def _renamed(name: str, place: int, others: dict[str, str]) -> str:
    """A joint's name with another letter for its leg, in the case and with the letters that it has."""
    letter = others[name[place].lower()]
    letter = {"h": "r"}.get(letter, letter) if name[0].isupper() and place == 0 else letter
    return name[:place] + (letter.upper() if name[place].isupper() else letter) + name[place + 1 :]


def sides(described: PolicySpec) -> PolicySpec:
    """Left and right swapped."""
    return replace(described, joints=tuple(_renamed(name, 1, LEFT_RIGHT) for name in described.joints))


def ends(described: PolicySpec) -> PolicySpec:
    """Fore and hind swapped."""
    return replace(described, joints=tuple(_renamed(name, 0, FRONT_HIND) for name in described.joints))


def grouping(described: PolicySpec) -> PolicySpec:
    """By leg what is by kind, and by kind what is by leg, with the figures in the right places."""
    joints = described.joints
    is_by_kind = joints[0].partition("_")[0] != joints[1].partition("_")[0]
    moved = [joints[4 * link + leg] for leg in range(4) for link in range(3)]
    if not is_by_kind:
        moved = [joints[3 * leg + link] for link in range(3) for leg in range(4)]
    places = [joints.index(name) for name in moved]
    figures = {name: getattr(described, name) for name in FIGURES}
    figures = {name: values and tuple(values[place] for place in places) for name, values in figures.items()}
    return replace(described, joints=tuple(moved), **figures)


def _terms(described: PolicySpec, change: Callable[[ObservationTerm], ObservationTerm]) -> PolicySpec:
    return replace(described, terms=tuple(map(change, described.terms)))


def frames(described: PolicySpec) -> PolicySpec:
    """Velocities of the world."""
    return _terms(described, lambda term: replace(term, frame="world") if "r_velocity" in term.name else term)


def gravity(described: PolicySpec) -> PolicySpec:
    """Gravity points up."""
    return _terms(described, lambda term: replace(term, scale=(-1.0,)) if term.name == "projected_gravity" else term)


def _other_scale(described: PolicySpec, name: str, pair: tuple[float, float]) -> PolicySpec:
    def change(term: ObservationTerm) -> ObservationTerm:
        return replace(term, scale=(pair[pair[0] == term.scale[0]],)) if term.name == name else term

    return _terms(described, change)


def turn_scale(described: PolicySpec) -> PolicySpec:
    """The angular velocity scaled by 0.25 where it is not, and the other way round."""
    return _other_scale(described, "angular_velocity", (0.25, 1.0))


def speed_scale(described: PolicySpec) -> PolicySpec:
    """The joint velocities scaled by 0.05 where they are not, and the other way round."""
    return _other_scale(described, "joint_velocity", (0.05, 1.0))


def action_scale(described: PolicySpec) -> PolicySpec:
    """Actions that stand for four times as much."""
    return replace(described, action_scale=tuple(4.0 * each for each in described.action_scale))


def signs(described: PolicySpec) -> PolicySpec:
    """Thighs and calves that turn the other way, the default position as it is in the policy's files."""
    given = described.signs or (1.0,) * 12
    other = tuple(-each if "hip" not in name else each for each, name in zip(given, described.joints, strict=True))
    return replace(described, signs=other)


def history(described: PolicySpec) -> PolicySpec:
    """The history backwards; nothing without one."""
    return replace(described, history_newest="last" if described.history_newest == "first" else "first")


def rate(described: PolicySpec) -> PolicySpec:
    """Half the control rate."""
    return replace(described, control_rate=described.control_rate / 2)


def damping(described: PolicySpec) -> PolicySpec:
    """Ten times the damping."""
    return replace(described, damping=tuple(10.0 * each for each in described.damping))


def gains(described: PolicySpec) -> PolicySpec:
    """Gains of another robot's servos."""
    return replace(described, stiffness=(20.0,) * 12, damping=(0.5,) * 12)


def order_of_terms(described: PolicySpec) -> PolicySpec:
    """The command at the end of the observation where it is not, else after gravity."""
    (command,) = (term for term in described.terms if term.name == "command")
    (clock,) = (term for term in described.terms if term.name == "gait_clock")
    others = [term for term in described.terms if term.name not in ("command", "gait_clock")]
    names = [term.name for term in others]
    before = described.terms.index(command)
    place = len(others) if before <= names.index("projected_gravity") + 1 else names.index("projected_gravity") + 1
    return replace(described, terms=(*others[:place], command, *others[place:], clock))


def positions(described: PolicySpec) -> PolicySpec:
    """Joint positions from zero instead of the default position."""
    other = "absolute_joint_position"
    return _terms(described, lambda term: replace(term, name=other) if term.name == "joint_position" else term)


MISTAKES: dict[str, Callable[[PolicySpec], PolicySpec]] = {
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
