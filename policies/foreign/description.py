"""What a policy from another project reads and commands, as one value: joints, gains, scales, observation terms.

Joint angles, order and names are those of the policy's own files, in its maker's convention; `terms` and `joints` of
this package bring them to the robot's. A target is `offset + scale * clip(action)`, rad.
"""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from reprlib import repr as shortened
from typing import Literal

from policies.base import PolicyError

Numbers = tuple[float, ...]
Range = tuple[float, float]

TERMS: dict[str, int | None] = {
    "projected_gravity": 3,  # unit vector of gravity, (0, 0, -1) upright
    "angular_velocity": 3,  # rad/s
    "linear_velocity": 3,  # m/s
    "joint_position": 12,  # rad, minus the default position
    "absolute_joint_position": 12,  # rad
    "joint_velocity": 12,  # rad/s
    "joint_torque": 12,  # N·m, of the servos
    "previous_action": 12,
    "command": 3,  # forward m/s, lateral m/s, yaw rate rad/s
    "foot_contact": 4,  # 1 on the ground, 0 in the air, legs in the order of `joints`
    "height_scan": None,  # m
    "gait_clock": 2,  # sine and cosine of a clock that is at 0 when the episode starts
    "constant": None,  # numbers that are always the same
}
"""Names of observation terms, and how many numbers each has; None where the term's own settings say it."""

OF_JOINTS = "default_position", "action_scale", "stiffness", "damping", "action_offset", "target_clip"
"""Fields of a description with a value for each of its `joints`, in their order."""

LONGEST_HISTORY, MOST_POINTS = 1000, 10_000
"""Control steps that a term may show, and points of a height scan."""
_OWNERS = {"clock": "gait_clock", "grid": "height_scan", "values": "constant"}
_POSITIVE = "control_rate", "stiffness", "damping", "clock", "observation_clip"
_CHOICES = {
    "frame": ("body", "heading", "world"),
    "history_layout": ("term", "time"),
    "history_newest": ("first", "last"),
    "history_start": ("first", "zero"),
    "previous_action": ("raw", "scaled"),
}


@dataclass(frozen=True)
class HeightGrid:
    """Points of a height scan about the trunk, heading frame, and what a point's number is."""

    x: Numbers
    """Forward, m, in the order of the observation."""
    y: Numbers
    """To the left, m, in the order of the observation."""
    x_first: bool = True
    """Whether x is what changes fastest from point to point; false: y does."""
    offset: float = 0.0
    """A point's number is the trunk's height minus that of the ground minus this, m."""

    def __post_init__(self) -> None:
        _check(self, x=(), y=(), offset=(1,))
        if len(self.x) * len(self.y) > MOST_POINTS:
            raise PolicyError(f"a height scan has at most {MOST_POINTS} points, not {len(self.x)} x {len(self.y)}")


@dataclass(frozen=True)
class Term:
    """An observation term: clipped, then scaled."""

    name: str
    """One of TERMS."""
    scale: Numbers = (1.0,)
    """A factor for all of its numbers, or one for each."""
    clip: Range | None = None
    """Least and largest value before scaling."""
    history: int = 1
    """How many control steps of it are shown, the present one included."""
    frame: Literal["body", "heading", "world"] = "body"
    """Of velocities and gravity; the world frame's x axis is the heading at the start of the episode."""
    values: Numbers = ()
    """Of a `constant`."""
    clock: float = 0.0
    """Cycles a second of a `gait_clock`, Hz."""
    grid: HeightGrid | None = None
    """Of a `height_scan`."""

    def __post_init__(self) -> None:
        if self.name not in (*TERMS,):
            raise PolicyError(f"{shortened(self.name)} is no observation term", f"the terms are {', '.join(TERMS)}")
        for setting, owner in _OWNERS.items():
            if bool(getattr(self, setting)) != (owner == self.name):
                raise PolicyError(f"`{setting}` belongs to the term {owner} and to no other, not to {self.name}")
        if type(self.history) is not int or not 1 <= self.history <= LONGEST_HISTORY:
            raise PolicyError(f"`history` must be a whole number from 1 to {LONGEST_HISTORY}, not {self.history!r:.80}")
        if self.values:
            _check(self, values=())
        if self.clock:
            _check(self, clock=(1,))
        _check(self, scale=(1, self.width))
        _check_range("clip", self.clip)

    @property
    def width(self) -> int:
        """Numbers of one control step."""
        if (width := TERMS[self.name]) is not None:
            return width
        return len(self.grid.x) * len(self.grid.y) if self.grid is not None else len(self.values)


