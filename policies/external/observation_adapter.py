"""Conversion of the environment's observation to the observation of an external policy, term by term.

Three quantities are estimated because the environment's observation does not contain them. The yaw in the world frame
is the integral of the heading rate that follows from the gyro, from 0 at the reset. Foot contact is estimated from the
joint torques. The torques of the servos are computed from the servo gains and the previous joint targets.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask, PolicyError
from policies.external.foot_contact import FootContactEstimator
from policies.external.joint_mapping import map_action_joints, map_observed_joints
from policies.external.spec import HeightGrid, PolicySpec, SpecTerm
from policies.gait_cycle import FREQUENCY_FILTER_GAIN, TURN, frequency_increase
from policies.history import History, Inputs
from policies.legs.level_frame import level_frame
from policies.memory import PerRobotState, per_robot
from policies.velocity_error_integral import VelocityErrorIntegral
from quad_env.columns import EnvIndices
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG
from quad_env.sensing.height_scan import HeightScan, table_with

GRID_RESOLUTION = 1e-3
"""Resolution of height scans: the coordinates of the scan points must be multiples of this length, m."""
DEFAULT_SPACING = 100
"""Distance between the points of the environment's height scan, in units of GRID_RESOLUTION.

The value is used if the policy observes only the point below the trunk's centre, because no distance follows from a
single point.
"""


@dataclass(frozen=True)
class RobotSignals:
    """Quantities of m robots in one control step, from which a policy's observation terms are computed."""

    readings: dict[str, Floats]
    """Name of a term of the environment's observation -> values of the term, (m, width)."""
    joint_angles: Floats
    """Joint angles in the order and signs of the robot, not of the policy, (m, 12), rad."""
    yaw: Floats
    """Estimated yaw of the trunk in the world frame, 0 at the reset, (m,), rad."""
    steps: NDArray[np.int64]
    """Number of the policy's control steps since the reset, 0 in the first step, (m,)."""
    previous_action: Floats
    """Previous action in the form that the policy observes, in the policy's joint order, (m, 12)."""
    foot_contact: NDArray[Any]
    """Estimated foot contact: True for feet on the ground, legs in the robot's order, (m, 4)."""
    clock_offset: Floats
    """Phase of the gait clock minus the phase of a clock with constant frequency, (m,), rad."""
    position_error: Floats | None
    """Integral of the velocity error since the last change of the command, (m, 3), m and rad; None if not observed."""


