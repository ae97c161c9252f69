"""A robot as a value: its parameters, and joint limits, mass and SHA-256 of its compiled model."""

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quad_env.files.text import one_line
from quad_env.robots.model_digest import digest
from quad_env.robots.parameter_inference import load_parameters
from quad_env.robots.parameters import Floats, RobotParameters, format_range, read_only_array
from quad_env.robots.scene import build_spec
from quad_env.robots.structure import JOINTS_PER_LEG, LEGS

JOINTS = LEGS * JOINTS_PER_LEG
"""Number of joints of a robot."""
_SHOWN_LENGTH = 80
"""Largest number of characters of a wrong value in an error message."""


class Robot(RobotParameters):
    """A robot with four legs; made by `from_mjcf`, or taken from `quad_env.ROBOTS`.

    Two robots are equal if all their parameters except the servo gains are equal.
    """

    @classmethod
    def from_mjcf(cls, path: str | Path, name: str | None = None, **figures: Any) -> "Robot":
        """Return the quadruped of an MJCF or a URDF, with any names of its parts and any order of its legs.

        The robot is the body with the free joint, or a URDF's root link, and all below it. A leg is a chain of three
        hinges: about the trunk's x axis and twice about the leg's y axis. Its foot is every colliding geom of its last
        body that can be the lowest in a stance. Lengths, limits, torques and the bend directions of the knees are read
        from the compiled model. The home pose comes from its keyframe or, without one, from SimpleQuad's proportions.
        The joints have our servos, scaled from SimpleQuad's by mass and leg length, with the least of the model's
        largest torques. Other hinges and slides, as of an arm or of wheels on the feet, are locked at the first
        keyframe or else at `qpos0`, see `locked_joints`. `model_fields` lists the treatment of every other field of
        the model, and `describe` names the omitted parts.

        Args:
            path: The MJCF or URDF, or a TOML file of parameters with the MJCF's path from there as `mjcf`, as
                `python -m quad_env describe` writes it.
            name: Name of the robot; None for the name of the file, without its ending.
            **figures: Fields of `Robot` that are given instead of being inferred. A ModelError, which is a ValueError,
                says in a line why the file is no quadruped of this kind, or names a parameter that must be given.

        Returns:
            The quadruped of an MJCF or a URDF, with any names of its parts and any order of its legs.
        """
        parameters = load_parameters(Path(path), name, **figures)
        robot = cls(**parameters.by_name)
        vars(robot)["user_model"] = parameters.user_model
        return robot

    def with_servo(self, stiffness: ArrayLike | None = None, damping: ArrayLike | None = None) -> "Robot":
        """Return the robot with servo gains that every controller has to use. Raises ValueError for invalid gains.

        Args:
            stiffness: A number or (12,), N·m/rad; None for the robot's own.
            damping: A number or (12,), N·m·s/rad; None for the robot's own.

        Returns:
            The robot with servo gains that every controller has to use.
        """
        own_or_given = (
            self.servo_stiffness if stiffness is None else stiffness,
            self.servo_damping if damping is None else damping,
        )
        gains = parse_servo_gains(own_or_given, 1)[:, 0]
        fixed = bool((gains != self.stiff_servo).any())
        return self._with(servo_stiffness=gains[0], servo_damping=gains[1], servo_fixed=fixed)

    @cached_property
    def with_stiff_servos(self) -> "Robot":
        """The robot with the gains `stiff_servo`, for controllers that need them; itself if its gains are fixed."""
        stiffness, damping = self.stiff_servo
        return self if self.servo_fixed else self._with(servo_stiffness=stiffness, servo_damping=damping)

    def _with(self, **figures: Any) -> "Robot":
        """Return a copy with other parameters that change neither limits nor mass; itself where nothing differs."""
        if all(np.array_equal(getattr(self, name), value) for name, value in figures.items()):
            return self
        copy = self.replace(**figures)
        vars(copy)["_compiled"] = self._compiled
        return copy

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Robot) and self._key == other._key

    def __hash__(self) -> int:
        return hash((self.name, self.mjcf))

    def __reduce__(self) -> tuple[type["Robot"], tuple[object, ...]]:
        return Robot, tuple(self.by_name.values())

    @cached_property
    def _key(self) -> tuple[object, ...]:
        """Parameters that decide equality; cached, since tables are looked up by robot at every step."""
        compared = [value for name, value in self.by_name.items() if "servo" not in name]
        return tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in compared)

    @property
    def joint_lower(self) -> Floats:
        """Lower joint limits of the model, shape (12,), rad."""
        return self._compiled[0]

    @property
    def joint_upper(self) -> Floats:
        """Upper joint limits of the model, shape (12,), rad."""
        return self._compiled[1]

    @property
    def mass(self) -> float:
        """Mass of the model, kg."""
        return self._compiled[2]

    @property
    def joint_damping(self) -> Floats:
        """Damping of the model's joints in addition to the servos', (12,), N·m·s/rad."""
        dofs = [int(self.model.joint(name).dofadr[0]) for name in self.joint_names]
        return read_only_array(self.model.dof_damping[dofs])

    @property
    def joint_damping_line(self) -> str:
        """Share of the joints' own damping relative to the servos', in words; empty where it is zero."""
        damping = self.joint_damping
        if not damping.any():
            return ""
        return f"the joints' own damping of {format_range(damping)} N·m·s/rad adds to that of the servos"

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the names and, to six digits, the numbers of the compiled model that bind a trained policy."""
        return digest((*self.leg_names, *self.joint_names), self.model)

    @cached_property
    def _compiled(self) -> tuple[Floats, Floats, float]:
        model = self.model
        lower, upper = model.jnt_range[[model.joint(name).id for name in self.joint_names]].T
        return read_only_array(lower), read_only_array(upper), float(np.round(model.body_mass.sum(), 9))

    @cached_property
    def model(self) -> Any:
        """Compiled `mujoco.MjModel` on flat ground; read only."""
        return build_spec(self).compile()


def parse_servo_gains(servo: Any, num_robots: int) -> Floats:
    """Return stiffness and damping of servos, (2, num_robots, 12), N·m/rad and N·m·s/rad.

    Args:
        servo: Pair of stiffness and damping, numbers or arrays that broadcast to (num_robots, 12).
        num_robots: Number of robots.

    Returns:
        Stiffness and damping of servos, (2, num_robots, 12), N·m/rad and N·m·s/rad.

    Raises:
        ValueError: It is no pair, has another shape, or has values that are not finite and above 0.
    """
    try:
        stiffness, damping = (np.array(gains, dtype=np.float64) for gains in servo)
        gains = np.stack([np.broadcast_to(gain, (num_robots, JOINTS)) for gain in (stiffness, damping)])
    except (TypeError, ValueError):
        shapes = f"a number, ({JOINTS},) or ({num_robots}, {JOINTS})"
        raise ValueError(f"servo is a pair of stiffness and damping, each {shapes}, got {_shown(servo)}") from None
    if not (np.isfinite(gains) & (gains > 0.0)).all():
        raise ValueError(f"servo gains are finite numbers above 0, N·m/rad and N·m·s/rad, got {_shown(servo)}")
    return gains


def _shown(value: Any) -> str:
    """Return the start of a wrong value's `repr`, for an error message."""
    return one_line(repr(value))[:_SHOWN_LENGTH]
