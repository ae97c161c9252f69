"""Conversion of the environment's observation to the observation of an external policy, term by term.

Three quantities are estimated because the environment does not observe them. The yaw in the world frame is the integral
of the gyro's rates, from 0 at the reset. Foot contact follows from the joint torques, and the torques of the servos
follow from the servo gains.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from policies.base import Floats, Mask, PolicyError
from policies.external.foot_contact import FootContactEstimator
from policies.external.joint_mapping import map_action_joints, map_observed_joints
from policies.external.spec import HeightGrid, PolicySpec, SpecTerm
from policies.legs.level_frame import level_frame
from policies.memory import PerRobotState, per_robot
from quad_env.columns import EnvIndices
from quad_env.robots.robot import Robot
from quad_env.robots.structure import JOINTS_PER_LEG
from quad_env.sensing.height_scan import HeightScan, table_with

GRID_RESOLUTION = 1e-3
"""Resolution of height scans: the coordinates of their points are multiples of this length, m."""
DEFAULT_SPACING = 100
"""Spacing of a height scan that has a single point, at the trunk, in units of GRID_RESOLUTION."""


@dataclass(frozen=True)
class RobotSignals:
    """Signals of m robots in one control step, from which the terms are computed."""

    readings: dict[str, Floats]
    """Name of a term of the environment's observation -> its values, (m, width)."""
    joint_angles: Floats
    """Angles of the robot's joints, (m, 12), rad."""
    yaw: Floats
    """Yaw in the world frame, (m,), rad."""
    steps: NDArray[np.int64]
    """Number of the policy's control steps since the reset, 0 in the first step, (m,)."""
    previous_action: Floats
    """Previous action as the policy observes it, (m, 12)."""
    foot_contact: NDArray[Any]
    """True for feet in contact, legs in the robot's order, (m, 4)."""


class ObservationAdapter(PerRobotState):
    """Converter of the observations of n robots to the form that a policy was trained on.

    A `NetworkPolicy` has one. It keeps the history of the observations, the yaw and the foot contact of each robot.

    Args:
        spec: Specification of the policy.
        robot: Observed robot, with the servo gains that the policy uses.
        control_period: Control period of the environment, s.
    """

    action: Floats = per_robot()
    """Previous action as the policy observes it, (n, 12); `NetworkPolicy` sets it after each action."""
    _yaw: Floats = per_robot(0.0)
    _has_started: Mask = per_robot(False)
    _steps: NDArray[np.int64] = per_robot(0)
    _history: Floats = per_robot()
    _foot_contact: Mask = per_robot(np.zeros(4, np.bool_))

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
        super().__init__(action=np.zeros(len(spec.joints)), _history=np.zeros(_history_shape(spec)))

    def update_state(self, observation: Floats) -> None:
        """Update yaw and foot contact after a control step, from the environment's `observation`, (n, k)."""
        if not self._has_state:
            return
        gravity = observation[:, self._slices["projected_gravity"]].T
        _, pitch_rate, yaw_rate = observation[:, self._slices["angular_velocity"]].T
        frame = level_frame(gravity)
        # The heading is the direction of the base frame's x axis seen from above, so its rate is not the gyro's.
        heading_rate = (frame.up_y * pitch_rate + frame.up_z * yaw_rate) / frame.level_x**2
        self._yaw += np.where(self._has_started, self._period * heading_rate, 0.0)
        self._has_started[:] = True
        if self._contact_estimator is not None:
            self._foot_contact = self._contact_estimator.estimate(observation)

    def observe(self, observation: Floats, env_ids: EnvIndices) -> NDArray[np.float32]:
        """Return the policy's observations of some robots, and append them to the history of these robots.

        Args:
            observation: Observations of the robots by the environment, (m, k).
            env_ids: Indices of the robots, (m,).

        Returns:
            Observations in the form of the policy, (m, width).
        """
        signals = self._collect_signals(observation, env_ids)
        terms = [_clip_and_scale(self._compute_term(term, signals), term) for term in self._spec.terms]
        current = np.concatenate(terms, axis=1)
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
        )

    def _compute_term(self, term: SpecTerm, signals: RobotSignals) -> Floats:
        """Return the values of a term in this control step, before they are clipped and scaled, (m, width)."""
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
            case "height_scan":
                return self._compute_height_scan(term, readings["height_scan"])
        return _rotate_to_frame(readings[term.name], term.frame, signals)

    def _compute_clock(self, term: SpecTerm, signals: RobotSignals) -> Floats:
        """Return sine and cosine of a clock, (m, 2).

        They are zero if the norm of the command is below the term's `zero_below`.
        """
        angle = 2.0 * np.pi * term.clock / self._spec.control_rate * signals.steps
        clock = np.stack((np.sin(angle), np.cos(angle)), axis=1)
        is_moving = np.linalg.norm(signals.readings["command"], axis=1, keepdims=True) >= term.zero_below
        return np.where(is_moving, clock, 0.0)

    def _compute_height_scan(self, term: SpecTerm, scan: Floats) -> Floats:
        """Return the observed heights at the p points of a term, (m, p), m, from the environment's `scan`."""
        assert self.height_scan is not None and term.grid is not None  # noqa: PT018
        differences = self.height_scan.points[None] - _grid_points(term.grid)[:, None]
        nearest = np.abs(differences).max(axis=-1).argmin(axis=1)
        return -scan[:, nearest] - term.grid.offset


