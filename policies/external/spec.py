"""Specification of an external policy: joints, servo gains, action scales and observation terms.

Names, order and signs of the joints are as in the policy's own files. The modules `joint_mapping` and
`observation_adapter` convert them to the order and signs of this project's robots. A joint target is
`offset + scale * clip(action)`, rad, where `action` is an output of the network.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from policies.base import PolicyError
from quad_env.config import Bounds, Finite, NonNegative, Positive, check_settings
from quad_env.files.text import brief

Numbers = tuple[Finite, ...]
Range = tuple[Finite, Finite]
"""Minimum and maximum of a number."""

TERM_WIDTHS: dict[str, int | None] = {
    "projected_gravity": 3,  # unit vector of gravity, (0, 0, -1) if the robot is upright
    "angular_velocity": 3,  # angular velocity of the trunk, rad/s
    "linear_velocity": 3,  # linear velocity of the trunk, m/s
    "joint_position": 12,  # joint angles minus the default position, rad
    "absolute_joint_position": 12,  # joint angles, rad
    "joint_velocity": 12,  # angular velocities of the joints, rad/s
    "joint_torque": 12,  # torques of the servos, N·m
    "previous_action": 12,
    "command": 3,  # commanded forward velocity, m/s, lateral velocity, m/s, and yaw rate, rad/s
    "foot_contact": 4,  # 1 for feet on the ground, 0 for feet in the air, legs in the order of `joints`
    "height_scan": None,  # heights of the trunk above the ground at the points of the term's grid, m
    "gait_clock": 2,  # sine and cosine of a clock phase that is 0 at the start of the episode
    "constant": None,  # the constant numbers in the term's setting `values`
    "position_error": 3,  # integral of commanded minus actual velocity since the last change of the command, m and rad
}
"""Name of an observation term -> number of its values in one control step.

None: the settings of the term determine the number.
"""

JOINT_FIELDS = (
    "default_position",
    "action_scale",
    "stiffness",
    "damping",
    "action_offset",
    "target_clip",
    "signs",
    "zeros",
)
"""Names of the fields of `PolicySpec` with one value per joint, in the order of the field `joints`."""

MAX_SCAN_POINTS = 10_000
"""Maximum number of points of a height scan that a policy observes."""
MAX_NAME = 100
"""Maximum number of characters of a joint's name in a specification."""
MAX_OBSERVATION = 100_000
"""Maximum size of a policy's observation.

The size is the number of values in one control step times the number of control steps in the longest history.
"""
PLAUSIBLE_RANGES = {
    "control_rate": (1.0, 1e4, "Hz"),
    "default_position": (-100.0, 100.0, "rad"),
    "action_scale": (-100.0, 100.0, "rad"),
    "action_offset": (-100.0, 100.0, "rad"),
    "stiffness": (1e-3, 1e4, "N·m/rad"),
    "damping": (0.0, 1e3, "N·m·s/rad"),
    "observation_clip": (1e-6, float("inf"), ""),
    "scale": (-1e6, 1e6, ""),
    "clock": (0.01, 100.0, "Hz"),
    "x": (-100.0, 100.0, "m"),
    "y": (-100.0, 100.0, "m"),
    "offset": (-100.0, 100.0, "m"),
    "values": (-1e12, 1e12, ""),
    "lags": (0.0, 10.0, "s"),
    "averages": (0.0, 10.0, "s"),
    "bound": (0.0, 100.0, "m"),
    "clock_gain": (0.0, 100.0, "Hz per m/s"),
    "clock_limit": (0.0, 100.0, "Hz"),
    "clip": (-1e12, 1e12, ""),
    "action_clip": (-1e12, 1e12, ""),
    "target_clip": (-1e12, 1e12, "rad"),
}
"""Name of a field of a specification -> plausible range of its numbers: minimum, maximum, unit.

A number outside the range is rejected as an error in the file, because no robot has a number of this size.
"""
_TERM_OF_SETTING = {"clock": "gait_clock", "grid": "height_scan", "values": "constant", "bound": "position_error"}
"""Name of a setting of `SpecTerm` -> name of the only observation term that has this setting, and that requires it."""
_CLOCK_SETTINGS = ("zero_below", "clock_gain", "clock_limit")
"""Names of the settings of `SpecTerm` that only the term `gait_clock` may have."""
_NEW_SETTINGS = ("lags", "averages", "bound", "clock_gain", "clock_limit")
"""Names of the settings of `SpecTerm` that are in a digest only if they differ from their defaults."""


