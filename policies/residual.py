"""Residual policy: a base policy plus a bounded correction of its joint targets by a small network."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, GaitedPolicy, Policy, within_limits
from policies.gait_cycle import FREQUENCY_FILTER_GAIN, TURN, frequency_increase
from policies.history import History, Inputs
from policies.memory import PerRobotState, initialize_state, per_robot
from policies.network import Network
from policies.velocity_error_integral import VelocityErrorIntegral
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import UNSEEN, table_with
from quad_env.task.observations import observation_table

NO_HISTORY = Inputs()
"""Option `inputs` of a network that gets neither past observations nor a clock.

The network inputs are then only the current observation, and the phase and action of the base policy."""


def authority_of(robot: Robot, hip: float = 0.6, joint: float = 1.0) -> Actions:
    """Return the default authority of a residual policy: the largest correction of each joint target.

    The corrections come from the network of the residual policy, and are added to the targets of its base policy.

    Args:
        robot: Robot that the policy controls.
        hip: Largest correction of a hip (abduction) joint, rad.
        joint: Largest correction of a thigh or calf joint, rad.

    Returns:
        Largest absolute correction of each joint, (12,), rad.
    """
    return np.tile(np.array([hip, joint, joint], np.float32), len(robot.leg_names))


class Features(PerRobotState):
    """Features: network inputs of a residual policy for n robots, scaled to magnitudes of about 1.

    The features are, in this order:

    - the scaled observation. If it has a height scan, the scan is relative to the scan of level ground in the home
      pose. Points that the sensor does not see are 0, so that a lost scan looks like level ground;
    - if the base policy has a gait clock: sine and cosine of its gait phase, and its action minus the home pose;
    - if `inputs` defines an additional clock: sine and cosine of the phase of this clock;
    - if `inputs` bounds the position error: forward and lateral position error, m, and yaw error, rad;
    - if `inputs` defines a history: past observations and averages of observations.

    A reset of this object does not reset the base policy; the caller must reset it.

    Args:
        base: Base policy that the network corrects.
        inputs: Past observations, averages and clock that are additional features.
    """

    ticks: Floats = per_robot(0.0)
    """Number of control steps of each robot since its reset, (n,)."""
    clock_offset: Floats = per_robot(0.0)
    """Phase of the clock of each robot minus the phase of a clock with constant frequency, (n,), rad.

    A training can draw the phase at the reset of the robot; otherwise it is zero. Then the offset grows while the clock
    is faster than its frequency at rest."""
    clock_increase: Floats = per_robot(0.0)
    """Present increase of the clock's frequency because of the velocity error, (n,), Hz."""

    def __init__(self, base: Policy, inputs: Inputs = NO_HISTORY) -> None:
        self.base = base
        self.inputs = inputs
        self._table = table_with(base.robot, base.height_scan)
        self._own = observation_table(base.robot).size
        """Number of observation elements that precede the height scan. The history consists of these elements only."""
        self._level = np.float32(base.robot.home_height) * self._table.scale[self._own :]
        self._history = History(inputs, self._own, base.control_period)
        self._position_error = VelocityErrorIntegral(inputs.position_error, base.control_period)
        gaited = 2 + base.robot.num_joints if isinstance(base, GaitedPolicy) else 0
        clock = 2 if inputs.clock else 0
        odometer = 3 if inputs.position_error else 0
        self.width = self._table.size + gaited + clock + odometer + self._history.width
        """Number of network inputs (features) of each robot."""
        super().__init__()

    def update(self, observation: NDArray[np.float32], base_action: Actions) -> NDArray[np.float32]:
        """Compute the features of all robots for one control step. Call the method once per control step.

        Args:
            observation: Observation of all robots, (n, k), with k numbers per robot.
            base_action: Action of the base policy for this observation: joint targets, (n, 12), rad.

        Returns:
            Features, the inputs of the network, (n, `width`).
        """
        self.ticks += 1.0
        scaled = observation * self._table.scale
        scaled[:, self._own :] += self._level
        scaled[:, self._own :][observation[:, self._own :] <= UNSEEN] = 0.0
        seen = [scaled]
        if isinstance(self.base, GaitedPolicy):
            seen += [_phase_features(self.base.phase), base_action - _home(self.base.robot)]
        if self.inputs.clock:
            if self.inputs.clock_gain:
                self._adapt_clock(observation)
            clock = _phase_features(self.clock_phase)
            if self.inputs.clock_at_rest == "hidden":
                clock[~observation[:, self._table.slices["command"]].any(axis=1)] = 0.0
            seen += [clock]
        if self.inputs.position_error:
            seen += [self._integrate_velocity_error(observation)]
        if self._history.width:
            seen += [self._history.update(scaled[:, : self._own])]
        return np.concatenate(seen, axis=-1) if len(seen) > 1 else scaled

    def _integrate_velocity_error(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the position error of all robots, (n, 3), see `VelocityErrorIntegral`.

        The velocities are in the body frame, from `observation`, (n, k), with k numbers per robot.
        """
        slices = self._table.slices
        horizontal = observation[:, slices["linear_velocity"]][:, :2]
        yaw_rate = observation[:, slices["angular_velocity"]][:, 2:]
        velocity = np.nan_to_num(np.concatenate((horizontal, yaw_rate), axis=1).astype(np.float64))
        command = observation[:, slices["command"]].astype(np.float64)
        return self._position_error.update(command, velocity).astype(np.float32)

    def _adapt_clock(self, observation: NDArray[np.float32]) -> None:
        """Adapt the frequency of the clock of each robot to its horizontal velocity error.

        The velocity error is measured in the body frame, from `observation`, (n, k), with k numbers per robot.
        """
        slices = self._table.slices
        velocity = observation[:, slices["linear_velocity"]].astype(np.float64)
        command = observation[:, slices["command"]].astype(np.float64)
        error = np.hypot(velocity[:, 0] - command[:, 0], velocity[:, 1] - command[:, 1])
        # If the observation of a robot is not finite, its clock keeps the present frequency.
        target = frequency_increase(error, self.inputs.clock_gain, self.inputs.clock_limit)
        target = np.where(np.isfinite(error), target, self.clock_increase)
        self.clock_increase = self.clock_increase + FREQUENCY_FILTER_GAIN * (target - self.clock_increase)
        self.clock_offset = self.clock_offset + TURN * self.base.control_period * self.clock_increase

    @property
    def clock_frequency(self) -> Floats:
        """Present frequency of the additional clock that `inputs` defines, (n,), Hz."""
        return self.inputs.clock + self.clock_increase

    @property
    def clock_phase(self) -> Floats:
        """Phase of the additional clock that `inputs` defines, at the latest observation, (n,), rad."""
        return 2.0 * np.pi * self.inputs.clock * self.base.control_period * self.ticks + self.clock_offset


def apply_correction(
    robot: Robot, base_action: Actions, correction: NDArray[np.float32], authority: Actions, bounded: bool = True
) -> Actions:
    """Compute the action of a residual policy: base action plus correction.

    Args:
        robot: Robot with the joint limits.
        base_action: Action of the base policy: joint targets, (n, 12), rad.
        correction: Correction as a fraction of the authority, (n, 12).
        authority: Largest correction of each joint target, (12,), rad. If `bounded` is False, the correction is scaled
            by `authority` but not limited.
        bounded: True to clip the correction to [-1, 1].

    Returns:
        Corrected joint targets, clipped to the joint limits, (n, 12), rad.
    """
    one = np.float32(1.0)
    fraction = np.clip(correction, -one, one) if bounded else correction
    return within_limits(robot, base_action + authority * fraction)


def _phase_features(phase: Floats) -> NDArray[np.float32]:
    """Return the sine and the cosine of a `phase`, (n,), rad, as two columns, (n, 2)."""
    return np.stack([np.sin(phase), np.cos(phase)], axis=-1).astype(np.float32)


def _home(robot: Robot) -> Actions:
    """Return the joint angles of the home pose, (12,), rad, in the type of an action, float32."""
    return robot.home_pose.astype(np.float32)


class ResidualPolicy(Policy):
    """Residual policy: the joint targets of a base policy plus a bounded correction by a network.

    The action is (action of the base policy) + authority · network(features), clipped to the joint limits. `Features`
    computes the features from the observation and the base policy. If the network returns zero, the action is
    identical, bit for bit, to the action of the base policy. The output of the network is clipped to [-1, 1] unless
    `bounded` is False.

    Args:
        base: Base policy. Its robot is also the robot of the residual policy.
        network: Network that computes the corrections, as fractions of the authority, from the features.
        authority: Largest correction of each joint target, (12,), rad. None for the result of `authority_of`.
        name: Name of the policy.
        inputs: Past observations, averages and clock that are additional features.
        hold: Number of control steps for which each correction is used, before the network computes a new correction.
            The base policy acts in every control step.
        bounded: True to clip the output of the network to [-1, 1], so that `authority` is a limit. False: the output is
            not clipped, and `authority` is its scale.

    Raises:
        ValueError: The input width of the network is not the number of features, or its output width is not the number
            of joints.
    """

    correction: NDArray[np.float32] = per_robot()
    """Latest correction as a fraction of the authority, (n, 12); zero before the first action."""
    base_action: Actions = per_robot()
    """Latest action of the base policy: joint targets, (n, 12), rad; the home pose before the first action."""

    def __init__(
        self,
        base: Policy,
        network: Network,
        authority: Actions | None = None,
        name: str = "residual",
        inputs: Inputs = NO_HISTORY,
        hold: int = 1,
        bounded: bool = True,
    ) -> None:
        robot = base.robot
        self.features = Features(base, inputs)
        self.hold = hold
        self.bounded = bounded
        if network.sizes[0] != self.features.width or network.sizes[-1] != robot.num_joints:
            raise ValueError(
                f"a network over {base.name} needs {self.features.width} inputs and {robot.num_joints} outputs, "
                f"not {network.sizes[0]} and {network.sizes[-1]}"
            )
        self.base = base
        self.network = network
        self.authority = authority if authority is not None else authority_of(robot)
        self.name = name
        self.height_scan = base.height_scan
        super().__init__(robot=robot, control_period=base.control_period)
        initialize_state(self, correction=np.zeros(robot.num_joints, np.float32), base_action=_home(robot))

    @property
    def phase(self) -> Floats | None:
        """Phase of the gait clock of the base policy, (n,), rad; None if the base policy has no gait clock."""
        return self.base.phase if isinstance(self.base, GaitedPolicy) else None

    def reset(self, num_envs: int = 1, seed: int | None = None) -> None:
        """Reset this policy and its base policy for `num_envs` robots; both get the same `seed`."""
        super().reset(num_envs, seed)
        self.base.reset(num_envs, seed)

    def _reset_rows(self, mask: NDArray[np.bool_]) -> None:
        super()._reset_rows(mask)
        self.base.reset_where(mask)

    def _act(self, observation: NDArray[np.float32]) -> Actions:
        self.base_action = self.base.act(observation)
        seen = self.features.update(observation, self.base_action)
        if (due := (self.features.ticks - 1.0) % self.hold == 0.0).any():
            corrected = self.network(seen)
            if self.bounded:
                corrected = np.clip(corrected, np.float32(-1.0), np.float32(1.0))
            self.correction = np.where(due[:, None], corrected, self.correction)
        return apply_correction(self.robot, self.base_action, self.correction, self.authority, self.bounded)
