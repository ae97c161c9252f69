"""The class `Robot`, which has parameters of a quadruped and properties of its compiled MuJoCo model."""

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quad_env.files.text import one_line
from quad_env.robots.model_digest import digest
from quad_env.robots.parameter_inference import load_parameters
from quad_env.robots.parameters import Floats, RobotParameters, format_range, read_only_array
from quad_env.robots.scene import build_spec
from quad_env.robots.structure import JOINTS_PER_LEG, LEGS

JOINTS = LEGS * JOINTS_PER_LEG
"""Number of leg joints of a robot, 12."""
STIFF = "stiff"
"""Value of the option `servo` of `gym.make` that selects the gains `stiff_servo` of a robot."""
_SHOWN_LENGTH = 80
"""Number of characters of a wrong argument after which an error message shortens it."""


class Robot(RobotParameters):
    """A quadruped with three joints per leg; made by `from_mjcf`, or taken from `quad_env.ROBOTS`.

    Two robots are equal if all their parameters except the servo gains are equal.
    """

    @classmethod
    def from_mjcf(cls, path: str | Path, name: str | None = None, **figures: Any) -> "Robot":
        """Load a quadruped from an MJCF or URDF file. Names of parts and the order of the legs are arbitrary.

        The robot is the body with the free joint, or the root link of a URDF, and all bodies below it. A leg is a chain
        of three hinges: the first about the trunk's x axis, the others about the leg's y axis. The foot consists of the
        colliding geoms of the leg's last body that can be the lowest point in a stance.

        Lengths, joint limits, torques and knee directions are read from the compiled model. The home pose has the
        height of the first keyframe in which the robot stands, or SimpleQuad's proportions if there is no such
        keyframe.

        The joints are driven by position servos with SimpleQuad's gains, scaled by mass and leg length. The torque
        limit of all joints is the smallest of the model's joint torque limits.

        All other hinges and slides, such as an arm or wheels on the feet, are locked, see `locked_joints`. They are
        locked at the first keyframe, or at `qpos0` if the model has none. `model_fields` lists the treatment of every
        other field of the model, and `describe` names the omitted parts.

        A ModelError, which is a ValueError, says why the file is no quadruped of this kind, or names a parameter that
        must be given.

        Args:
            path: The MJCF or URDF file, or a TOML file of parameters as `python -m quad_env describe` writes it. The
                entry `mjcf` of the TOML is the path of the model, relative to the TOML.
            name: Name of the robot; None for the name of the file without its ending.
            **figures: Name and value of each field of `Robot` that is given instead of being inferred from the model,
                such as `rated_torque=30.0`; see `GIVEN_PARAMETERS`.

        Returns:
            The robot.
        """
        parameters = load_parameters(Path(path), name, **figures)
        robot = cls(**parameters.by_name)
        vars(robot)["user_model"] = parameters.user_model
        return robot

    def with_servo(self, stiffness: ArrayLike | None = None, damping: ArrayLike | None = None) -> "Robot":
        """Return a copy of the robot with other servo gains, which every controller then has to use.

        Invalid gains raise ValueError.

        Args:
            stiffness: Gain on the joint angle error, a number or (12,), N·m/rad; None for the gain of this robot.
            damping: Gain on the joint speed, a number or (12,), N·m·s/rad; None for the gain of this robot.

        Returns:
            The robot with these gains. The attribute `servo_fixed` of this robot is True if the gains differ from
            `stiff_servo`.
        """
        own_or_given = (
            self.servo_stiffness if stiffness is None else stiffness,
            self.servo_damping if damping is None else damping,
        )
        gains = parse_servo_gains(own_or_given, 1)[:, 0]
        fixed = bool((gains != self.stiff_servo).any())
        return self._with(servo_stiffness=gains[0], servo_damping=gains[1], servo_fixed=fixed)

    def servo_gains(self, servo: Any = None, num_robots: int = 1) -> Floats:
        """Return the servo gains that the option `servo` of `gym.make` and `policies.make` selects for this robot.

        Invalid gains raise ValueError.

        Args:
            servo: None for the gains of this robot, "stiff" for `stiff_servo`, or a pair of stiffness, N·m/rad, and
                damping, N·m·s/rad: numbers or arrays that broadcast to (num_robots, 12).
            num_robots: Number of robots in the batch.

        Returns:
            Servo gains, (2, num_robots, 12): first the stiffness, N·m/rad, then the damping, N·m·s/rad.
        """
        if servo is None:
            servo = self.gains
        elif isinstance(servo, str) and servo == STIFF:
            servo = self.stiff_servo
        return parse_servo_gains(servo, num_robots)

    @property
    def gains(self) -> Floats:
        """Servo gains of all joints, (2, 12): stiffness, N·m/rad, and damping, N·m·s/rad."""
        return np.array((self.servo_stiffness, self.servo_damping))

    def has_gains(self, gains: Any) -> bool:
        """Return True if the servos have these `gains`: stiffness, N·m/rad, and damping, N·m·s/rad, each (12,)."""
        return np.array_equal(self.gains, gains)

    @cached_property
    def with_stiff_servos(self) -> "Robot":
        """Copy of this robot with the servo gains `stiff_servo`, for controllers that need stiff servos.

        If `servo_fixed` is True, the property is this robot itself, with the gains `servo_stiffness` and
        `servo_damping`.
        """
        stiffness, damping = self.stiff_servo
        return self if self.servo_fixed else self._with(servo_stiffness=stiffness, servo_damping=damping)

    def _with(self, **figures: Any) -> "Robot":
        """Return a copy of the robot with other values of some parameters, or the robot itself if none differs.

        The copy keeps the cached joint limits and mass, so the changed parameters must not affect them.

        Args:
            **figures: Name and new value of each changed parameter.

        Returns:
            The robot.
        """
        if all(np.array_equal(getattr(self, name), value) for name, value in figures.items()):
            return self
        copy = self.replace(**figures)
        vars(copy)["_compiled"] = self._compiled
        return copy

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Robot) and self._key == other._key

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> tuple[type["Robot"], tuple[object, ...]]:
        return Robot, tuple(self.by_name.values())

    @cached_property
    def _key(self) -> tuple[object, ...]:
        """Values of all parameters except the servo gains, with arrays as bytes; equal robots have equal keys.

        The tuple is cached, because dictionaries are looked up by robot at every control step.
        """
        compared = [value for name, value in self.by_name.items() if "servo" not in name]
        return tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in compared)

    @cached_property
    def _hash(self) -> int:
        """Hash value of the robot, cached for the same reason as `_key`."""
        return hash((self.name, self.mjcf))

    @property
    def joint_lower(self) -> Floats:
        """Lower joint limits of the robot's compiled model, zero with the legs straight down, (12,), rad."""
        return self._compiled[0]

    @property
    def joint_upper(self) -> Floats:
        """Upper joint limits of the robot's compiled model, zero with the legs straight down, (12,), rad."""
        return self._compiled[1]

    @cached_property
    def action_limits(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Lower and upper joint limits in float32, the type of an action, (12,) each, rad."""
        lower = self.joint_lower.astype(np.float32)
        upper = self.joint_upper.astype(np.float32)
        lower.flags.writeable = False
        upper.flags.writeable = False
        return lower, upper

    @property
    def mass(self) -> float:
        """Total mass of the robot's compiled model, kg."""
        return self._compiled[2]

    @property
    def joint_damping(self) -> Floats:
        """Passive damping of the joints, which adds to the damping of the servos, (12,), N·m·s/rad."""
        dofs = [int(self.model.joint(name).dofadr[0]) for name in self.joint_names]
        return read_only_array(self.model.dof_damping[dofs])

    @property
    def joint_damping_line(self) -> str:
        """Sentence about the passive damping of the joints, for `describe`; empty if the damping is zero."""
        damping = self.joint_damping
        if not damping.any():
            return ""
        return f"the joints' own damping of {format_range(damping)} N·m·s/rad adds to that of the servos"

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the robot's compiled model; a trained policy is valid only for a robot with the same value.

        The hashed text contains the names of legs and joints, and the model's physical numbers, rounded to six
        significant digits.
        """
        return digest((*self.leg_names, *self.joint_names), self.model)

    @cached_property
    def _compiled(self) -> tuple[Floats, Floats, float]:
        model = self.model
        lower, upper = model.jnt_range[[model.joint(name).id for name in self.joint_names]].T
        return read_only_array(lower), read_only_array(upper), float(np.round(model.body_mass.sum(), 9))

    @cached_property
    def model(self) -> Any:
        """Compiled `mujoco.MjModel` of the robot on flat ground; it must not be changed."""
        return build_spec(self).compile()


def parse_servo_gains(servo: Any, num_robots: int) -> Floats:
    """Check servo gains, and broadcast them to all joints of all robots.

    Args:
        servo: Pair of stiffness, N·m/rad, and damping, N·m·s/rad: numbers or arrays that broadcast to (num_robots, 12).
        num_robots: Number of robots in the batch.

    Returns:
        Servo gains, (2, num_robots, 12): first the stiffness, N·m/rad, then the damping, N·m·s/rad.

    Raises:
        ValueError: `servo` is no pair, has a wrong shape, or has a gain that is not a finite number above 0.
    """
    try:
        stiffness, damping = (np.array(gains, dtype=np.float64) for gains in servo)
        gains = np.stack([np.broadcast_to(gain, (num_robots, JOINTS)) for gain in (stiffness, damping)])
    except (TypeError, ValueError):
        shapes = f"a number, ({JOINTS},) or ({num_robots}, {JOINTS})"
        fact = f'servo is a pair of stiffness and damping, each {shapes}, or "{STIFF}"'
        raise ValueError(f"{fact}; got {_shown(servo)}") from None
    if not (np.isfinite(gains) & (gains > 0.0)).all():
        raise ValueError(f"servo gains are finite numbers above 0, N·m/rad and N·m·s/rad, got {_shown(servo)}")
    return gains


def _shown(value: Any) -> str:
    """Return the `repr` of a wrong value for an error message, shortened to `_SHOWN_LENGTH` characters."""
    return one_line(repr(value))[:_SHOWN_LENGTH]
