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
    "gait_clock": None,  # sine and cosine of a clock
    "constant": None,  # numbers that are always the same
}
"""Names of observation terms, and how many numbers each has; None where the term's own settings say it."""

LONGEST_HISTORY = 1000
"""Control steps that a term may show."""
_NEEDS = {"gait_clock": "clock", "height_scan": "grid", "constant": "values"}
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
        for name, values in (("x", self.x), ("y", self.y), ("offset", (self.offset,))):
            _numbers(name, values)


@dataclass(frozen=True)
class Clock:
    """Clock of a gait, in step with the episode: at 0 when it starts."""

    frequency: float
    """Cycles a second, Hz."""
    phases: Numbers = (0.0,)
    """Where each oscillator is ahead of the clock, cycles; the numbers follow phase by phase."""
    parts: tuple[Literal["sin", "cos"], ...] = ("sin", "cos")
    """What is given of each oscillator, in this order."""
    by_part: bool = False
    """All sines before all cosines, instead of phase by phase."""
    stands: bool = False
    """Whether the clock stays at 0 while the command is zero."""

    def __post_init__(self) -> None:
        _numbers("frequency", (self.frequency,), above=0)
        _numbers("phases", self.phases)
        if not self.parts or not set(self.parts) <= {"sin", "cos"}:
            raise PolicyError(f"`parts` of a clock must be of sin, cos, not {shortened(self.parts)}")


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
    clock: Clock | None = None
    """Of a `gait_clock`."""
    grid: HeightGrid | None = None
    """Of a `height_scan`."""

    def __post_init__(self) -> None:
        if self.name not in TERMS:
            raise PolicyError(f"{shortened(self.name)} is no observation term", f"the terms are {', '.join(TERMS)}")
        for name in _NEEDS.values():
            if bool(getattr(self, name)) != (name == _NEEDS.get(self.name)):
                raise PolicyError(f"`{name}` belongs to the term {_of(name)} and to no other, not to {self.name}")
        if type(self.history) is not int or not 1 <= self.history <= LONGEST_HISTORY:
            raise PolicyError(
                f"`history` of {self.name} must be a whole number from 1 to {LONGEST_HISTORY}, not "
                f"{shortened(self.history)}"
            )
        if self.values:
            _numbers("values", self.values)
        _numbers(f"scale of {self.name}", self.scale, 1, self.width)
        _range(f"clip of {self.name}", self.clip)
        _choices(self)

    @property
    def width(self) -> int:
        """Numbers of one control step."""
        if (width := TERMS[self.name]) is not None:
            return width
        if self.clock is not None:
            return len(self.clock.phases) * len(self.clock.parts)
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
    """Least and largest joint target, rad, in the order of `joints`, beside the robot's own limits."""
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
        for name in ("joints", "observed_joints"):
            _names(name, getattr(self, name))
        if self.observed_joints is not None and set(self.observed_joints) != set(self.joints):
            raise PolicyError("`observed_joints` must be the names of `joints` in another order")
        _numbers("control_rate", (self.control_rate,), above=0)
        for name in ("default_position", "action_scale", "damping"):
            _numbers(name, getattr(self, name), 12)
        _numbers("stiffness", self.stiffness, 12, above=0)
        if min(self.damping) < 0:
            raise PolicyError(f"`damping` must be zero or more, not {min(self.damping)}")
        if self.action_offset is not None:
            _numbers("action_offset", self.action_offset, 12)
        if self.target_clip is not None and len(self.target_clip) != 12:
            raise PolicyError(f"`target_clip` must be 12 ranges, not {len(self.target_clip)}")
        for each in self.target_clip or ():
            _range("target_clip", each)
        _range("action_clip", self.action_clip)
        if self.observation_clip is not None:
            _numbers("observation_clip", (self.observation_clip,), above=0)
        if not self.terms:
            raise PolicyError("`terms` must name at least one observation term", f"the terms are {', '.join(TERMS)}")
        if self.history_layout == "time" and len({term.history for term in self.terms}) > 1:
            raise PolicyError("with the history_layout `time`, all terms must have the same history")
        _choices(self)

    @property
    def width(self) -> int:
        """Numbers of the whole observation."""
        return sum(term.width * term.history for term in self.terms)


def _of(setting: str) -> str:
    """The term that a setting belongs to."""
    return next(name for name, needed in _NEEDS.items() if needed == setting)


def _numbers(name: str, values: object, *counts: int, above: float | None = None) -> None:
    """Raise PolicyError unless they are finite numbers, as many as one of the counts says, and above a number."""
    numbers = values if isinstance(values, tuple) else ()
    good = all(isinstance(each, int | float) and not isinstance(each, bool) and isfinite(each) for each in numbers)
    if not numbers or not good or (counts and len(numbers) not in counts):
        count = f"{' or '.join(map(str, dict.fromkeys(counts)))} " if counts else ""
        raise PolicyError(f"`{name}` must be {count}finite numbers, not {shortened(values)}")
    if above is not None and min(numbers) <= above:
        raise PolicyError(f"`{name}` must be above {above}, not {min(numbers)}")


def _range(name: str, limits: Range | None) -> None:
    if limits is not None:
        _numbers(name, limits, 2)
        if limits[0] >= limits[1]:
            raise PolicyError(f"`{name}` must be the least and the largest value, not {shortened(limits)}")


def _names(name: str, joints: tuple[str, ...] | None) -> None:
    given = joints if isinstance(joints, tuple) and all(isinstance(each, str) for each in joints) else ()
    if joints is not None and not len(given) == len(set(given)) == 12:
        raise PolicyError(f"`{name}` must be the names of 12 different joints, not {shortened(joints)}")


def _choices(value: object) -> None:
    for name, choices in _CHOICES.items():
        if getattr(value, name, choices[0]) not in choices:
            raise PolicyError(f"`{name}` must be {' or '.join(choices)}, not {shortened(getattr(value, name))}")
