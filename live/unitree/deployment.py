"""Observations of a policy from the state that a robot publishes, and a check that they suffice for the policy."""

import numpy as np
from numpy.typing import NDArray

from live.unitree.messages import UnitreeMessage
from live.unitree.motors import MotorOrder
from policies.base import Actions, Floats, Policy, PolicyError
from quad_env.physics.state import rotation_matrix
from quad_env.robots.robot import JOINTS
from quad_env.task.observations import observation_table

CHECKED_STEPS = 100
"""Number of control steps for which a policy is run to find the observation terms that its actions depend on."""
MISSING_TERM = "linear_velocity"
"""Observation term that a robot does not publish in its low-level state."""
_SEED = 7


class RobotState:
    """State of a robot from a message `LowState_`, with the joints in the order of the robot's model.

    Args:
        message: The message.
        order: Order of the motors.

    Attributes:
        tick: Clock of the robot, ms.
        angular_velocity: Angular velocity, base frame, (3,), rad/s.
        projected_gravity: Unit vector of gravity, base frame, (3,).
        joint_position: Joint angles, (12,), rad.
        joint_velocity: Joint velocities, (12,), rad/s.

    Raises:
        ValueError: A number is not finite, or the quaternion is zero.
    """

    def __init__(self, message: UnitreeMessage, order: MotorOrder) -> None:
        self.tick = int(message.get("tick")[0])
        quaternion = message.get("imu_state.quaternion").astype(float)
        if not np.linalg.norm(quaternion) > 0.0:
            raise ValueError("rt/lowstate: the quaternion is zero")
        self.projected_gravity = -np.array(rotation_matrix(tuple(quaternion))[2])
        self.angular_velocity = message.get("imu_state.gyroscope").astype(float)
        self.joint_position = order.angles_of_joints(message.get("motor_state.q")[:JOINTS].astype(float))
        self.joint_velocity = order.rates_of_joints(message.get("motor_state.dq")[:JOINTS].astype(float))
        parts = (self.projected_gravity, self.angular_velocity, self.joint_position, self.joint_velocity)
        if not all(np.isfinite(part).all() for part in parts):
            raise ValueError("rt/lowstate: a number is NaN or infinite")

    @property
    def tilt(self) -> float:
        """Angle between the vertical of the trunk and the vertical of the world, rad."""
        return float(np.arccos(np.clip(-self.projected_gravity[2], -1.0, 1.0)))


class DeployedPolicy:
    """Policy with observations that consist of the published state of a robot, its command and its last action.

    A PolicyError is raised if the policy needs readings that the robot does not publish.

    Args:
        policy: Policy for one robot.
    """

    def __init__(self, policy: Policy) -> None:
        check_deployable(policy)
        self.policy = policy
        self.robot = policy.robot
        self._table = observation_table(policy.robot)
        self.reset()

    def reset(self) -> None:
        """Reset the policy, for a robot in its home pose."""
        self.policy.reset(num_envs=1, seed=0)
        self._action = self.robot.home_pose.astype(np.float32)

    def act(self, state: RobotState, command: Floats) -> Floats:
        """Compute the joint targets of a control step.

        Args:
            state: State of the robot.
            command: Velocity command, (3,): forward and left velocity, m/s, and yaw rate, rad/s.

        Returns:
            Joint targets within the joint limits, (12,), rad.
        """
        action: Actions = self.policy.act(self.observation(state, command))
        self._action = action
        return action.astype(float)

    def observation(self, state: RobotState, command: Floats) -> NDArray[np.float32]:
        """Return the observation of the policy; the linear velocity, on which no action depends, is zero.

        Args:
            state: State of the robot.
            command: Velocity command, (3,): forward and left velocity, m/s, and yaw rate, rad/s.

        Returns:
            Observation, (k,).
        """
        terms = {
            "projected_gravity": state.projected_gravity,
            "angular_velocity": state.angular_velocity,
            "joint_position": state.joint_position - self.robot.home_pose,
            "joint_velocity": state.joint_velocity,
            "previous_action": self._action - self.robot.home_pose,
            "command": command,
        }
        observation = np.zeros(self._table.size)
        for name, values in terms.items():
            observation[self._table.slices[name]] = values
        return np.clip(observation, -self._table.bound, self._table.bound).astype(np.float32)


def check_deployable(policy: Policy) -> None:
    """Check that the actions of a policy depend only on readings that a robot publishes.

    The policy acts on the same random observations with two different linear velocities.

    Args:
        policy: Policy for one robot; it is reset.

    Raises:
        PolicyError: The policy needs a height scan, further observation terms or the linear velocity.
    """
    if policy.height_scan is not None or policy.observations:
        missing = "a height scan" if policy.height_scan is not None else "further observation terms"
        raise PolicyError(f"--policy: {policy.name} needs {missing}, which rt/lowstate does not have", _REMEDY)
    table = observation_table(policy.robot)
    rng = np.random.default_rng(_SEED)
    scale = np.minimum(table.bound, 1.0) * 0.3
    observations = rng.uniform(-scale, scale, (CHECKED_STEPS, table.size)).astype(np.float32)
    observations[:, table.slices["projected_gravity"]] += (0.0, 0.0, -1.0)
    changed = observations.copy()
    changed[:, table.slices[MISSING_TERM]] += 0.5
    if not np.array_equal(_actions(policy, observations), _actions(policy, changed)):
        fact = f"--policy: {policy.name} needs the linear velocity, which rt/lowstate does not have"
        raise PolicyError(fact, _REMEDY)


_REMEDY = "valid: trot, or a policy of `python -m train --observations deployable`"


def _actions(policy: Policy, observations: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the actions of a freshly reset policy for a sequence of observations, (steps, 12), rad."""
    policy.reset(num_envs=1, seed=0)
    return np.array([policy.act(observation) for observation in observations])
