"""A robot as a value: its figures, and what its compiled MJCF gives besides: joint limits, mass, SHA-256."""

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from quad_env.files.text import one_line
from quad_env.robots.model_digest import digest
from quad_env.robots.parameter_inference import load_parameters
from quad_env.robots.parameters import Floats, RobotParameters, read_only_array
from quad_env.robots.scene import build_spec
from quad_env.robots.structure import JOINTS_PER_LEG, LEGS

JOINTS = LEGS * JOINTS_PER_LEG


class Robot(RobotParameters):
    """A robot with four legs; two are equal when all their figures but the gains of the servos are."""

    @classmethod
    def from_mjcf(cls, path: str | Path, name: str | None = None, **figures: Any) -> "Robot":
        """The quadruped of an MJCF or a URDF, whatever its parts are called and in whatever order its legs are.

        The robot is the body with the free joint, or a URDF's root link, and all below it. A leg is a chain of three
        hinges: about the trunk's x axis and twice about the leg's y axis; its foot is every colliding geom of its last
        body that can be the lowest in a stance. Lengths, limits, torques and the way the knees bend are read from the
        compiled model, the home pose from its keyframe or, without one, by SimpleQuad's proportions. Its joints have
        our servos, scaled from SimpleQuad's by mass and leg length, with the least of the model's largest torques.
        Other hinges and slides, as of an arm or of wheels on the feet, are held where the first keyframe or else
        `qpos0` has them, see `held`.
        `model_fields` lists what becomes of every other field of the model, and `describe` names what is left out.

        Args:
            path: the MJCF or URDF, or a TOML file of figures with the MJCF's path from there as `mjcf`: what
                `python -m quad_env describe` writes.
            name: of the robot; None for the file's, without its ending.
            figures: fields of `Robot` that are not to be inferred.

        Raises:
            ModelError: a ValueError that says in a line why this is no such quadruped, or what has to be given.
        """
        parameters = load_parameters(Path(path), name, **figures)
        robot = cls(**parameters.by_name)
        vars(robot)["user_model"] = parameters.user_model
        return robot

    def with_servo(self, stiffness: ArrayLike | None = None, damping: ArrayLike | None = None) -> "Robot":
        """The robot with these gains of its servos, a number or (12,), N·m/rad and N·m·s/rad, for every controller.

        None keeps the robot's own. Raises ValueError for what is no gain.
        """
        pairs = (self.servo_stiffness, stiffness), (self.servo_damping, damping)
        gains = parse_servo_gains([own if given is None else given for own, given in pairs], 1)[:, 0]
        fixed = bool((gains != self.stiff_servo).any())
        return self._with(servo_stiffness=gains[0], servo_damping=gains[1], servo_fixed=fixed)

    @cached_property
    def with_stiff_servos(self) -> "Robot":
        """The robot as controllers have it that need stiff servos: with `stiff_servo`, unless its gains are fixed."""
        stiffness, damping = self.stiff_servo
        return self if self.servo_fixed else self._with(servo_stiffness=stiffness, servo_damping=damping)

    def _with(self, **figures: Any) -> "Robot":
        """A copy with other figures that change neither limits nor mass; the robot itself where nothing differs."""
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
        """What robots are compared by, at every step where tables are looked up by robot."""
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
        values = " to ".join(f"{value:.3g}" for value in sorted({float(damping.min()), float(damping.max())}))
        return f"the joints' own damping of {values} N·m·s/rad adds to that of the servos"

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of names and figures of the compiled model, to six digits: of what a trained policy hangs on."""
        return digest((*self.leg_names, *self.joint_names), self.model)

    @cached_property
    def _compiled(self) -> tuple[Floats, Floats, float]:
        model = self.model
        lower, upper = model.jnt_range[[model.joint(name).id for name in self.joint_names]].T
        return read_only_array(lower), read_only_array(upper), float(np.round(model.body_mass.sum(), 9))

    @cached_property
    def model(self) -> Any:
        """The compiled `mujoco.MjModel` on flat ground; not to be written to."""
        return build_spec(self).compile()


def parse_servo_gains(servo: Any, num_robots: int) -> Floats:
    """Stiffness and damping of servos, (2, num_robots, 12), of a pair of numbers or arrays that broadcast to them.
    Raises ValueError for what is none."""
    try:
        stiffness, damping = (np.array(gains, dtype=np.float64) for gains in servo)
        gains = np.stack([np.broadcast_to(each, (num_robots, JOINTS)) for each in (stiffness, damping)])
    except (TypeError, ValueError):
        shapes = f"a number, ({JOINTS},) or ({num_robots}, {JOINTS})"
        raise ValueError(
            f"servo is a pair of stiffness and damping, each {shapes}, got {one_line(repr(servo)):.80}"
        ) from None
    if not (np.isfinite(gains) & (gains > 0.0)).all():
        raise ValueError(
            f"servo gains are finite numbers above 0, N·m/rad and N·m·s/rad, got {one_line(repr(servo)):.80}"
        )
    return gains