def _rotate_to_frame(vectors: Floats, frame: str, signals: RobotSignals) -> Floats:
    """Rotate vectors from the base frame to the frame `body`, `heading` or `world`, (m, 3)."""
    if frame == "body":
        return vectors
    x, y, z = level_frame(signals.readings["projected_gravity"].T).to_level(vectors.T)
    if frame == "world":
        cosine = np.cos(signals.yaw)
        sine = np.sin(signals.yaw)
        x, y = cosine * x - sine * y, sine * x + cosine * y
    return np.stack((x, y, z), axis=1)


def _servo_torque(robot: Robot, readings: dict[str, Floats]) -> Floats:
    """Return the servo torques, clipped to the rated torque, (m, 12), N·m.

    They are computed from the previous targets and the servo gains.
    """
    position_error = readings["previous_action"] - readings["joint_position"]
    torque = robot.servo_stiffness * position_error - robot.servo_damping * readings["joint_velocity"]
    return np.clip(torque, -robot.rated_torque, robot.rated_torque)


def _clip_and_scale(values: Floats, term: SpecTerm) -> Floats:
    """Clip the values of a term, then scale them."""
    clipped: Floats = values if term.clip is None else np.clip(values, *term.clip)
    return np.multiply(clipped, term.scale)


def _history_shape(spec: PolicySpec) -> tuple[int, int]:
    """Return the number of control steps of the longest history, and the width of all terms in a step."""
    return max(term.history for term in spec.terms), sum(term.width for term in spec.terms)


def _history_indices(spec: PolicySpec) -> NDArray[np.intp]:
    """Return the index in the flattened history of each number of the policy's observation, (width,).

    The history consists of control steps from the oldest to the newest; each step has all terms.
    """
    shape = _history_shape(spec)
    is_newest_first = spec.history_newest == "first"
    steps = np.arange(np.prod(shape)).reshape(shape)[:: -1 if is_newest_first else 1]
    if spec.history_layout == "time":
        return steps.ravel()
    indices = []
    end = 0
    for term in spec.terms:
        end += term.width
        observed_steps = slice(term.history) if is_newest_first else slice(-term.history, None)
        indices.append(steps[observed_steps, end - term.width : end].ravel())
    return np.concatenate(indices)


def _grid_points(grid: HeightGrid) -> Floats:
    """Return the coordinates x, y of a grid's points, heading frame, in the observed order, (p, 2), m."""
    x, y = np.meshgrid(grid.x, grid.y, indexing="xy" if grid.x_first else "ij")
    return np.stack((x.ravel(), y.ravel()), axis=1)


def required_height_scan(spec: PolicySpec) -> HeightScan | None:
    """Return the smallest height scan of the environment that includes all points of a policy's scan.

    Args:
        spec: Specification of the policy.

    Returns:
        Settings of the height scan; None if the policy observes no heights.

    Raises:
        PolicyError: The environment cannot provide this height scan.
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
