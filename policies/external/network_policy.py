"""A policy from another project by its description: its network between its observation and its joint targets."""

from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, Policy, PolicyError, PolicyKwargs, to_actions
from policies.external import networks
from policies.external.joint_mapping import map_action_joints, map_joints
from policies.external.observation_adapter import ObservationAdapter
from policies.external.spec import PolicySpec
from policies.memory import initialize_state, per_robot
from quad_env.robots.robot import Robot

TIME_TOLERANCE = 1e-6
"""Largest difference of two instants that count as equal, as a share of a control period."""


class NetworkPolicy(Policy):
    """Policy of a description; each target is held until the next, from the start of its robot.

    Args:
        description: of it.
        robot: with any servo gains; the policy's `robot` has the description's.
        control_period: of the environment, s.

    Raises PolicyError, one line, for a network that is not as described, and for joints, rates and scans that the robot
    or the environment cannot have.
    """

    _ticks: NDArray[np.int64] = per_robot(0)
    _targets: Floats = per_robot()

    def __init__(self, description: PolicySpec, **made_for: Unpack[PolicyKwargs]) -> None:
        super().__init__(**made_for)
        self.name, self.robot = description.network.name, with_spec_gains(self.robot, description)
        self._description = description
        self._share = control_period_ratio(description, self.control_period)
        self._joints = map_action_joints(description, self.robot)
        offset = description.action_offset or description.default_position
        self._offset, self._scale = np.array(offset), np.array(description.action_scale)
        self._terms = ObservationAdapter(description, self.robot, self.control_period)
        self.height_scan = self._terms.height_scan
        self._networks = networks.load_network(description)
        initialize_state(self, _targets=self.robot.home_pose)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        rows = observation.astype(np.float64)
        self._terms.update_state(rows)
        periods = np.floor(self._ticks * self._share + TIME_TOLERANCE)
        before = np.floor((self._ticks - 1) * self._share + TIME_TOLERANCE)
        due = np.flatnonzero((periods > before) | (self._ticks == 0))
        if len(due):
            actions = self._networks.compute_actions(self._terms.observe(rows[due], due), due).astype(np.float64)
            if self._description.action_clip is not None:
                actions = np.clip(actions, *self._description.action_clip)
            targets = self._offset + self._scale * actions
            if self._description.target_clip is not None:
                targets = np.clip(targets, *np.transpose(self._description.target_clip))
            raw = self._description.previous_action == "raw"
            self._terms.action[due] = actions if raw else targets - self._offset
            self._targets[due] = self._joints.robot_angles(targets)
        self._ticks += 1
        return to_actions(self.robot, self._targets)


def with_spec_gains(robot: Robot, description: PolicySpec) -> Robot:
    """The robot with the servo gains of a description. Raises PolicyError for joints or gains that it cannot have."""
    joints = map_joints(description.joints, robot)
    gains = (joints.to_robot_order(np.array(each, float)) for each in (description.stiffness, description.damping))
    try:
        return robot.with_servo(*gains)
    except ValueError as error:
        raise PolicyError(f"the servos of {description.network} cannot be had: {error}") from None


def control_period_ratio(description: PolicySpec, control_period: float) -> float:
    """Return the environment's control period, s, as a share of the policy's.

    The policy acts in the first control step of the environment that is not before its own. Each target is held until
    the next. Raises PolicyError for a policy that acts more often than the environment.
    """
    share = description.control_rate * control_period
    if share > 1.0 + TIME_TOLERANCE:
        raise PolicyError(
            f"{description.network} acts at {description.control_rate:g} Hz, more often than the environment's "
            f"{1.0 / control_period:g} Hz"
        )
    return 1.0 / round(1.0 / share) if abs(1.0 / share - round(1.0 / share)) < TIME_TOLERANCE / share else share
