"""Policy that runs an external network as described by its specification (`PolicySpec`).

In each control step, the environment's observation is converted, the network is called, and its output is converted to
joint targets.
"""

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
"""Difference below which two times count as equal, as a fraction of the policy's control period."""


class NetworkPolicy(Policy):
    """Policy that runs an external network as described by its specification.

    The network may have a lower control rate than the environment. The policy holds the joint targets until the next
    control step of the network. The constructor raises PolicyError, one line, if the network contradicts its
    specification. It also raises PolicyError if the robot lacks a joint of the specification, or if the environment
    cannot provide the control rate or the height scan of the specification.

    Args:
        spec: Specification of the network: joints, servo gains, control rate, observation terms.
        **made_for: Robot and control period. The attribute `robot` has the servo gains of the specification.
    """

    _ticks: NDArray[np.int64] = per_robot(0)
    """Number of the environment's control steps since each robot's reset, (n,)."""
    _targets: Floats = per_robot()
    """Joint targets of the policy's last control step, in the robot's joint order, (n, 12), rad."""

    def __init__(self, spec: PolicySpec, **made_for: Unpack[PolicyKwargs]) -> None:
        super().__init__(**made_for)
        self.name = spec.network.name
        self.robot = with_spec_gains(self.robot, spec)
        self._spec = spec
        self._period_ratio = control_period_ratio(spec, self.control_period)
        self._joints = map_action_joints(spec, self.robot)
        self._offset = np.array(spec.action_offset or spec.default_position)
        self._scale = np.array(spec.action_scale)
        self._adapter = ObservationAdapter(spec, self.robot, self.control_period)
        self.height_scan = self._adapter.height_scan
        self._network = networks.load_network(spec)
        initialize_state(self, _targets=self.robot.home_pose)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        rows = observation.astype(np.float64)
        self._adapter.update_state(rows)
        policy_step = np.floor(self._ticks * self._period_ratio + TIME_TOLERANCE)
        last_policy_step = np.floor((self._ticks - 1) * self._period_ratio + TIME_TOLERANCE)
        due = np.flatnonzero((policy_step > last_policy_step) | (self._ticks == 0))
        if len(due):
            policy_observation = self._adapter.observe(rows[due], due)
            actions = self._network.compute_actions(policy_observation, due).astype(np.float64)
            if self._spec.action_clip is not None:
                actions = np.clip(actions, *self._spec.action_clip)
            targets = self._offset + self._scale * actions
            if self._spec.target_clip is not None:
                targets = np.clip(targets, *np.transpose(self._spec.target_clip))
            is_raw = self._spec.previous_action == "raw"
            self._adapter.action[due] = actions if is_raw else targets - self._offset
            self._targets[due] = self._joints.robot_angles(targets)
        self._ticks += 1
        return to_actions(self.robot, self._targets)


def with_spec_gains(robot: Robot, spec: PolicySpec) -> Robot:
    """Return a copy of a robot with the servo gains (stiffness and damping) of a policy's specification.

    Args:
        robot: Original robot.
        spec: Specification of a policy for the robot.

    Returns:
        Robot with the servo gains of `spec`.

    Raises:
        PolicyError: The robot lacks a joint of the specification, or its servos cannot have these gains.
    """
    joints = map_joints(spec.joints, robot)
    stiffness = joints.to_robot_order(np.array(spec.stiffness, float))
    damping = joints.to_robot_order(np.array(spec.damping, float))
    try:
        return robot.with_servo(stiffness, damping)
    except ValueError as error:
        raise PolicyError(f"{spec.network}: servo gains are not possible: {error}") from None


def control_period_ratio(spec: PolicySpec, control_period: float) -> float:
    """Return the environment's control period divided by the policy's control period, at most 1.

    A control step of the policy may be due between two control steps of the environment. The policy then acts in the
    later control step of the environment.

    Args:
        spec: Specification of the policy, with its control rate.
        control_period: Control period of the environment, s.

    Returns:
        Ratio of the periods. It is rounded to 1 / n, n a whole number, if the relative difference is below
        TIME_TOLERANCE.

    Raises:
        PolicyError: The policy acts more often than the environment.
    """
    ratio = spec.control_rate * control_period
    if ratio > 1.0 + TIME_TOLERANCE:
        raise PolicyError(
            f"{spec.network} acts at {spec.control_rate:g} Hz, more often than the environment's "
            f"{1.0 / control_period:g} Hz"
        )
    return 1.0 / round(1.0 / ratio) if abs(1.0 / ratio - round(1.0 / ratio)) < TIME_TOLERANCE / ratio else ratio
