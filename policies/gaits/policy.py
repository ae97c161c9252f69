"""Gaits that follow a velocity command and change into one another, each robot of a batch at its own time.

A change moves phase offsets, duty factor, frequency and all other numbers of the gait smoothly from where they are to
where they are to be. A foot on the ground always moves against the body's velocity at its place, whatever the clock
does, and a swing always starts where the foot left the ground: so nothing jumps, and feet do not scuff, in a change as
little as within a gait.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from policies.base import CONTROL_PERIOD, Actions, GaitedPolicy, Mask, flat_joints, to_actions, validate_mask
from policies.gait_cycle import TURN, Floats, LegCycle, leg_cycles, map_command
from policies.gaits.change import GaitTransition
from policies.gaits.parameters import (
    GAITS,
    INDEX,
    NAMES,
    OFFSETS,
    STAND,
    GaitParameters,
    gait_timing,
    limit_command,
    parameter_row,
    searched_parameters,
    stand_parameters,
)
from policies.legs.foot_path import cycloid, hip_bounce, load_fraction
from policies.legs.kinematics import compensate_servo_load, leg_angles
from policies.memory import initialize_state, per_robot
from quad_env import OBSERVATION
from quad_env.config import GRAVITY
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD

LINEAR_ACCELERATION = 3.0
"""Fastest change of the forward and of the lateral command that the gait follows, m/s²."""
YAW_ACCELERATION = 8.0
"""Fastest change of the yaw rate command that the gait follows, rad/s²."""
MAX_REACH = 0.2
"""Farthest that a foot goes from under its place, forward and sideways each, m."""
PLACEMENT_TOLERANCE = 0.005
"""How far from its place a foot may come to rest, forward and sideways each, m."""
_ACCELERATION = np.array([LINEAR_ACCELERATION, LINEAR_ACCELERATION, YAW_ACCELERATION])


class ParameterView:
    """Parameters of n robots by name, each (n, 1)."""

    def __init__(self, values: Floats) -> None:
        self._values = values

    def __getattr__(self, name: str) -> Floats:
        return self._values[:, INDEX[name], None]


class GaitState(NamedTuple):
    """Where n robots are in their gaits."""

    cycle: LegCycle
    """By the clock, (n, 4)."""
    swing_time: Floats
    """s, (n, 1)."""
    stance_time: Floats
    """s, (n, 1)."""
    sway: Floats
    """How far the left feet are in the air and the right ones not, -1 to 1, by the first harmonic; (n, 1)."""


class Gaits(GaitedPolicy):
    """Steps in the gait asked for; `request` changes it, for all robots or some. A reset puts them in the home pose.

    Args:
        gait: the gait after a reset, one of `gait_parameters.GAITS`; the policy has its name if it is not the trot.
        parameters: of every gait that steps by name; None for the searched ones.
    """

    swing: Mask = per_robot(np.zeros(4, np.bool_))
    """Which feet are to be in the air, (n, 4)."""
    duty: Floats
    """Duty factor in force, (n,)."""
    clock_rate: Floats
    """Gait cycles a second in force, Hz, (n,)."""
    _gait: NDArray[np.int64] = per_robot(GAITS.index(STAND))
    _command: Floats = per_robot(np.zeros(3))
    _window: Mask = per_robot(np.zeros(4, np.bool_))
    _x: Floats = per_robot(np.zeros(4))
    _y: Floats = per_robot()
    _left_x: Floats = per_robot(np.zeros(4))
    _left_y: Floats = per_robot()
    _joints: Floats = per_robot()

    def __init__(
        self,
        gait: str = "trot",
        parameters: Mapping[str, GaitParameters] | None = None,
        *,
        robot: str | Robot = SIMPLE_QUAD,
        control_period: float = CONTROL_PERIOD,
    ) -> None:
        super().__init__(robot=robot, control_period=control_period)
        robot = self.robot
        _known(gait)
        self.name = "gaits" if gait == "trot" else gait
        searched = searched_parameters(robot) if parameters is None else parameters
        self.parameters = {STAND: stand_parameters(robot), **searched}
        self.frequency = self.parameters[gait].frequency
        self.leg_offsets = _offsets(robot, gait)
        self._first = gait
        stand = parameter_row(self.parameters[STAND])
        self._foot_y = robot.side * stand[INDEX["stance_width"]] / 2.0 - robot.hip_positions[:, 1]
        self._change = GaitTransition(stand, _offsets(robot, "walk"), control_period)
        initialize_state(self, _y=self._foot_y, _left_y=self._foot_y, _joints=robot.home_pose)
        self._allocate(1)

    @property
    def gait(self) -> NDArray[np.str_]:
        """The gait last asked for of each robot, (n,)."""
        return np.array(GAITS)[self._gait]

    @property
    def settled(self) -> Mask:
        """Whether each robot is through with its change of gait: at rest, if it is to stand; (n,)."""
        still = ~self.swing.any(axis=1) & (self._command == 0.0).all(axis=1)
        settled: Mask = self._change.settled & (~self._standing | still)
        return settled

    @property
    def offsets(self) -> Floats:
        """Phase of each leg ahead of the clock, rad, in force, (n, 4)."""
        return self._change.offsets

    def request(self, gait: str, mask: ArrayLike | None = None) -> None:
        """Have the robots where `mask`, (n,) of bool, is true change to a gait from now on; all robots without a mask.

        Raises ValueError for a gait that does not exist.
        """
        _known(gait)
        self._send(gait, validate_mask(mask, self.num_envs))

    def _allocate(self, num_envs: int) -> None:
        super()._allocate(num_envs)
        self._set_out(np.ones(num_envs, np.bool_))

    def _reset_rows(self, mask: Mask) -> None:
        super()._reset_rows(mask)
        self._set_out(mask)

    def _set_out(self, mask: Mask) -> None:
        """Send robots that stand to the first gait."""
        self.clock_rate, self.duty = gait_timing(self.robot, self._change.values, self._command)
        self._send(self._first, mask)

    def _send(self, gait: str, mask: Mask) -> None:
        offsets = np.array(_offsets(self.robot, gait))
        # A robot at rest has no footfalls to shift: it sets out with the new ones, from no lift.
        unlifted = np.where(np.array(NAMES) == "step_height", 0.0, self._change.values)
        self._change.place(mask & self._standing & self.settled, unlifted, offsets)
        self._change.start(mask, parameter_row(self.parameters[gait]), offsets)
        self._gait = np.where(mask, GAITS.index(gait), self._gait)

    @property
    def _standing(self) -> Mask:
        standing: Mask = self._gait == GAITS.index(STAND)
        return standing

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        command = observation[:, OBSERVATION["command"]].astype(np.float64)
        self._change.advance()
        values = self._change.values
        # In a change the narrower of the limits now and those to come hold.
        slower = limit_command(np.minimum(values, self._change.goal), command)
        command = np.where(self._standing[:, None], 0.0, slower)
        reach = self.control_period * _ACCELERATION
        self._command = self._command + np.clip(command - self._command, -reach, reach)
        p, robot = ParameterView(values), self.robot
        beat = self._beat(values)
        self._move_feet(beat, p, map_command(p, *(self._command[:, i, None] for i in range(3))))
        _, lift = cycloid(beat.cycle.progress)
        z = np.where(self.swing, p.step_height * lift, 0.0) - p.body_height
        z = z - hip_bounce(beat.cycle, beat.swing_time, beat.stance_time, p.bounce)
        y = self._y + p.sway * beat.sway
        hip, thigh, calf = leg_angles(robot, self._x, y, z)
        share = load_fraction(LegCycle(self.swing, beat.cycle.progress))
        force = share * p.stance_load * (robot.mass * GRAVITY / len(robot.leg_names) / self.duty[:, None])
        joints = flat_joints(np.stack(compensate_servo_load(robot, hip, thigh, calf, self._x, y, force), axis=-1))
        ahead = p.servo_lead / self.control_period * (joints - self._joints)
        self._joints = joints
        return to_actions(robot, joints + ahead)

    def _beat(self, values: Floats) -> GaitState:
        """Advance the clock by a tick, and lift and put down the feet that are due."""
        self.clock_rate, self.duty = gait_timing(self.robot, values, self._command)
        self._phase = (self._phase + TURN * self.control_period * self.clock_rate) % TURN
        phases = (self._phase[:, None] + self.offsets) % TURN
        rate, duty = self.clock_rate[:, None], self.duty[:, None]
        cycle = leg_cycles(phases, duty)
        window = cycle.swing
        # To stand, a foot that is down and in its place stays down; to set out, it lifts at the start of its own swing.
        staying = (self._standing & self._change.settled & (self._command == 0.0).all(axis=1))[:, None]
        starting = window & ~self._window & ~(staying & self._in_place(values))
        swing = window & (self.swing | starting)
        self._left_x = np.where(starting, self._x, self._left_x)
        self._left_y = np.where(starting, self._y, self._left_y)
        self._window, self.swing = window, swing
        to_side = self.robot.side * np.cos(TURN * (phases / TURN - 0.5 * (1.0 - duty)))
        sway = 0.5 * (to_side[:, 0] + to_side[:, 1] + to_side[:, 2] + to_side[:, 3])
        return GaitState(cycle, (1.0 - duty) / rate, duty / rate, sway[:, None])

    def _in_place(self, values: Floats) -> Mask:
        """Which feet are where they belong at rest, (n, 4)."""
        p = ParameterView(values)
        x, y = _middle(self.robot, p)
        return (np.abs(self._x - x) < PLACEMENT_TOLERANCE) & (np.abs(self._y - y) < PLACEMENT_TOLERANCE)

    def _move_feet(self, beat: GaitState, p: ParameterView, velocity: tuple[Floats, Floats, Floats]) -> None:
        """Carry the feet on by a tick: on the ground at -(v + ω × r), through the air to the next foothold."""
        forward, lateral, yaw_rate = velocity
        hip_x, hip_y = self.robot.hip_positions[:, 0], self.robot.hip_positions[:, 1]
        middle_x, middle_y = _middle(self.robot, p)
        ahead_x = forward - yaw_rate * (hip_y + middle_y)
        ahead_y = lateral + yaw_rate * (hip_x + middle_x)
        half = 0.5 * beat.stance_time
        landing_x = middle_x + np.clip(half * ahead_x, -MAX_REACH, MAX_REACH)
        landing_y = middle_y + np.clip(half * ahead_y, -MAX_REACH, MAX_REACH)
        share, _ = cycloid(beat.cycle.progress)
        # Over the ground the foot is carried by `share` of the way, while the ground goes by evenly.
        gone = beat.swing_time * (share - beat.cycle.progress)
        air_x = self._left_x + (landing_x - self._left_x) * share + gone * ahead_x
        air_y = self._left_y + (landing_y - self._left_y) * share + gone * ahead_y
        ground_x = self._x - self.control_period * (forward - yaw_rate * (hip_y + self._y))
        ground_y = self._y - self.control_period * (lateral + yaw_rate * (hip_x + self._x))
        x, y = np.where(self.swing, air_x, ground_x), np.where(self.swing, air_y, ground_y)
        self._x = np.clip(x, middle_x - MAX_REACH, middle_x + MAX_REACH)
        self._y = np.clip(y, middle_y - MAX_REACH, middle_y + MAX_REACH)


def _middle(robot: Robot, p: ParameterView) -> tuple[Floats, Floats]:
    """Middle of the strides in the hip frames, m: (n, 1) and (n, 4)."""
    return p.stance_shift, robot.side * (p.stance_width / 2.0) - robot.hip_positions[:, 1]


def _offsets(robot: Robot, gait: str) -> tuple[float, ...]:
    return robot.in_leg_order(OFFSETS.get(gait, OFFSETS["walk"]))


def _known(gait: str) -> None:
    if gait not in GAITS:
        raise ValueError(f"unknown gait {gait!r}; there are {', '.join(GAITS)}")
