"""Specification of an external policy: joints, servo gains, scales and observation terms.

Joint angles, order and names are as in the policy's own files, in its maker's convention. `observation_adapter` and
`joint_mapping` convert them to the robot's. A joint target is `offset + scale * clip(action)`, rad.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from policies.base import PolicyError
from quad_env.config import Bounds, Finite, NonNegative, Positive, check_settings
from quad_env.files.text import brief

Numbers = tuple[Finite, ...]
Range = tuple[Finite, Finite]

TERM_WIDTHS: dict[str, int | None] = {
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
"""Names of observation terms with their widths; None if the term's own settings define the width."""

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
"""Fields of a specification with a value for each of its `joints`, in their order."""

MAX_SCAN_POINTS = 10_000
"""Largest number of points of a height scan."""
MAX_NAME = 100
"""Largest number of characters of a joint's name."""
MAX_OBSERVATION = 100_000
"""Largest number of observed values of a robot: one control step times the longest history."""
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
    "clip": (-1e12, 1e12, ""),
    "action_clip": (-1e12, 1e12, ""),
    "target_clip": (-1e12, 1e12, "rad"),
}
"""Field -> minimum, maximum, unit. Values outside are far beyond any robot and count as a fault of the file."""
_TERM_OF_SETTING = {"clock": "gait_clock", "grid": "height_scan", "values": "constant"}
"""Settings that belong to one term."""


class _CheckedSpec:
    """Base class of dataclasses that check their fields by their annotations; a wrong value raises PolicyError."""

    def __post_init__(self) -> None:
        try:
            check_settings(self)
        except ValueError as error:
            raise PolicyError(str(error)) from None


