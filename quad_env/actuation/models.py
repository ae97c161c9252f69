"""Parameters of the joint actuators (servo motors), in physical units at the joint, after the gear.

The argument `actuator` of `gym.make` selects an actuator. The ideal servo receives its target immediately, and its only
limit is the torque limit of the scenario, `Motors.torque_limit`. If an actuator and the `Motors` of a scenario limit
the same quantity, the smaller limit applies. The delay of an actuator is added to the `Latency` of the scenario.
"""

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple, cast

import numpy as np

from quad_env.columns import Array
from quad_env.config import Bounds, Fraction, Positive, Settings
from quad_env.robots.robot import JOINTS, Robot
from quad_env.robots.structure import JOINTS_PER_LEG

MAX_SETTLING_ERROR = 0.01
"""Remaining error at which a first-order filter counts as settled, as a fraction of the target change.

This fraction determines the number of past joint targets that `Actuator.target_weights` takes into account.
"""
JointValues = Positive | tuple[Positive, ...] | None
"""Motor parameter of the joints: one value for all joints, three for hip, thigh and calf of every leg, or twelve.

None stands for the values of the robot.
"""


@dataclass(frozen=True)
class TorqueSpeed(Settings):
    """Torque-speed curve of a DC motor at constant voltage: τ ≤ stall_torque · (1 − ω / no_load_speed).

    τ is the torque and ω the speed of the joint. The same limit applies with the signs of torque and speed reversed. A
    parameter is one number for all joints, three numbers for hip, thigh and calf of every leg, or twelve numbers.

    A winding of resistance R and motor constant K at a voltage v has the torque τ = K (v − K ω) / R (MuJoCo DC Motor
    Model, equation 2). The drive limits the voltage v to ±V. The torque limit at v = V is a straight line over ω, for
    driving and for braking. A braking motor could exceed the stall torque, but the current limit of the drive keeps the
    torque within ±peak_torque. Above the no-load speed the motor can only brake, with at least the torque of the line.
    """

    stall_torque: JointValues = None
    """Torque limit at standstill by the voltage, N·m; None for the rated torque of the robot"""
    no_load_speed: JointValues = None
    """Speed at which the torque limit by the voltage is 0, rad/s; None for the rated speed of the robot"""
    peak_torque: JointValues = None
    """Torque at the current limit, also while braking, N·m; None for the smaller of `stall_torque` and the robot's
    rated torque"""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in vars(self).items():
            if np.size(value) not in (1, JOINTS_PER_LEG, JOINTS):
                raise ValueError(f"{name} is a number, or {JOINTS_PER_LEG} or {JOINTS} of them, got {value}")

    def resolve(self, robot: Robot) -> "ResolvedTorqueSpeed":
        """Return the torque-speed curve of every joint; values of `robot` replace parameters that are None."""
        stall = _per_joint(self.stall_torque, robot.rated_torque)
        peak = np.minimum(stall, robot.rated_torque) if self.peak_torque is None else _per_joint(self.peak_torque, 0.0)
        return ResolvedTorqueSpeed(stall, _per_joint(self.no_load_speed, robot.rated_speed), peak)


class ResolvedTorqueSpeed(NamedTuple):
    """Torque-speed curve of every joint of a robot; `TorqueSpeed.resolve` returns it."""

    stall_torque: Array
    """Torque limit of each joint at standstill, given by the largest voltage of its drive, (12,), N·m."""
    no_load_speed: Array
    """Speed of each joint at which the largest voltage of its drive gives no torque, (12,), rad/s."""
    peak_torque: Array
    """Torque limit of each joint at every speed, given by the largest current of its drive, (12,), N·m."""

    @property
    def slope(self) -> Array:
        """Decrease of each joint's torque limit per unit of joint speed, (12,), N·m·s/rad.

        The slope is K²/R, with the motor constant K and the resistance R of the winding. At the torque τ, the winding
        has the heat loss τ² / slope, W.
        """
        return self.stall_torque / self.no_load_speed

    def limits(self, speed: Array) -> tuple[Array, Array]:
        """Compute the lower and upper torque limits at given joint speeds.

        Args:
            speed: Joint speeds, (..., 12), rad/s.

        Returns:
            lower: Lower torque limits, (..., 12), N·m.
            upper: Upper torque limits, (..., 12), N·m.
        """
        lost = self.slope * speed
        peak = self.peak_torque
        return (-self.stall_torque - lost).clip(-peak, peak), (self.stall_torque - lost).clip(-peak, peak)


def _per_joint(value: JointValues, default: float) -> Array:
    """Expand one, three or twelve values to the value of each joint, (12,); `default` if `value` is None."""
    return np.resize(default if value is None else value, JOINTS).astype(np.float64)


