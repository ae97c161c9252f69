"""Left and right exchanged: what a robot observes and does as its own image in a mirror at its x–z plane.

Forward and up stay, left becomes right; turns about y stay, turns about x and z go the other way round.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import Actions, GaitedPolicy, Policy
from policies.history import Inputs
from policies.residual import NO_SHIFT, PRESENT, Space
from quad_env.robots.robot import Robot
from quad_env.task.observations import observation_table

_VECTOR, _TURN, _COMMAND, _JOINTS = (1, -1, 1), (-1, 1, -1), (1, -1, -1), (-1, 1, 1)
"""Signs of x, y, z of a vector and of an angular velocity, of forward, lateral and yaw rate, of hip, thigh and calf."""
_SHIFT = np.array((*_COMMAND, 1, 1, 1, 1, -1))
"""Those of what a base is shifted by, `policies.residual.SHIFTED`."""


@dataclass(frozen=True, eq=False)
class Mirror:
    """A row of numbers in the mirror: its entry i is `sign[i]` times the entry `source[i]`."""

    source: NDArray[np.intp]
    sign: NDArray[np.float32]

    def __call__(self, rows: NDArray[Any]) -> NDArray[Any]:
        """The mirror image of rows (..., k)."""
        return rows[..., self.source] * self.sign


def of_signs(*signs: float) -> Mirror:
    """The mirror of numbers that stay in their places."""
    return Mirror(np.arange(len(signs)), np.array(signs, np.float32))


def joined(*mirrors: Mirror) -> Mirror:
    """The mirror of rows side by side."""
    starts = np.cumsum([0, *(len(each.source) for each in mirrors)])
    sources = [start + each.source for start, each in zip(starts, mirrors, strict=False)]
    return Mirror(np.concatenate(sources), np.concatenate([each.sign for each in mirrors]))


def command_mirror() -> Mirror:
    """The mirror of forward and lateral velocity and yaw rate."""
    return of_signs(*_COMMAND)


def leg_mirror(robot: Robot, signs: tuple[int, int, int] = _JOINTS) -> Mirror:
    """The mirror of three numbers a leg, (12,), of these signs: those of angles, speeds or targets of its joints unless
    told otherwise. Raises ValueError for a robot that is not its own mirror image."""
    places = np.arange(robot.num_joints).reshape(-1, len(signs))[_partners(robot)]
    return Mirror(places.ravel(), np.tile(np.array(signs, np.float32), len(places)))


def observation_mirror(robot: Robot) -> Mirror:
    """The mirror of observations, scaled or not."""
    joints = leg_mirror(robot)
    parts = {
        "projected_gravity": of_signs(*_VECTOR),
        "angular_velocity": of_signs(*_TURN),
        "linear_velocity": of_signs(*_VECTOR),
        "joint_position": joints,
        "joint_velocity": joints,
        "previous_action": joints,
        "command": command_mirror(),
    }
    return joined(*(parts[term.name] for term in observation_table(robot).terms))


def phase_sign(robot: Robot, offsets: ArrayLike) -> int:
    """What sine and cosine of a clock are multiplied by in the mirror: -1 where left and right are half a cycle apart,
    1 where they go together. Raises ValueError for a gait, phase offsets of the legs, rad, that does neither.
    """
    ahead = np.asarray(offsets, dtype=np.float64)
    signs = np.cos(ahead[_partners(robot)] - ahead)
    if not (np.allclose(signs, 1.0) or np.allclose(signs, -1.0)):
        raise ValueError(f"a gait of phase offsets {np.round(ahead, 3).tolist()} rad has another for its mirror image")
    return round(float(signs[0]))


def features_mirror(base: Policy, inputs: Inputs = PRESENT, shift_authority: Actions = NO_SHIFT) -> Mirror:
    """The mirror of `policies.residual.Features`. Raises ValueError for a base whose gait is not its own mirror image.

    A clock of its own, or that of the base, is half a cycle on unless the base moves left and right together.
    """
    robot, clock = base.robot, -1
    observation = observation_mirror(robot)
    parts = [observation]
    if isinstance(base, GaitedPolicy):
        clock = phase_sign(robot, base.leg_offsets)
        parts += [of_signs(clock, clock), leg_mirror(robot)]
    if inputs.clock:
        parts += [of_signs(clock, clock)]
    return joined(*parts, *[observation] * inputs.frames, _shift_mirror(shift_authority))


def correction_mirror(robot: Robot, shift_authority: Actions = NO_SHIFT, space: Space = "joints") -> Mirror:
    """The mirror of corrections of joints or feet and of what the base is shifted by."""
    legs = leg_mirror(robot, _VECTOR if space == "feet" else _JOINTS)
    return joined(legs, _shift_mirror(shift_authority))


def _shift_mirror(authority: Actions) -> Mirror:
    return of_signs(*_SHIFT[np.flatnonzero(authority)])


def _partners(robot: Robot) -> NDArray[np.intp]:
    """Place of the leg on the other side of each leg, (4,)."""
    across = robot.hip_positions * _VECTOR
    distances = np.linalg.norm(across[:, None] - robot.hip_positions, axis=2)
    if distances.min(axis=1).max() > 1e-6:
        raise ValueError(f"the hips of {robot.name} on the left are not across from those on the right")
    partners: NDArray[np.intp] = distances.argmin(axis=1)
    home = robot.home_pose.reshape(len(partners), -1)
    if not np.allclose(home[partners] * _JOINTS, home):
        raise ValueError(f"{robot.name} stands at home otherwise than its mirror image does")
    return partners