@dataclass(frozen=True)
class PolicyDescription:
    """All that a policy's files say of what it reads and commands."""

    network: Path
    """The .onnx or TorchScript .pt file."""
    control_rate: float
    """Hz."""
    joints: tuple[str, ...]
    """Names of the twelve joints, in the order of the actions."""
    default_position: Numbers
    """Joint angles that `joint_position` is measured from, rad, in the order of `joints`."""
    action_scale: Numbers
    """rad for an action of one, in the order of `joints`."""
    stiffness: Numbers
    """Of the servos, N·m/rad, in the order of `joints`."""
    damping: Numbers
    """Of the servos, N·m·s/rad, in the order of `joints`."""
    terms: tuple[Term, ...]
    """In the order of the observation."""
    action_offset: Numbers | None = None
    """Targets of zero actions, rad, in the order of `joints`; None: the default position."""
    action_clip: Range | None = None
    """Least and largest raw action."""
    target_clip: tuple[Range, ...] | None = None
    """Least and largest joint target, rad, in the order of `joints`, within the robot's own limits."""
    observed_joints: tuple[str, ...] | None = None
    """Names of the joints in the order of the observed angles, velocities, torques; None: that of `joints`. Previous
    actions keep the order of `joints`."""
    observation_clip: float | None = None
    """Largest magnitude of an observed number, after scaling."""
    history_layout: Literal["term", "time"] = "term"
    """Whether the history of a term lies together, or all terms of a control step do."""
    history_newest: Literal["first", "last"] = "last"
    """Where the newest control step is."""
    history_start: Literal["first", "zero"] = "first"
    """What fills the history at the start of an episode: the first observation, or zeros."""
    previous_action: Literal["raw", "scaled"] = "raw"
    """Whether the previous action is what the network gave, clipped, or the target minus its offset, rad."""

    def __post_init__(self) -> None:
        if not _are_names(self.joints):
            raise PolicyError(f"`joints` must be the names of 12 different joints, not {shortened(self.joints)}")
        observed = self.joints if self.observed_joints is None else self.observed_joints
        if not _are_names(observed) or {*observed} != {*self.joints}:
            raise PolicyError("`observed_joints` must be the names of `joints`, in another order")
        _check(self, control_rate=(1,), default_position=(12,), action_scale=(12,), stiffness=(12,), damping=(12,))
        _check(self, action_offset=(12,), observation_clip=(1,))
        _check_range("action_clip", self.action_clip)
        if self.target_clip is not None and len(self.target_clip) != 12:
            raise PolicyError(f"`target_clip` must be 12 ranges, not {len(self.target_clip)}")
        for each in self.target_clip or ():
            _check_range("target_clip", each)
        terms = self.terms if isinstance(self.terms, tuple) else ()
        if not terms or not all(isinstance(term, Term) for term in terms):
            raise PolicyError("`terms` must be one term or more", f"the terms are {', '.join(TERMS)}")
        if self.history_layout == "time" and len({term.history for term in self.terms}) > 1:
            raise PolicyError("with the history_layout `time`, all terms must have the same history")

    @property
    def width(self) -> int:
        """Numbers of the whole observation."""
        return sum(term.width * term.history for term in self.terms)


def _check(described: object, **counts: tuple[int, ...]) -> None:
    """Raise PolicyError unless fields are finite numbers, as many as one of their counts says, () for any."""
    for name, allowed in counts.items():
        if (value := getattr(described, name)) is None:
            continue
        values = (value,) if allowed == (1,) else value
        many = isinstance(values, tuple) and len(values) in (allowed or (len(values) or 1,))
        if not many or not all(map(is_number, values)):
            count = " or ".join(map(str, dict.fromkeys(allowed))) or "some"
            raise PolicyError(f"`{name}` must be {count} finite numbers, not {shortened(value)}")
        if name in _POSITIVE and (min(values) < 0 or (0 in values and name != "damping")):
            raise PolicyError(f"`{name}` must be positive, not {min(values)}")
    for name, choices in _CHOICES.items():
        if getattr(described, name, choices[0]) not in choices:
            raise PolicyError(f"`{name}` must be {' or '.join(choices)}, not {getattr(described, name)!r:.80}")


def _check_range(name: str, value: object) -> None:
    two = isinstance(value, tuple) and len(value) == 2 and all(map(is_number, value))
    if value is not None and not (two and value[0] < value[1]):  # type: ignore[index]
        raise PolicyError(f"`{name}` must be a least and a largest value, not {shortened(value)}")


def is_number(value: object) -> bool:
    """Whether it is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _are_names(value: object) -> bool:
    return (
        isinstance(value, tuple) and all(isinstance(each, str) for each in value) and len(value) == len({*value}) == 12
    )
