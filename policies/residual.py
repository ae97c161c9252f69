"""Residual policy: a base policy plus a bounded correction of its joint targets by a small network."""

import numpy as np
from numpy.typing import NDArray

from policies.base import Actions, Floats, GaitedPolicy, Policy, all_finite, within_limits
from policies.gait_cycle import FREQUENCY_FILTER_GAIN, TURN, frequency_increase
from policies.history import History, Inputs
from policies.input_terms import TermInputs
from policies.memory import PerRobotState, initialize_state, per_robot
from policies.network import Network
from policies.poses import Stand
from policies.velocity_error_integral import VelocityErrorIntegral
from quad_env.robots.robot import Robot
from quad_env.sensing.height_scan import UNSEEN, table_with
from quad_env.task.observations import observation_table

# These numbers are arrays, because NumPy computes faster with arrays than with Python numbers.
_ONE = np.array(1.0)
_FILTER_GAIN = np.array(FREQUENCY_FILTER_GAIN)
_MIN_CORRECTION = np.array(-1.0, np.float32)
_MAX_CORRECTION = np.array(1.0, np.float32)

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

    If `inputs` names observation terms, the features are only the last values of these terms and of the clock, see
    `policies.input_terms.TermInputs`.

    A reset of this object does not reset the base policy; the caller must reset it.

    Args:
        base: Base policy that the network corrects.
        inputs: Past observations, averages and clock that are additional features; or the terms that are features.
        hold: Number of control steps for which the policy holds each correction, the interval of the values of terms.

    Inputs with terms need a base policy that is a fixed pose without a height scan, else ValueError is raised.
    """

    ticks: Floats = per_robot(0.0)
    """Number of control steps of each robot since its reset, (n,)."""
    clock_offset: Floats = per_robot(0.0)
    """Phase of the clock of each robot minus the phase of a clock with constant frequency, (n,), rad.

    A training can draw the phase at the reset of the robot; otherwise it is zero. Then the offset grows while the clock
    is faster than its frequency at rest."""
    clock_increase: Floats = per_robot(0.0)
    """Present increase of the clock's frequency because of the velocity error, (n,), Hz."""

    def __init__(self, base: Policy, inputs: Inputs = NO_HISTORY, hold: int = 1) -> None:
        self.base = base
        self.inputs = inputs
        self.terms = _make_term_inputs(base, inputs, hold)
        """Features of a policy that observes only some terms; None if the whole observation is features."""
        self._table = table_with(base.robot, base.height_scan)
        self._own = observation_table(base.robot).size
        """Number of observation elements that precede the height scan. The history consists of these elements only."""
        self._level = np.float32(base.robot.home_height) * self._table.scale[self._own :]
        self._history = History(inputs, self._own, base.control_period)
        self._position_error = VelocityErrorIntegral(inputs.position_error, base.control_period)
        self._clock_step = np.array(2.0 * np.pi * inputs.clock * base.control_period)
        """Increase of the phase of the additional clock in a control step at its frequency at rest, rad."""
        self._turn_step = np.array(TURN * base.control_period)
        """Increase of the phase in a control step for each Hz of `clock_increase`, rad."""
        slices = self._table.slices
        self._command = slices["command"]
        horizontal = slices["linear_velocity"].start
        yaw_rate = slices["angular_velocity"].stop - 1
        self._velocity_ids = np.array([horizontal, horizontal + 1, yaw_rate])
        """Indices of forward velocity, lateral velocity and yaw rate in the observation, (3,)."""
        self._uses_velocity = bool(inputs.position_error or (inputs.clock and inputs.clock_gain))
        self._home_pose = _home(base.robot)
        widths = {
            "observation": self._table.size,
            "gait": 2 + base.robot.num_joints if isinstance(base, GaitedPolicy) else 0,
            "clock": 2 if inputs.clock else 0,
            "position error": 3 if inputs.position_error else 0,
            "history": self._history.width,
        }
        ends = np.cumsum(list(widths.values())).tolist()
        self.width: int = ends[-1] if self.terms is None else self.terms.width
        """Number of network inputs (features) of each robot."""
        self.columns = {
            name: slice(end - width, end) for (name, width), end in zip(widths.items(), ends, strict=True) if width
        }
        """Kind of features -> columns of these features in the result of `update`."""
        super().__init__()

    def update(self, observation: NDArray[np.float32], base_action: Actions) -> NDArray[np.float32]:
        """Compute the features of all robots for one control step. Call the method once per control step.

        Args:
            observation: Observation of all robots, (n, k), with k numbers per robot.
            base_action: Action of the base policy for this observation: joint targets, (n, 12), rad.

        Returns:
            Features, the inputs of the network, (n, `width`).
        """
        self.ticks = self.ticks + _ONE
        if self.terms is not None:
            return self.terms.update(observation, self._clock_columns(observation) if self.inputs.clock else None)
        features = np.empty((len(observation), self.width), np.float32)
        parts = {name: features[:, columns] for name, columns in self.columns.items()}
        scaled = np.multiply(observation, self._table.scale, out=parts["observation"])
        if len(self._level):
            self._level_scan(observation, scaled)
        if "gait" in parts and isinstance(self.base, GaitedPolicy):
            _write_phase(self.base.phase, parts["gait"])
            np.subtract(base_action, self._home_pose, out=parts["gait"][:, 2:])
        if self._uses_velocity:
            command = observation[:, self._command].astype(np.float64)
            velocity = observation.take(self._velocity_ids, axis=1).astype(np.float64)
            velocity_error = velocity - command
            is_finite = all_finite(velocity_error)
            if self.inputs.clock and self.inputs.clock_gain:
                self._adapt_clock(velocity_error, is_finite)
        if "clock" in parts:
            self._write_clock(observation, parts["clock"])
        if "position error" in parts:
            known_velocity = velocity if is_finite else np.nan_to_num(velocity)
            parts["position error"][:] = self._position_error.update(command, known_velocity)
        if "history" in parts:
            self._history.update(scaled[:, : self._own], out=parts["history"])
        return features

    def _clock_columns(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return sine and cosine of the clock, (n, 2), for an `observation`, (n, k), of k numbers per robot."""
        columns = np.empty((len(observation), 2), np.float32)
        self._write_clock(observation, columns)
        return columns

    def _write_clock(self, observation: NDArray[np.float32], columns: NDArray[np.float32]) -> None:
        """Write sine and cosine of the clock to `columns`, (n, 2); both are 0 for a robot at rest if so defined.

        A robot is at rest while the command in its row of `observation`, (n, k), is zero.
        """
        _write_phase(self.clock_phase, columns)
        if self.inputs.clock_at_rest == "hidden":
            columns[~observation[:, self._command].any(axis=1)] = 0.0

    def _level_scan(self, observation: NDArray[np.float32], scaled: NDArray[np.float32]) -> None:
        """Make the height scan in the features relative to the scan of level ground in the home pose.

        `observation` and `scaled` are the observation and the scaled observation of all robots, (n, k) each, with k
        numbers per robot. `scaled` is changed in place.
        """
        scan = scaled[:, self._own :]
        scan += self._level
        scan[observation[:, self._own :] <= UNSEEN] = 0.0

    def _adapt_clock(self, velocity_error: Floats, is_finite: bool) -> None:
        """Adapt the frequency of the clock of each robot to its horizontal velocity error.

        `velocity_error` is actual minus commanded velocity, body frame, (n, 3): forward and lateral velocity, m/s, and
        yaw rate, rad/s. `is_finite` is False if an element is infinite or NaN.
        """
        error = np.hypot(velocity_error[:, 0], velocity_error[:, 1])
        target = frequency_increase(error, self.inputs.clock_gain, self.inputs.clock_limit)
        if not is_finite:
            # The clock of a robot keeps its frequency if the observation of this robot is not finite.
            target = np.where(np.isfinite(error), target, self.clock_increase)
        self.clock_increase = self.clock_increase + _FILTER_GAIN * (target - self.clock_increase)
        self.clock_offset = self.clock_offset + self._turn_step * self.clock_increase

    @property
    def clock_frequency(self) -> Floats:
        """Present frequency of the additional clock that `inputs` defines, (n,), Hz."""
        return self.inputs.clock + self.clock_increase

    @property
    def clock_phase(self) -> Floats:
        """Phase of the additional clock that `inputs` defines, at the latest observation, (n,), rad."""
        return self._clock_step * self.ticks + self.clock_offset


def _make_term_inputs(base: Policy, inputs: Inputs, hold: int) -> TermInputs | None:
    """Make the features of a policy that observes only the terms in `inputs`; return None if `inputs` has no terms.

    Raises ValueError if the `base` is not a fixed pose, because its action would depend on other terms, or if it has a
    height scan.
    """
    if not inputs.terms:
        return None
    if not isinstance(base, Stand):
        raise ValueError(f"Inputs.terms: the base policy must be a fixed pose, got {base.name}; valid: stand, crouch")
    if base.height_scan is not None:
        raise ValueError("Inputs.terms: the base policy must have no height scan")
    return TermInputs(base.robot, inputs, hold, base.control_period)


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
    fraction = _limit(correction) if bounded else correction
    return within_limits(robot, base_action + authority * fraction)


def _limit(correction: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a `correction`, (n, 12), clipped to [-1, 1]."""
    return correction.clip(_MIN_CORRECTION, _MAX_CORRECTION)


def _write_phase(phase: Floats, columns: NDArray[np.float32]) -> None:
    """Write the sine and the cosine of a `phase`, (n,), rad, to the first two `columns`, (n, 2 or more)."""
    columns[:, 0] = np.sin(phase)
    columns[:, 1] = np.cos(phase)


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
        self.features = Features(base, inputs, hold)
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
        features = self.features.update(observation, self.base_action)
        if self.hold == 1:
            self.correction = self._compute_correction(features)
        elif (due := (self.features.ticks - 1.0) % self.hold == 0.0).any():
            self.correction = np.where(due[:, None], self._compute_correction(features), self.correction)
        # `_compute_correction` has clipped the correction already.
        return apply_correction(self.robot, self.base_action, self.correction, self.authority, bounded=False)

    def _compute_correction(self, features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Compute the correction of all robots by the network, (n, 12), from `features`, (n, width)."""
        correction = self.network(features)
        return _limit(correction) if self.bounded else correction