class ObservationAdapter(PerRobotState):
    """Converter of the environment's observations of n robots to the observations of an external policy.

    A `NetworkPolicy` has one adapter. The adapter keeps the history of the observations, the yaw and the foot contact
    of each robot.

    Args:
        spec: Specification of the policy, which defines its observation terms.
        robot: Observed robot, with the servo gains that the policy uses.
        control_period: Control period of the environment, s.
    """

    action: Floats = per_robot()
    """Previous action in the form that the policy observes, in the policy's joint order, (n, 12).

    `NetworkPolicy` sets it after each call of the network.
    """
    _yaw: Floats = per_robot(0.0)
    """Estimated yaw of each robot's trunk in the world frame, 0 at the reset, (n,), rad."""
    _has_started: Mask = per_robot(False)
    """True for robots that have had an observation since their reset, (n,)."""
    _steps: NDArray[np.int64] = per_robot(0)
    """Number of the policy's control steps since each robot's reset, (n,)."""
    _history: Floats = per_robot()
    """Values of all observation terms in the policy's last h control steps, oldest first, (n, h, values per step).

    h is the number of control steps of the term with the longest history."""
    _clock_offset: Floats = per_robot(0.0)
    """Phase of each robot's gait clock minus the phase of a clock with constant frequency, (n,), rad."""
    _clock_increase: Floats = per_robot(0.0)
    """Present increase of the frequency of each robot's gait clock, (n,), Hz."""
    _foot_contact: Mask = per_robot(np.zeros(4, np.bool_))
    """Estimated foot contact: True for feet on the ground, legs in the robot's order, (n, 4)."""

    def __init__(self, spec: PolicySpec, robot: Robot, control_period: float) -> None:
        self._spec = spec
        self._robot = robot
        self._period = control_period
        self._action_joints = map_action_joints(spec, robot)
        self._observed_joints = map_observed_joints(spec, robot)
        default = self._action_joints.to_robot_order(np.array(spec.default_position, dtype=np.float64))
        self._default_position = default[self._observed_joints.joint_ids]
        self.height_scan = required_height_scan(spec)
        self._slices = table_with(robot, self.height_scan).slices
        self._history_indices = _history_indices(spec)
        has_contact = any(term.name == "foot_contact" for term in spec.terms)
        self._has_state = has_contact or any(term.frame == "world" for term in spec.terms)
        self._contact_estimator = FootContactEstimator(robot, control_period) if has_contact else None
        self._clock = next((term for term in spec.terms if term.clock_gain), None)
        """The term of the gait clock if its frequency depends on the velocity error."""
        self._pasts = {
            index: History(Inputs(term.lags, term.averages), term.width, control_period)
            for index, term in enumerate(spec.terms)
            if term.lags or term.averages
        }
        """Index of an observation term with past values or averages -> its history."""
        self._past_values = dict[int, NDArray[np.float32]]()
        """Index of a term in `_pasts` -> past values and averages of all robots in this control step, (n, width)."""
        bound = max(term.bound for term in spec.terms)
        self._position_error = VelocityErrorIntegral(bound, control_period) if bound else None
        super().__init__(action=np.zeros(len(spec.joints)), _history=np.zeros(_history_shape(spec)))

    def update_state(self, observation: Floats) -> None:
        """Update all quantities that depend on past observations, from the environment's observation, (n, k).

        The method must be called once in each control step of the environment.
        """
        self._update_velocity_errors(observation)
        self._update_pasts(observation)
        if not self._has_state:
            return
        gravity = observation[:, self._slices["projected_gravity"]].T
        _, pitch_rate, yaw_rate = observation[:, self._slices["angular_velocity"]].T
        frame = level_frame(gravity)
        # The heading is the direction of the base frame's x axis, projected onto the horizontal plane. If the trunk is
        # tilted, the heading rate therefore differs from the yaw rate of the gyro.
        heading_rate = (frame.up_y * pitch_rate + frame.up_z * yaw_rate) / frame.level_x**2
        self._yaw += np.where(self._has_started, self._period * heading_rate, 0.0)
        self._has_started[:] = True
        if self._contact_estimator is not None:
            self._foot_contact = self._contact_estimator.estimate(observation)

    def _update_velocity_errors(self, observation: Floats) -> None:
        """Update the position errors and the frequencies of the gait clocks of all robots."""
        if self._clock is None and self._position_error is None:
            return
        command = observation[:, self._slices["command"]]
        horizontal = observation[:, self._slices["linear_velocity"]][:, :2]
        yaw_rate = observation[:, self._slices["angular_velocity"]][:, 2:]
        velocity = np.hstack((horizontal, yaw_rate))
        if self._position_error is not None:
            self._position_error.update(command, np.nan_to_num(velocity))
        if self._clock is not None:
            error = np.linalg.norm(horizontal - command[:, :2], axis=1)
            target = frequency_increase(error, self._clock.clock_gain, self._clock.clock_limit)
            target = np.where(np.isfinite(error), target, self._clock_increase)
            self._clock_increase = self._clock_increase + FREQUENCY_FILTER_GAIN * (target - self._clock_increase)
            self._clock_offset = self._clock_offset + TURN * self._period * self._clock_increase

    def _update_pasts(self, observation: Floats) -> None:
        """Update the past values and averages of the observation terms that have them, for all robots."""
        if not self._pasts:
            return
        signals = self._collect_signals(observation, np.arange(len(observation)))
        for index, past in self._pasts.items():
            term = self._spec.terms[index]
            values = _clip_and_scale(self._compute_term(term, signals), term)
            self._past_values[index] = past.update(values.astype(np.float32))

    def observe(self, observation: Floats, env_ids: EnvIndices) -> NDArray[np.float32]:
        """Return the policy's observations of m robots, and append them to the histories of these robots.

        Args:
            observation: The environment's observations of the robots in `env_ids`, (m, k).
            env_ids: Indices of the robots in the batch, (m,).

        Returns:
            Observations with the terms and histories of the policy's specification, (m, width).
        """
        signals = self._collect_signals(observation, env_ids)
        values: list[NDArray[Any]] = []
        for index, term in enumerate(self._spec.terms):
            values.append(_clip_and_scale(self._compute_term(term, signals), term))
            if index in self._past_values:
                values.append(self._past_values[index][env_ids])
        current = np.concatenate(values, axis=1)
        limit = self._spec.observation_clip
        if limit is not None:
            current = np.clip(current, -limit, limit)
        previous = self._history[env_ids, 1:]
        if self._spec.history_start == "first":
            previous = np.where((signals.steps == 0)[:, None, None], current[:, None], previous)
        history = np.concatenate((previous, current[:, None]), axis=1)
        self._history[env_ids] = history
        self._steps[env_ids] += 1
        return history.reshape(len(env_ids), -1)[:, self._history_indices].astype(np.float32)

    def _collect_signals(self, observation: Floats, env_ids: EnvIndices) -> RobotSignals:
        readings = {name: observation[:, part] for name, part in self._slices.items()}
        return RobotSignals(
            readings=readings,
            joint_angles=readings["joint_position"] + self._robot.home_pose,
            yaw=self._yaw[env_ids],
            steps=self._steps[env_ids],
            previous_action=self.action[env_ids],
            foot_contact=self._foot_contact[env_ids],
            clock_offset=self._clock_offset[env_ids],
            position_error=None if self._position_error is None else self._position_error.position_error[env_ids],
        )

    def _compute_term(self, term: SpecTerm, signals: RobotSignals) -> Floats:
        """Return the values of an observation term in this control step, before clip and scale, (m, width)."""
        readings = signals.readings
        match term.name:
            case "joint_position":
                return self._observed_joints.policy_angles(signals.joint_angles) - self._default_position
            case "absolute_joint_position":
                return self._observed_joints.policy_angles(signals.joint_angles)
            case "joint_velocity":
                return self._observed_joints.policy_rates(readings["joint_velocity"])
            case "joint_torque":
                return self._observed_joints.policy_rates(_servo_torque(self._robot, readings))
            case "previous_action":
                return signals.previous_action
            case "command":
                return readings["command"]
            case "foot_contact":
                legs = list(dict.fromkeys(self._action_joints.joint_ids // JOINTS_PER_LEG))
                return signals.foot_contact[:, legs]
            case "gait_clock":
                return self._compute_clock(term, signals)
            case "constant":
                return np.tile(term.values, (len(signals.steps), 1))
            case "position_error":
                assert signals.position_error is not None
                return signals.position_error
            case "height_scan":
                return self._compute_height_scan(term, readings["height_scan"])
        return _rotate_to_frame(readings[term.name], term.frame, signals)

    def _compute_clock(self, term: SpecTerm, signals: RobotSignals) -> Floats:
        """Return sine and cosine of the phase of a gait clock, (m, 2).

        Both are zero if the norm of the velocity command is below `term.zero_below`.
        """
        angle = 2.0 * np.pi * term.clock / self._spec.control_rate * signals.steps + signals.clock_offset
        clock = np.stack((np.sin(angle), np.cos(angle)), axis=1)
        is_moving = np.linalg.norm(signals.readings["command"], axis=1, keepdims=True) >= term.zero_below
        return np.where(is_moving, clock, 0.0)

    def _compute_height_scan(self, term: SpecTerm, scan: Floats) -> Floats:
        """Return the heights of the trunk above the ground at the p points of the term's grid, (m, p), m.

        `scan`, (m, points), is the environment's height scan: ground height minus trunk height. The height at a point
        of the grid is the negative value at the nearest scan point, minus the offset of the grid.
        """
        assert self.height_scan is not None and term.grid is not None  # noqa: PT018
        differences = self.height_scan.points[None] - _grid_points(term.grid)[:, None]
        nearest = np.abs(differences).max(axis=-1).argmin(axis=1)
        return -scan[:, nearest] - term.grid.offset


def _rotate_to_frame(vectors: Floats, frame: str, signals: RobotSignals) -> Floats:
    """Rotate vectors, (m, 3), from the base frame to `frame`.

    `frame` is `body` (the base frame itself), `heading` (yaw only) or `world`.
    """
    if frame == "body":
        return vectors
    x, y, z = level_frame(signals.readings["projected_gravity"].T).to_level(vectors.T)
    if frame == "world":
        cosine = np.cos(signals.yaw)
        sine = np.sin(signals.yaw)
        x, y = cosine * x - sine * y, sine * x + cosine * y
    return np.stack((x, y, z), axis=1)


def _servo_torque(robot: Robot, readings: dict[str, Floats]) -> Floats:
    """Return the torques of the servos, clipped to the rated torque, (m, 12), N·m.

    The torques follow from the servo gains, the previous joint targets, and the joint angles and velocities in
    `readings` (name of a term of the environment's observation -> values).
    """
    position_error = readings["previous_action"] - readings["joint_position"]
    torque = robot.servo_stiffness * position_error - robot.servo_damping * readings["joint_velocity"]
    return np.clip(torque, -robot.rated_torque, robot.rated_torque)


def _clip_and_scale(values: Floats, term: SpecTerm) -> Floats:
    """Clip and then scale the values of an observation term, (m, width), as the term's settings define."""
    clipped: Floats = values if term.clip is None else np.clip(values, *term.clip)
    return np.multiply(clipped, term.scale)


def _history_shape(spec: PolicySpec) -> tuple[int, int]:
    """Return the number of control steps of the longest history, and the number of values in one step."""
    return max(term.history for term in spec.terms), sum(term.step_width for term in spec.terms)


def _history_indices(spec: PolicySpec) -> NDArray[np.intp]:
    """Return, for each number of the policy's observation, its index in the flattened history, (width,).

    The history has one row per control step, from the oldest to the newest. Each row has the values of all terms.
    """
    shape = _history_shape(spec)
    is_newest_first = spec.history_newest == "first"
    steps = np.arange(np.prod(shape)).reshape(shape)[:: -1 if is_newest_first else 1]
    if spec.history_layout == "time":
        return steps.ravel()
    indices = []
    end = 0
    for term in spec.terms:
        end += term.step_width
        observed_steps = slice(term.history) if is_newest_first else slice(-term.history, None)
        indices.append(steps[observed_steps, end - term.step_width : end].ravel())
    return np.concatenate(indices)


def _grid_points(grid: HeightGrid) -> Floats:
    """Return the coordinates (x, y) of a grid's p points, heading frame (yaw only), in observed order, (p, 2), m."""
    x, y = np.meshgrid(grid.x, grid.y, indexing="xy" if grid.x_first else "ij")
    return np.stack((x.ravel(), y.ravel()), axis=1)


def required_height_scan(spec: PolicySpec) -> HeightScan | None:
    """Return the smallest height scan of the environment that includes all points that a policy observes.

    Args:
        spec: Specification of the policy.

    Returns:
        Settings of the environment's height scan; None if the policy observes no heights.

    Raises:
        PolicyError: The points are not on a grid through the trunk's centre, or the grid has too many points.
    """
    grids = [_grid_points(term.grid) for term in spec.terms if term.grid is not None]
    if not grids:
        return None
    points = np.concatenate(grids)
    units = np.round(points / GRID_RESOLUTION).astype(int)
    spacing = int(np.gcd.reduce(np.abs(units), axis=None)) or DEFAULT_SPACING
    ahead, left = np.maximum(units.max(axis=0), 0)
    behind, right = np.maximum(-units.min(axis=0), 0)
    if np.abs(points / GRID_RESOLUTION - units).max() > 1e-3:
        reason = f"its points do not lie on a grid of {GRID_RESOLUTION:g} m through the trunk's centre"
        raise PolicyError(f"{spec.network}: height_scan is not available: {reason}")
    try:
        return HeightScan(
            ahead=int(ahead) // spacing,
            behind=int(behind) // spacing,
            aside=int(max(left, right)) // spacing,
            spacing=GRID_RESOLUTION * spacing,
        )
    except ValueError as error:
        raise PolicyError(f"{spec.network}: height_scan is not available: {error}") from None