class _CheckedSpec:
    """Base class of dataclasses that check each value against the annotation of its field.

    The constructor raises PolicyError for a wrong value.
    """

    def __post_init__(self) -> None:
        try:
            check_settings(self)
        except ValueError as error:
            raise PolicyError(str(error)) from None


@dataclass(frozen=True)
class HeightGrid(_CheckedSpec):
    """Rectangular grid of points around the trunk's centre at which a policy observes the ground height.

    The coordinates are relative to the trunk's centre, in the heading frame (yaw only).
    """

    x: Numbers
    """x coordinates of the grid, positive forward, in the order of the observation, m.

    The grid has a point for each pair of an x and a y coordinate.
    """
    y: Numbers
    """y coordinates of the grid, positive to the left, in the order of the observation, m.

    The grid has a point for each pair of an x and a y coordinate.
    """
    x_first: bool = True
    """True if x changes fastest from one observed point to the next, False if y changes fastest."""
    offset: Finite = 0.0
    """Length that is subtracted from each observed height, m.

    The observed height is the trunk's height minus the ground's height at the point minus this length.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_plausible(self)
        if not 1 <= len(self.x) * len(self.y) <= MAX_SCAN_POINTS:
            raise PolicyError(f"a height scan has 1 to {MAX_SCAN_POINTS} points, not {len(self.x)} x {len(self.y)}")


@dataclass(frozen=True)
class SpecTerm(_CheckedSpec):
    """Observation term: a quantity, such as the joint positions, in the observation of an external policy.

    Its values are clipped first and then scaled.
    """

    name: str
    """Name of the term, for example `joint_position`; the keys of TERM_WIDTHS are the valid names."""
    scale: Numbers = (1.0,)
    """Factors on the values of the term: one factor for all values, or one factor per value."""
    clip: Range | None = None
    """Minimum and maximum to which the values are clipped before they are scaled; None: no limits."""
    history: Annotated[int, Bounds("from 1 to 1000", 1, 1000)] = 1
    """Number of control steps of the term in the observation, including the present step."""
    frame: Literal["body", "heading", "world"] = "body"
    """Frame in which the velocities or the gravity vector of the term are observed.

    `body` is the base frame and `heading` the yaw-only frame. The x axis of `world` is the heading of the robot at the
    start of the episode. Terms that are no vectors ignore the frame.
    """
    values: Numbers = ()
    """Values of the term `constant`; empty for other terms."""
    clock: NonNegative = 0.0
    """Frequency of the clock in the term `gait_clock`, Hz; 0 for other terms."""
    grid: HeightGrid | None = None
    """Grid of the points that the term `height_scan` observes; None for other terms."""
    zero_below: NonNegative = field(default=0.0, repr=False)
    """Threshold of the term `gait_clock`: it is (0, 0) if the norm of the velocity command is smaller.

    0: the clock always runs.
    """
    clock_gain: NonNegative = field(default=0.0, repr=False)
    """Increase of the clock's frequency per horizontal velocity error in excess of 0.4 m/s, Hz per m/s."""
    clock_limit: NonNegative = field(default=0.0, repr=False)
    """Largest increase of the clock's frequency, Hz."""
    bound: NonNegative = field(default=0.0, repr=False)
    """Bound of the values of the term `position_error`, m and rad; 0 for other terms."""
    lags: tuple[Positive, ...] = field(default=(), repr=False)
    """Ages of past values of the term that follow its present value, s.

    They are rounded to control steps of the environment, at least one. The first value after a reset also stands for
    all values before the reset."""
    averages: tuple[Positive, ...] = field(default=(), repr=False)
    """Time constants of exponential averages of the term that follow its past values, s.

    The averages are updated in every control step of the environment. They start with the first value."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.name not in TERM_WIDTHS:
            raise PolicyError(
                f"{brief(self.name)} is not an observation term", f"the terms are {', '.join(TERM_WIDTHS)}"
            )
        for setting, owner in _TERM_OF_SETTING.items():
            if bool(getattr(self, setting)) != (owner == self.name):
                raise PolicyError(f"`{setting}` belongs to the term {owner}, not to {self.name}")
        for setting in _CLOCK_SETTINGS:
            if getattr(self, setting) and self.name != "gait_clock":
                raise PolicyError(f"`{setting}` belongs to the term gait_clock, not to {self.name}")
        if self.history > 1 and (self.lags or self.averages):
            raise PolicyError(f"`history` must be 1 with `lags` or `averages`, not {self.history}")
        if len(self.scale) not in (1, self.width):
            raise PolicyError(f"`scale` must be 1 or {self.width} numbers, not {len(self.scale)}")
        _check_ranges("clip", self.clip)
        _check_plausible(self)

    @property
    def width(self) -> int:
        """Number of values of the term in one control step."""
        width = TERM_WIDTHS[self.name]
        if width is not None:
            return width
        return len(self.grid.x) * len(self.grid.y) if self.grid is not None else len(self.values)

    @property
    def step_width(self) -> int:
        """Number of values of the term in one control step, with its lags and averages."""
        return self.width * (1 + len(self.lags) + len(self.averages))

    @property
    def new_settings(self) -> dict[str, Any]:
        """Settings in `_NEW_SETTINGS` that differ from their defaults: name -> value."""
        return {name: value for name in _NEW_SETTINGS if (value := getattr(self, name))}


@dataclass(frozen=True)
class PolicySpec(_CheckedSpec):
    """Specification of an external policy: its network, observation, actions and servo gains.

    The modules in `readers` read specifications from the deployment files of several projects. A `NetworkPolicy` runs
    the network as its specification describes.
    """

    network: Path
    """Path of the network's file, .onnx or TorchScript .pt."""
    control_rate: Positive
    """Control rate of the policy, Hz."""
    joints: tuple[str, ...]
    """Names of the twelve joints, in the order of the network's actions."""
    default_position: Numbers
    """Joint angles at which the term `joint_position` is zero, in the order of `joints`, rad."""
    action_scale: Numbers
    """Change of each joint target per unit of the network's output, in the order of `joints`, rad."""
    stiffness: tuple[Positive, ...]
    """Servo stiffness, in the order of `joints`, N·m/rad."""
    damping: tuple[NonNegative, ...]
    """Servo damping, in the order of `joints`, N·m·s/rad."""
    terms: tuple[SpecTerm, ...]
    """Observation terms, in the order of the observation."""
    action_offset: Numbers | None = None
    """Joint targets if all actions are zero, in the order of `joints`, rad; None: the default position."""
    action_clip: Range | None = None
    """Minimum and maximum to which each network output is clipped before it is scaled; None: no limits."""
    target_clip: tuple[Range, ...] | None = None
    """Minimum and maximum to which each joint target is clipped, in the order of `joints`, rad.

    None: only the robot's own limits apply.
    """
    observed_joints: tuple[str, ...] | None = None
    """Joint names in the order of the observed joint angles, velocities and torques.

    None: the order of `joints`. The term `previous_action` always has the order of `joints`.
    """
    observation_clip: Positive | None = None
    """Limit to which the absolute value of each observed number is clipped after scaling; None: no limit."""
    history_layout: Literal["term", "time"] = "term"
    """Order of the numbers in an observation with a history of control steps.

    `term` puts all control steps of a term together, `time` puts all terms of a control step together.
    """
    history_newest: Literal["first", "last"] = "last"
    """Position of the newest control step in the history of the observation."""
    history_start: Literal["first", "zero"] = "first"
    """Content of the observation's history at the start of an episode.

    `first` repeats the first observation, `zero` fills the history with zeros.
    """
    previous_action: Literal["raw", "scaled"] = "raw"
    """Form in which the term `previous_action` observes the previous action.

    `raw` is the clipped output of the network. `scaled` is the joint target minus the action offset, rad.
    """
    signs: Numbers | None = None
    """Sense of rotation of each joint: -1 if it is opposite in policy and robot file, else 1.

    The values are in the order of `joints`. None means 1 for all joints. The joint angle in the robot file is
    `zeros + signs * angle`, where `angle` is the policy's joint angle.
    """
    zeros: Numbers | None = None
    """Offset of the zero point of each joint angle between the robot file and the policy, rad.

    The values are in the order of `joints`. A joint of the policy has the angle zero if its angle by the definition in
    the robot file equals this value. None: the offset is zero for all joints. See `signs` for the formula.
    """
    remarks: tuple[str, ...] = field(default=(), compare=False)
    """Assumptions made when the policy's deployment file was read, because it is incomplete, one line each."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_joints()
        _check_plausible(self)
        if not any(self.action_scale):
            raise PolicyError("`action_scale` is 0 for every joint: the network would have no effect")
        _check_ranges("action_clip", self.action_clip)
        _check_ranges("target_clip", *self.target_clip or ())
        self._check_terms()

    def _check_joints(self) -> None:
        """Raise PolicyError if joint names are invalid, or if a field per joint, such as `stiffness`, lacks values."""
        names = (*self.joints, *(self.observed_joints or ()))
        if any(not name.isprintable() or len(name) > MAX_NAME for name in names):
            raise PolicyError(f"`joints` must be names of at most {MAX_NAME} printable characters")
        if not len(self.joints) == len({*self.joints}) == 12:
            raise PolicyError(f"`joints` must be the names of 12 different joints, not {brief(self.joints)}")
        if self.observed_joints is not None and sorted(self.observed_joints) != sorted(self.joints):
            raise PolicyError("`observed_joints` must be the names of `joints`, in another order")
        for name in JOINT_FIELDS:
            values = getattr(self, name)
            if values is not None and len(values) != 12:
                raise PolicyError(f"`{name}` must be of 12 joints, not of {len(values)}")
        if self.signs is not None and not {*self.signs} <= {-1.0, 1.0}:
            raise PolicyError(f"`signs` must be 1 or -1, not {brief(self.signs)}")

    def _check_terms(self) -> None:
        """Raise PolicyError if the observation terms do not fit together.

        A specification must have at least one term and at most MAX_OBSERVATION values. In the history layout `time`,
        the histories of all terms must have the same length.
        """
        if not self.terms:
            raise PolicyError("`terms` must be one term or more", f"the terms are {', '.join(TERM_WIDTHS)}")
        if self.history_layout == "time" and len({term.history for term in self.terms}) > 1:
            raise PolicyError("with the history_layout `time`, all terms must have the same history")
        size = max(term.history for term in self.terms) * sum(term.step_width for term in self.terms)
        if size > MAX_OBSERVATION:
            raise PolicyError(
                f"`terms` show {size} numbers with their history: an observation has at most {MAX_OBSERVATION}"
            )

    @property
    def width(self) -> int:
        """Number of values of the policy's observation, including the histories of all terms."""
        return sum(term.step_width * term.history for term in self.terms)

    @property
    def digest_text(self) -> str:
        """Text of all fields that affect the policy except the network's path, for the policy's digest.

        Newer fields are included only if they differ from their defaults, so that the digests of older specifications
        do not change.
        """
        newer = {name: value for name in ("signs", "zeros") if (value := getattr(self, name)) is not None}
        thresholds = [term.zero_below for term in self.terms]
        if any(thresholds):
            newer["zero_below"] = thresholds
        new_settings = [term.new_settings for term in self.terms]
        if any(new_settings):
            newer["terms"] = new_settings
        older = {name: value for name, value in vars(self).items() if name not in ("signs", "zeros", "remarks")}
        text = repr(older | {"network": ""}) + (repr(newer) if newer else "")
        # Earlier digests contain the former name of the class, so that the text must contain it as well.
        return text.replace("SpecTerm(", "Term(")


def _check_plausible(settings: object) -> None:
    """Raise PolicyError, one line, for the first number in a dataclass that is outside PLAUSIBLE_RANGES.

    A `clock` of 0 is allowed, because it means that the term has no clock.
    """
    for name, (minimum, maximum, unit) in PLAUSIBLE_RANGES.items():
        field_value = getattr(settings, name, None)
        for value in () if field_value is None else np.ravel(field_value).tolist():
            if not minimum <= value <= maximum and (name, value) != ("clock", 0.0):
                limits = f"{minimum:g} to {maximum:g} {unit}".rstrip()
                raise PolicyError(f"`{name}` is beyond any robot's: got {value:g}; valid: {limits}")


def _check_ranges(name: str, *ranges: Range | None) -> None:
    for limits in ranges:
        if limits is not None and not limits[0] < limits[1]:
            raise PolicyError(f"`{name}` must be a minimum and a larger maximum, not {limits}")
