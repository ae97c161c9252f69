"""Gaits that follow a velocity command; each robot of a batch can change its gait smoothly.

A change of gait moves phase offsets, duty factor, frequency and all other parameters smoothly to their new values. A
stance foot always moves against the velocity of the body at this foot, and a swing always starts where the foot left
the ground. Therefore targets do not jump and feet do not scuff, neither within a gait nor during a change.
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
"""Largest rate of the forward and of the lateral command that the gait follows, m/s²."""
YAW_ACCELERATION = 8.0
"""Largest rate of the yaw-rate command that the gait follows, rad/s²."""
MAX_REACH = 0.2
"""Largest distance of a foot from the middle of its strides, along x and along y, m."""
PLACEMENT_TOLERANCE = 0.005
"""Largest distance of a foot that comes to rest from the middle of its strides, along x and along y, m."""
_ACCELERATION = np.array([LINEAR_ACCELERATION, LINEAR_ACCELERATION, YAW_ACCELERATION])


class ParameterView:
    """Access to the parameters of n robots as attributes, each (n, 1).

    Args:
        values: Parameters, (n, len(NAMES)).
    """

    def __init__(self, values: Floats) -> None:
        self._values = values

    def __getattr__(self, name: str) -> Floats:
        return self._values[:, INDEX[name], None]


class GaitState(NamedTuple):
    """Leg cycles, swing and stance times of n robots in one control step."""

    cycle: LegCycle
    """Leg cycle by the clock, (n, 4)."""
    swing_time: Floats
    """Duration of a swing, (n, 1), s."""
    stance_time: Floats
    """Duration of a stance, (n, 1), s."""
    sway: Floats
    """First harmonic of the number of left minus right swing feet, scaled to [-1, 1], (n, 1).

    It is 1 if the left feet are in the air."""


class Gaits(GaitedPolicy):
    """Policy that walks in a gait; `request` changes the gait of all or some robots.

    A robot starts from the home pose after a reset.

    Args:
        gait: Gait after a reset, one of `policies.gaits.parameters.GAITS`. The name of the policy is the name of this
            gait, or `gaits` if it is the trot.
        parameters: Name of every gait that steps -> its parameters; None for the searched parameters.
        robot: See `Policy`.
        control_period: See `Policy`.
    """

    swing: Mask = per_robot(np.zeros(4, np.bool_))
    """True for feet in swing, (n, 4)."""
    duty: Floats
    """Current duty factor, (n,)."""
    clock_rate: Floats
    """Current gait frequency, (n,), Hz."""
    _gait: NDArray[np.int64] = per_robot(GAITS.index(STAND))
    _command: Floats = per_robot(np.zeros(3))
    _window: Mask = per_robot(np.zeros(4, np.bool_))
    _x: Floats = per_robot(np.zeros(4))
    _y: Floats = per_robot()
    _liftoff_x: Floats = per_robot(np.zeros(4))
    _liftoff_y: Floats = per_robot()
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
        _check_gait(gait)
        self.name = "gaits" if gait == "trot" else gait
        searched = searched_parameters(robot) if parameters is None else parameters
        self.parameters = {STAND: stand_parameters(robot), **searched}
        self.frequency = self.parameters[gait].frequency
        self.leg_offsets = _leg_offsets(robot, gait)
        self._initial_gait = gait
        stand = parameter_row(self.parameters[STAND])
        self._foot_y = robot.side * stand[INDEX["stance_width"]] / 2.0 - robot.hip_positions[:, 1]
        self._transition = GaitTransition(stand, _leg_offsets(robot, "walk"), control_period)
        initialize_state(self, _y=self._foot_y, _liftoff_y=self._foot_y, _joints=robot.home_pose)
        self._allocate(1)

    @property
    def gait(self) -> NDArray[np.str_]:
        """Name of the last requested gait of each robot, (n,)."""
        return np.array(GAITS)[self._gait]

    @property
    def settled(self) -> Mask:
        """True for robots that are not in a transition, (n,); robots that stand must also be at rest."""
        still = ~self.swing.any(axis=1) & (self._command == 0.0).all(axis=1)
        settled: Mask = self._transition.settled & (~self._standing | still)
        return settled

    @property
    def offsets(self) -> Floats:
        """Current phase of each leg minus the phase of the clock, (n, 4), rad."""
        return self._transition.offsets

    def request(self, gait: str, mask: ArrayLike | None = None) -> None:
        """Change the gait of some robots.

        Args:
            gait: Name of the gait; an unknown name raises ValueError.
            mask: Robots that change their gait, (n,) bool; all by default.
        """
        _check_gait(gait)
        self._start_transition(gait, validate_mask(mask, self.num_envs))

    def _allocate(self, num_envs: int) -> None:
        super()._allocate(num_envs)
        self._start_first_gait(np.ones(num_envs, np.bool_))

    def _reset_rows(self, mask: Mask) -> None:
        super()._reset_rows(mask)
        self._start_first_gait(mask)

    def _start_first_gait(self, mask: Mask) -> None:
        """Start the gait after a reset, for the robots in the mask."""
        self.clock_rate, self.duty = gait_timing(self.robot, self._transition.values, self._command)
        self._start_transition(self._initial_gait, mask)

    def _start_transition(self, gait: str, mask: Mask) -> None:
        """Start the transition of the robots in the mask to a gait."""
        offsets = np.array(_leg_offsets(self.robot, gait))
        # A robot that stands still takes the new offsets at once, because no foot is in the air. Its step height starts
        # at zero.
        unlifted = np.where(np.array(NAMES) == "step_height", 0.0, self._transition.values)
        self._transition.place(mask & self._standing & self.settled, unlifted, offsets)
        self._transition.start(mask, parameter_row(self.parameters[gait]), offsets)
        self._gait = np.where(mask, GAITS.index(gait), self._gait)

    @property
    def _standing(self) -> Mask:
        """True for robots with the requested gait `stand`, (n,)."""
        standing: Mask = self._gait == GAITS.index(STAND)
        return standing

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self._transition.advance()
        values = self._transition.values
        self._follow(observation[:, OBSERVATION["command"]].astype(np.float64), values)
        p = ParameterView(values)
        state = self._advance_gait(values)
        self._move_feet(state, p, map_command(p, *(self._command[:, i, None] for i in range(3))))
        joints = self._joint_path(state, p)
        lead = p.servo_lead / self.control_period * (joints - self._joints)
        self._joints = joints
        return to_actions(self.robot, joints + lead)

    def _follow(self, command: Floats, values: Floats) -> None:
        """Move the internal command towards the given command, within the velocity and acceleration limits."""
        # During a change of gait the current and the new limits must both hold.
        limited = limit_command(np.minimum(values, self._transition.goal), command)
        goal = np.where(self._standing[:, None], 0.0, limited)
        reach = self.control_period * _ACCELERATION
        self._command = self._command + np.clip(goal - self._command, -reach, reach)

    def _joint_path(self, state: GaitState, p: ParameterView) -> Floats:
        """Return the joint targets for the current foot positions, (n, 12), rad; servo sag is compensated."""
        robot = self.robot
        _, lift = cycloid(state.cycle.progress)
        z = np.where(self.swing, p.step_height * lift, 0.0) - p.body_height
        z = z - hip_bounce(state.cycle, state.swing_time, state.stance_time, p.bounce)
        y = self._y + p.sway * state.sway
        hip, thigh, calf = leg_angles(robot, self._x, y, z)
        load = load_fraction(LegCycle(self.swing, state.cycle.progress))
        force = load * p.stance_load * (robot.mass * GRAVITY / len(robot.leg_names) / self.duty[:, None])
        return flat_joints(np.stack(compensate_servo_load(robot, hip, thigh, calf, self._x, y, force), axis=-1))

    def _advance_gait(self, values: Floats) -> GaitState:
        """Advance the clocks by a control step, and start and end swings."""
        self.clock_rate, self.duty = gait_timing(self.robot, values, self._command)
        self._phase = (self._phase + TURN * self.control_period * self.clock_rate) % TURN
        phases = (self._phase[:, None] + self.offsets) % TURN
        rate = self.clock_rate[:, None]
        duty = self.duty[:, None]
        cycle = leg_cycles(phases, duty)
        window = cycle.swing
        # A robot that stands keeps a foot on the ground if the foot is in place. Its other feet lift off when their
        # swing starts.
        staying = (self._standing & self._transition.settled & (self._command == 0.0).all(axis=1))[:, None]
        starting = window & ~self._window & ~(staying & self._in_place(values))
        swing = window & (self.swing | starting)
        self._liftoff_x = np.where(starting, self._x, self._liftoff_x)
        self._liftoff_y = np.where(starting, self._y, self._liftoff_y)
        self._window = window
        self.swing = swing
        to_side = self.robot.side * np.cos(TURN * (phases / TURN - 0.5 * (1.0 - duty)))
        sway = 0.5 * (to_side[:, 0] + to_side[:, 1] + to_side[:, 2] + to_side[:, 3])
        return GaitState(cycle, (1.0 - duty) / rate, duty / rate, sway[:, None])

    def _in_place(self, values: Floats) -> Mask:
        """Return True for feet within PLACEMENT_TOLERANCE of the middle of their strides, (n, 4)."""
        p = ParameterView(values)
        x, y = _stride_middle(self.robot, p)
        return (np.abs(self._x - x) < PLACEMENT_TOLERANCE) & (np.abs(self._y - y) < PLACEMENT_TOLERANCE)

    def _move_feet(self, state: GaitState, p: ParameterView, velocity: tuple[Floats, Floats, Floats]) -> None:
        """Move the feet by a control step: stance feet at -(v + ω × r), swing feet towards the next foothold."""
        forward, lateral, yaw_rate = velocity
        hip_x = self.robot.hip_positions[:, 0]
        hip_y = self.robot.hip_positions[:, 1]
        middle_x, middle_y = _stride_middle(self.robot, p)
        air_x = _swing_position(state, self._liftoff_x, middle_x, forward - yaw_rate * (hip_y + middle_y))
        air_y = _swing_position(state, self._liftoff_y, middle_y, lateral + yaw_rate * (hip_x + middle_x))
        ground_x = self._x - self.control_period * (forward - yaw_rate * (hip_y + self._y))
        ground_y = self._y - self.control_period * (lateral + yaw_rate * (hip_x + self._x))
        self._x = np.where(self.swing, air_x, ground_x).clip(middle_x - MAX_REACH, middle_x + MAX_REACH)
        self._y = np.where(self.swing, air_y, ground_y).clip(middle_y - MAX_REACH, middle_y + MAX_REACH)


def _swing_position(state: GaitState, liftoff: Floats, middle: Floats, velocity: Floats) -> Floats:
    """Return one coordinate of the swing feet on their way to the next foothold, hip frames, (n, 4), m.

    Args:
        state: Leg cycles, swing and stance times.
        liftoff: Coordinate at which the foot left the ground, m.
        middle: Coordinate of the middle of the strides, m.
        velocity: Velocity of the body at the middle of the strides, along the same axis, m/s.

    Returns:
        Coordinate, (n, 4), m.
    """
    half_stance = 0.5 * state.stance_time
    landing = middle + np.clip(half_stance * velocity, -MAX_REACH, MAX_REACH)
    share, _ = cycloid(state.cycle.progress)
    # The foot covers the fraction `share` of its way relative to the ground, while the ground moves at constant speed.
    passed = state.swing_time * (share - state.cycle.progress)
    return liftoff + (landing - liftoff) * share + passed * velocity


def _stride_middle(robot: Robot, p: ParameterView) -> tuple[Floats, Floats]:
    """Return the middle of the strides in the hip frames, x (n, 1) and y (n, 4), m."""
    return p.stance_shift, robot.side * (p.stance_width / 2.0) - robot.hip_positions[:, 1]


def _leg_offsets(robot: Robot, gait: str) -> tuple[float, ...]:
    """Return the phase offsets of a gait in the order of the robot's legs, rad."""
    return robot.in_leg_order(OFFSETS.get(gait, OFFSETS["walk"]))


def _check_gait(gait: str) -> None:
    """Raise ValueError for an unknown gait."""
    if gait not in GAITS:
        raise ValueError(f"unknown gait {gait!r}; there are {', '.join(GAITS)}")