@dataclass(frozen=True)
class Thermal(Settings):
    """First-order thermal model of a motor winding with one temperature T; losses heat the winding.

    The model is C dT/dt = τ² / slope − (T − ambient) / resistance. C = time_constant / resistance is the heat capacity,
    τ the torque of each physics step, and slope the attribute `ResolvedTorqueSpeed.slope`. The electrical resistance of
    the winding is constant.

    From `derating` to `shutdown` the torque limit falls linearly to the fraction `derated` of the full limit. A motor
    that reaches `shutdown` stays off until the end of the episode, even after it has cooled, as with drives of moteus
    and ODrive. The winding is then open, so the motor neither drives nor brakes. An episode starts at `ambient`.

    The defaults describe a small leg motor with its case at ambient temperature: 1.07 K/W, 16.3 J/K, at most 115 °C.
    The torque limit falls from 15 °C below the maximum (opensourceleg, `hardware/thermal.py`).
    """

    resistance: Positive = 1.07
    """Thermal resistance from the winding to its surroundings, K/W"""
    time_constant: Positive = 17.4
    """Time constant of the winding temperature, s"""
    ambient: float = 25.0
    """Temperature of the motor's surroundings, °C"""
    derating: float = 100.0
    """Winding temperature above which the torque limit decreases, °C"""
    shutdown: float = 115.0
    """Winding temperature at which the motor is switched off, °C"""
    derated: Fraction = 0.5
    """Fraction of the torque limit that remains just below `shutdown`; with 0 a motor hardly ever reaches `shutdown`"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -273.15 <= self.ambient <= self.derating < self.shutdown < float("inf"):
            raise ValueError(
                "temperatures must rise from ambient to derating to shutdown, got "
                f"{self.ambient}, {self.derating} and {self.shutdown} °C"
            )


@dataclass(frozen=True)
class Actuator(Settings):
    """Model of a joint's servo motor; the defaults are an ideal servo."""

    curve: TorqueSpeed | None = None
    """Torque-speed curve; None for a torque limit that does not depend on the speed"""
    bandwidth: Positive | None = None
    """Corner frequency of a first-order low-pass filter of the joint target, Hz; None for no filter"""
    delay: Annotated[float, Bounds("from 0 s to 1 s", 0.0, 1.0)] = 0.0
    """Delay from the arrival of a target at the drive to its effect, rounded to whole physics steps, s. The drive holds
    the home pose until the first target of an episode takes effect"""
    thermal: Thermal | None = None
    """Thermal model, which needs a `curve` to compute the heat; None for a winding that stays cold"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thermal is not None and self.curve is None:
            raise ValueError("a thermal model needs a curve, from which the heat of a torque follows: give one")

    def target_weights(self, timestep: float, period: float) -> Array:
        """Compute the weights with which the last k joint targets enter the target that a motor follows.

        A motor follows a weighted mean of the newest and earlier targets, because of its delay and its low-pass filter.
        The weights are averaged over one control period. In each physics step, the motor follows the filter output at
        the start of the step.

        Args:
            timestep: Physics step, s.
            period: Control period, s.

        Returns:
            Weights with sum 1, (k,). The first weight belongs to the target of this control period, the next weights
            belong to earlier targets, newest first.
        """
        steps = round(period / timestep)
        delay_steps = round(self.delay / timestep)
        decay = 0.0 if self.bandwidth is None else math.exp(-timestep * 2 * math.pi * self.bandwidth)
        settling_steps = 0 if self.bandwidth is None else math.ceil(math.log(MAX_SETTLING_ERROR) / math.log(decay))
        count = math.ceil((delay_steps + settling_steps) / steps) + 1
        elapsed_steps = np.arange(count * steps) - delay_steps + (self.bandwidth is None)
        response = (1.0 - decay ** np.maximum(elapsed_steps, 0)).reshape(count, steps).mean(axis=1)
        weights = np.diff(response, prepend=0.0)
        return cast("Array", weights / weights.sum())


IDEAL = Actuator()
"""Ideal servo: it has no delay and no low-pass filter, and its torque limit does not depend on the speed."""
ACTUATORS = {
    "ideal": IDEAL,
    "torque_speed": Actuator(TorqueSpeed()),
    "motor": Actuator(TorqueSpeed(), bandwidth=66.0, delay=0.002, thermal=Thermal()),
}
"""Name of a built-in actuator -> its parameters.

The bandwidth of the actuator `motor`, 66 Hz, was measured on a quasi-direct drive (Pérez-Díaz et al., 2024). The delay
of this actuator, 2 ms, is one cycle of a 500 Hz field bus.
"""


def find_actuator(which: str | Actuator) -> Actuator:
    """Return the actuator with the name `which` in `ACTUATORS`; an `Actuator` is returned unchanged.

    ValueError is raised for an unknown name.
    """
    if isinstance(which, Actuator):
        return which
    if not isinstance(which, str) or which not in ACTUATORS:
        raise ValueError(f"unknown actuator {which!r}; valid: {', '.join(ACTUATORS)}, or a quad_env.Actuator")
    return ACTUATORS[which]


def min_limit(first: float | None, second: float | None) -> float | None:
    """Return the smaller of two limits of the same quantity; None means that there is no limit.

    Args:
        first: First limit, or None.
        second: Second limit in the same unit, or None.

    Returns:
        The smaller limit, or None if both limits are None.
    """
    return min((limit for limit in (first, second) if limit is not None), default=None)
