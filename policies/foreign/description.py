"""What a policy from another project reads and commands, as one value: joints, gains, scales, observation terms.

Joint angles, order and names are those of the policy's own files, in its maker's convention; `terms` and `joints` of
this package bring them to the robot's. A target is `offset + scale * clip(action)`, rad.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

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

    @property
    def width(self) -> int:
        """Numbers of the whole observation."""
        return sum(term.width * term.history for term in self.terms)
