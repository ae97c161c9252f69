"""Policy that follows a velocity command in a gait; each robot can change its gait smoothly.

A transition to another gait interpolates phase offsets, duty factor, frequency and all other parameters. Relative to
the trunk, a stance foot always moves opposite to the velocity of the trunk at the position of this foot. A swing phase
always starts at the position where the foot left the ground. Therefore joint targets do not jump and stance feet do not
slide, in a gait and in a transition.
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
"""Largest rate of change of the forward and the lateral velocity with which a gait follows a command, m/s²."""
YAW_ACCELERATION = 8.0
"""Largest rate of change of the yaw rate with which a gait follows a command, rad/s²."""
MAX_REACH = 0.2
"""Largest distance of a foot from the middle of its stride, separately along x and y, m."""
PLACEMENT_TOLERANCE = 0.005
"""Largest deviation of a foot of a standing robot from the middle of its stride, along x and along y, m.

A foot with a larger deviation takes another step."""
_ACCELERATION = np.array([LINEAR_ACCELERATION, LINEAR_ACCELERATION, YAW_ACCELERATION])
"""Largest rates of change of the velocity (forward, lateral, yaw rate) that a gait follows, (3,), m/s² and rad/s²."""


class ParameterView:
    """View of the gait parameters of n robots as attributes, for example `view.duty`, (n, 1).

    Args:
        values: Gait parameters, with the columns of `INDEX`, (n, len(NAMES)).
    """

    def __init__(self, values: Floats) -> None:
        self._values = values

    def __getattr__(self, name: str) -> Floats:
        return self._values[:, INDEX[name], None]


class GaitState(NamedTuple):
    """Gait of n robots in one control step: phase of each leg, and durations of swing and stance phases."""

    cycle: LegCycle
    """Swing or stance phase of each leg according to the gait clock, with its elapsed fraction, (n, 4)."""
    swing_time: Floats
    """Duration of a swing phase, (n, 1), s."""
    stance_time: Floats
    """Duration of a stance phase, (n, 1), s."""
    sway: Floats
    """Number of left swing feet minus number of right swing feet, smoothed over the cycle, -2 to 2, (n, 1).

    Each foot contributes a sinusoid over the gait cycle. The trunk sways to the right by `sway` times the parameter
    `GaitParameters.sway`."""


class Gaits(GaitedPolicy):
    """Policy that follows a velocity command in a gait, such as walk or trot; `request` changes the gait.

    After a reset, a robot starts from the home pose and changes smoothly to its first gait.

    Args:
        gait: Gait after a reset, one of `policies.gaits.parameters.GAITS`. The name of the policy is the name of this
            gait, or `gaits` if the gait is the trot.
        parameters: Name of every stepping gait -> its parameters; None for the result of `searched_parameters`.
        robot: Robot that walks, or its name.
        control_period: Time between two control steps, s.
    """

    swing: Mask = per_robot(np.zeros(4, np.bool_))
    """True for feet that the policy has lifted for a swing phase, (n, 4)."""
    duty: Floats
    """Current duty factor of each robot, the fraction of the gait cycle that a foot is on the ground, (n,)."""
    clock_rate: Floats
    """Current gait frequency of each robot, (n,), Hz."""
    _gait: NDArray[np.int64] = per_robot(GAITS.index(STAND))
    """Index in `GAITS` of the last requested gait of each robot, (n,)."""
    _command: Floats = per_robot(np.zeros(3))
    """Velocity command (forward, lateral, yaw rate) after the limits of acceleration, (n, 3), m/s and rad/s."""
    _window: Mask = per_robot(np.zeros(4, np.bool_))
    """True for feet that are in a swing phase according to the gait clock, even if they stay on the ground, (n, 4)."""
    _x: Floats = per_robot(np.zeros(4))
    """Forward coordinate of each foot relative to its hip joint, (n, 4), m."""
    _y: Floats = per_robot()
    """Lateral coordinate of each foot relative to its hip joint, before the sway is added, (n, 4), m."""
    _liftoff_x: Floats = per_robot(np.zeros(4))
    """Forward coordinate of each foot at its last lift-off, relative to its hip joint, (n, 4), m."""
    _liftoff_y: Floats = per_robot()
    """Lateral coordinate of each foot at its last lift-off, relative to its hip joint, (n, 4), m."""
    _joints: Floats = per_robot()
    """Joint targets of the last control step, before `servo_lead` corrects them for the servo lag, (n, 12), rad."""

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
        """True for robots that are not in a transition between gaits, (n,).

        A robot with the gait `stand` must also have all feet on the ground and no remaining velocity.
        """
        still = ~self.swing.any(axis=1) & (self._command == 0.0).all(axis=1)
        settled: Mask = self._transition.settled & (~self._standing | still)
        return settled

    @property
    def offsets(self) -> Floats:
        """Current phase offset of each leg from the gait clock, (n, 4), rad."""
        return self._transition.offsets

    def request(self, gait: str, mask: ArrayLike | None = None) -> None:
        """Start a smooth transition of some robots to a gait.

        Args:
            gait: Name of the new gait. An unknown name raises ValueError.
            mask: True for robots that change their gait, (n,) bool; all robots by default.
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
        """Start the transition from standing to the initial gait, for robots for which `mask`, (n,), is True."""
        self.clock_rate, self.duty = gait_timing(self.robot, self._transition.values, self._command)
        self._start_transition(self._initial_gait, mask)

    def _start_transition(self, gait: str, mask: Mask) -> None:
        """Start the transition of the robots for which `mask`, (n,), is True to the gait called `gait`."""
        offsets = np.array(_leg_offsets(self.robot, gait))
        # A robot that stands still gets the new phase offsets immediately, because all its feet are on the ground. The
        # step height rises from zero in the transition, because the feet would otherwise jump up.
        unlifted = np.where(np.array(NAMES) == "step_height", 0.0, self._transition.values)
        self._transition.place(mask & self._standing & self.settled, unlifted, offsets)
        self._transition.start(mask, parameter_row(self.parameters[gait]), offsets)
        self._gait = np.where(mask, GAITS.index(gait), self._gait)

    @property
    def _standing(self) -> Mask:
        """True for robots with `stand` as the last requested gait, (n,)."""
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
        """Move the velocity command of the gait towards the observed one, within the gait's limits.

        `command`, (n, 3), m/s and rad/s, is the observed command (forward, lateral, yaw rate). `values` are the gait
        parameters of n robots, (n, len(NAMES)).
        """
        # The minimum is used, because the command must respect the limits of both gaits in a transition.
        limited = limit_command(np.minimum(values, self._transition.goal), command)
        goal = np.where(self._standing[:, None], 0.0, limited)
        reach = self.control_period * _ACCELERATION
        self._command = self._command + np.clip(goal - self._command, -reach, reach)

    def _joint_path(self, state: GaitState, p: ParameterView) -> Floats:
        """Return the joint targets for the current foot positions, (n, 12), rad.

        The targets compensate the sag of the servos under the weight of the robot. They do not yet compensate the lag
        of the servos, see `GaitParameters.servo_lead`.
        """
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
        """Advance the gait clocks by a control step, start and end swing phases, and return the gait state.

        `values`, (n, len(NAMES)), are the current gait parameters.
        """
        self.clock_rate, self.duty = gait_timing(self.robot, values, self._command)
        self._phase = (self._phase + TURN * self.control_period * self.clock_rate) % TURN
        phases = (self._phase[:, None] + self.offsets) % TURN
        rate = self.clock_rate[:, None]
        duty = self.duty[:, None]
        cycle = leg_cycles(phases, duty)
        window = cycle.swing
        # A foot of a standing robot stays on the ground if it is near the middle of its stride, see `_in_place`. The
        # other feet of the robot lift off at the start of their swing phase.
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
        """Return True for feet within `PLACEMENT_TOLERANCE` of the middle of their stride, (n, 4)."""
        p = ParameterView(values)
        x, y = _stride_middle(self.robot, p)
        return (np.abs(self._x - x) < PLACEMENT_TOLERANCE) & (np.abs(self._y - y) < PLACEMENT_TOLERANCE)

    def _move_feet(self, state: GaitState, p: ParameterView, velocity: tuple[Floats, Floats, Floats]) -> None:
        """Move the feet by a control step relative to the trunk.

        Stance feet move at -(v + ω × r), with the velocity v and the angular velocity ω of the trunk, and the position
        r of the foot. Swing feet move towards the next foothold. `state` is the state of the gait, and `p` are the gait
        parameters. `velocity` is a tuple of the forward velocity, m/s, the lateral velocity, m/s, and the yaw rate,
        rad/s, each (n, 1).
        """
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
    """Compute one coordinate, x or y, of the swing feet between lift-off and the next foothold.

    Args:
        state: State of the gait: phases of the legs, and durations of swing and stance.
        liftoff: Coordinate at which each foot left the ground, relative to its hip joint, (n, 4), m.
        middle: Coordinate of the middle of the stride, relative to the hip joint, broadcasts to (n, 4), m.
        velocity: Velocity of the trunk at the middle of the stride, along the same axis as the coordinate, (n, 4), m/s.

    Returns:
        Coordinate of each foot, relative to its hip joint, (n, 4), m.
    """
    half_stance = 0.5 * state.stance_time
    landing = middle + np.clip(half_stance * velocity, -MAX_REACH, MAX_REACH)
    share, _ = cycloid(state.cycle.progress)
    # `share` is the covered fraction of the path relative to the ground. The term `passed * velocity` is added, because
    # the ground moves at constant speed relative to the trunk.
    passed = state.swing_time * (share - state.cycle.progress)
    return liftoff + (landing - liftoff) * share + passed * velocity


def _stride_middle(robot: Robot, p: ParameterView) -> tuple[Floats, Floats]:
    """Return the coordinates of the middle of each foot's stride, relative to its hip joint.

    The first item of the result is x (forward), (n, 1), m, and the second is y (to the left), (n, 4), m.
    """
    return p.stance_shift, robot.side * (p.stance_width / 2.0) - robot.hip_positions[:, 1]


def _leg_offsets(robot: Robot, gait: str) -> tuple[float, ...]:
    """Return the phase offset of each leg from the gait clock in a `gait`, in the robot's leg order, rad."""
    return robot.in_leg_order(OFFSETS.get(gait, OFFSETS["walk"]))


def _check_gait(gait: str) -> None:
    """Raise ValueError if there is no gait called `gait`."""
    if gait not in GAITS:
        raise ValueError(f"unknown gait {gait!r}; there are {', '.join(GAITS)}")