@dataclass(frozen=True)
class HeightGrid(_CheckedSpec):
    """Points of a height scan about the trunk, heading frame; the observed height is relative to the trunk."""

    x: Numbers
    """Forward coordinates, m, in the order of the observation."""
    y: Numbers
    """Lateral coordinates, positive to the left, m, in the order of the observation."""
    x_first: bool = True
    """True if x changes fastest from point to point, False if y does."""
    offset: Finite = 0.0
    """m. The observed height of a point is the trunk's height minus the ground's height minus this offset."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_plausible(self)
        if not 1 <= len(self.x) * len(self.y) <= MAX_SCAN_POINTS:
            raise PolicyError(f"a height scan has 1 to {MAX_SCAN_POINTS} points, not {len(self.x)} x {len(self.y)}")


@dataclass(frozen=True)
class SpecTerm(_CheckedSpec):
    """Observation term of a policy: clipped, then scaled."""

    name: str
    """One of TERM_WIDTHS."""
    scale: Numbers = (1.0,)
    """Factor for all of its numbers, or one for each."""
    clip: Range | None = None
    """Minimum and maximum before scaling."""
    history: Annotated[int, Bounds("from 1 to 1000", 1, 1000)] = 1
    """Number of observed control steps, with the present one."""
    frame: Literal["body", "heading", "world"] = "body"
    """Frame of velocities and gravity; the world frame's x axis is the heading at the start of the episode."""
    values: Numbers = ()
    """Values of a `constant`."""
    clock: NonNegative = 0.0
    """Frequency of a `gait_clock`, Hz."""
    grid: HeightGrid | None = None
    """Points of a `height_scan`."""
    zero_below: NonNegative = field(default=0.0, repr=False)
    """Norm of the command below which a `gait_clock` is observed as (0, 0); 0: it always runs."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.name not in TERM_WIDTHS:
            raise PolicyError(
                f"{brief(self.name)} is not an observation term", f"the terms are {', '.join(TERM_WIDTHS)}"
            )
        for setting, owner in _TERM_OF_SETTING.items():
            if bool(getattr(self, setting)) != (owner == self.name):
                raise PolicyError(f"`{setting}` belongs to the term {owner}, not to {self.name}")
        if self.zero_below and self.name != "gait_clock":
            raise PolicyError(f"`zero_below` belongs to the term gait_clock, not to {self.name}")
        if len(self.scale) not in (1, self.width):
            raise PolicyError(f"`scale` must be 1 or {self.width} numbers, not {len(self.scale)}")
        _check_ranges("clip", self.clip)
        _check_plausible(self)

    @property
    def width(self) -> int:
        """Number of values in one control step."""
        width = TERM_WIDTHS[self.name]
        if width is not None:
            return width
        return len(self.grid.x) * len(self.grid.y) if self.grid is not None else len(self.values)


@dataclass(frozen=True)
class PolicySpec(_CheckedSpec):
    """Specification of an external policy: its network, observation, actions and servo gains.

    The readers of deployment files make it; `NetworkPolicy` runs it.
    """

    network: Path
    """File of the network, .onnx or TorchScript .pt."""
    control_rate: Positive
    """Control rate of the policy, Hz."""
    joints: tuple[str, ...]
    """Names of the twelve joints, in the order of the actions."""
    default_position: Numbers
    """Zero of the term `joint_position`, rad, in the order of `joints`."""
    action_scale: Numbers
    """Joint angle for an action of one, rad, in the order of `joints`."""
    stiffness: tuple[Positive, ...]
    """Servo stiffness, N·m/rad, in the order of `joints`."""
    damping: tuple[NonNegative, ...]
    """Servo damping, N·m·s/rad, in the order of `joints`."""
    terms: tuple[SpecTerm, ...]
    """Terms in the order of the observation."""
    action_offset: Numbers | None = None
    """Targets of zero actions, rad, in the order of `joints`; None: the default position."""
    action_clip: Range | None = None
    """Minimum and maximum of a raw action."""
    target_clip: tuple[Range, ...] | None = None
    """Minimum and maximum of the joint targets, rad, in the order of `joints`, within the robot's own limits."""
    observed_joints: tuple[str, ...] | None = None
    """Names of the joints in the order of the observed angles, velocities and torques; None: the order of `joints`.

    Previous actions keep the order of `joints`.
    """
    observation_clip: Positive | None = None
    """Largest magnitude of an observed number, after scaling."""
    history_layout: Literal["term", "time"] = "term"
    """Order of histories: `term` keeps all control steps of a term together, `time` all terms of a control step."""
    history_newest: Literal["first", "last"] = "last"
    """Place of the newest control step."""
    history_start: Literal["first", "zero"] = "first"
    """Content of the history at the start of an episode: the first observation, or zeros."""
    previous_action: Literal["raw", "scaled"] = "raw"
    """Observed previous action: `raw` is the network's output, clipped, `scaled` the target minus its offset, rad."""
    signs: Numbers | None = None
    """1 or -1 in the order of `joints`; -1 where the directions of the policy's and the robot file's joint differ.

    None: 1. The robot file's angle is `zeros + signs * the policy's`.
    """
    zeros: Numbers | None = None
    """Angles of the robot file's joints at the policy's zero, rad, in the order of `joints`; None: 0."""
    remarks: tuple[str, ...] = field(default=(), compare=False)
    """Assumptions where the file is incomplete, a line each."""

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
        """Raise PolicyError for wrong names of joints, and for fields of another number of joints."""
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
        """Raise PolicyError for no terms, different histories by time, and too many numbers."""
        if not self.terms:
            raise PolicyError("`terms` must be one term or more", f"the terms are {', '.join(TERM_WIDTHS)}")
        if self.history_layout == "time" and len({term.history for term in self.terms}) > 1:
            raise PolicyError("with the history_layout `time`, all terms must have the same history")
        size = max(term.history for term in self.terms) * sum(term.width for term in self.terms)
        if size > MAX_OBSERVATION:
            raise PolicyError(
                f"`terms` show {size} numbers with their history: an observation has at most {MAX_OBSERVATION}"
            )

    @property
    def width(self) -> int:
        """Number of values of the whole observation."""
        return sum(term.width * term.history for term in self.terms)

    @property
    def digest_text(self) -> str:
        """All settings that affect the policy except its network, for a digest.

        Newer fields enter only if they are set, so that older specifications keep their digests.
        """
        newer = {name: value for name in ("signs", "zeros") if (value := getattr(self, name)) is not None}
        thresholds = [term.zero_below for term in self.terms]
        if any(thresholds):
            newer["zero_below"] = thresholds
        older = {name: value for name, value in vars(self).items() if name not in ("signs", "zeros", "remarks")}
        text = repr(older | {"network": ""}) + (repr(newer) if newer else "")
        return text.replace("SpecTerm(", "Term(")  # the name of the class in earlier digests


def _check_plausible(settings: object) -> None:
    """Raise PolicyError, one line, for the first number outside PLAUSIBLE_RANGES; 0 means no clock."""
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
