"""Actuators of the joints as values in physical units at the joint, behind the gear; see `actuator=` of `gym.make`.

The ideal servo is limited only by `Motors.torque_limit`, and follows its target at once. If an actuator and the
`Motors` of a scenario limit the same quantity, the smaller limit holds; delays add up with `Latency`.
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
"""Fraction of a target change that a first-order filter has not reached yet when it counts as settled."""
JointValues = Positive | tuple[Positive, ...] | None
"""One value for all joints, three for hip, thigh and calf, or twelve; None: the robot's own."""


@dataclass(frozen=True)
class TorqueSpeed(Settings):
    """Torque-speed curve of a DC motor at constant voltage: τ ≤ stall_torque · (1 − ω / no_load_speed).

    The same holds with both signs reversed. A parameter is one number for all joints, three for hip, thigh and calf, or
    twelve.

    The line belongs to a winding of resistance R and motor constant K at a voltage v of at most ±V: τ = K (v − K ω) / R
    (MuJoCo DC Motor Model, equation 2). It continues through all four quadrants. A braking motor could exceed the stall
    torque, but the drive's current limit keeps the torque within ±peak_torque. Above the no-load speed the motor can
    only brake, at least along the line.
    """

    stall_torque: JointValues = None
    """N·m at standstill on the line; None: the robot's rated torque"""
    no_load_speed: JointValues = None
    """rad/s at which the torque is 0; None: the robot's rated speed"""
    peak_torque: JointValues = None
    """N·m, current limit, also while braking; None: the stall torque, at most the robot's rated torque"""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in vars(self).items():
            if np.size(value) not in (1, JOINTS_PER_LEG, JOINTS):
                raise ValueError(f"{name} is a number, or {JOINTS_PER_LEG} or {JOINTS} of them, got {value}")

    def resolve(self, robot: Robot) -> "ResolvedTorqueSpeed":
        """Return the curves of the joints of a `robot`."""
        stall = _per_joint(self.stall_torque, robot.rated_torque)
        peak = np.minimum(stall, robot.rated_torque) if self.peak_torque is None else _per_joint(self.peak_torque, 0.0)
        return ResolvedTorqueSpeed(stall, _per_joint(self.no_load_speed, robot.rated_speed), peak)


class ResolvedTorqueSpeed(NamedTuple):
    """Torque-speed curves of all joints of a robot; made by `TorqueSpeed.resolve`."""

    stall_torque: Array
    """(12,), N·m."""
    no_load_speed: Array
    """(12,), rad/s."""
    peak_torque: Array
    """(12,), N·m."""

    @property
    def slope(self) -> Array:
        """Torque lost per speed, K²/R, (12,), N·m·s/rad; the winding turns τ² / slope into heat, W."""
        return self.stall_torque / self.no_load_speed

    def limits(self, speed: Array) -> tuple[Array, Array]:
        """Compute the torque limits at joint speeds.

        Args:
            speed: (..., 12), rad/s.

        Returns:
            lower: (..., 12), N·m.
            upper: (..., 12), N·m.
        """
        lost = self.slope * speed
        peak = self.peak_torque
        return (-self.stall_torque - lost).clip(-peak, peak), (self.stall_torque - lost).clip(-peak, peak)


def _per_joint(value: JointValues, default: float) -> Array:
    """Return the value of each joint, (12,); `default` for None."""
    return np.resize(default if value is None else value, JOINTS).astype(np.float64)


@dataclass(frozen=True)
class Thermal(Settings):
    """A motor winding that its losses heat and that cools to its surroundings: one node, first order.

    C dT/dt = τ² / slope − (T − ambient) / resistance, with C = time_constant / resistance and the torque τ of each
    physics step. The electrical resistance of the winding is constant.

    From `derating` to `shutdown` the torque limit falls linearly to the fraction `derated` of itself. A motor that
    reaches `shutdown` is switched off until the end of the episode, however much it cools, as drives of moteus and
    ODrive do: its winding is open, so it neither drives nor brakes. An episode starts at `ambient`.

    The defaults are a small leg motor with its case at ambient temperature: 1.07 K/W, 16.3 J/K, at most 115 °C, with a
    soft limit 15 °C below (opensourceleg, `hardware/thermal.py`).
    """

    resistance: Positive = 1.07
    """K/W from the winding to its surroundings"""
    time_constant: Positive = 17.4
    """s"""
    ambient: float = 25.0
    """°C"""
    derating: float = 100.0
    """°C above which the torque limit falls"""
    shutdown: float = 115.0
    """°C at which the motor is switched off"""
    derated: Fraction = 0.5
    """Fraction of the torque limit just below `shutdown`; with 0 a motor hardly ever gets that hot"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -273.15 <= self.ambient <= self.derating < self.shutdown < float("inf"):
            raise ValueError(
                "temperatures must rise from ambient to derating to shutdown, got "
                f"{self.ambient}, {self.derating} and {self.shutdown} °C"
            )


@dataclass(frozen=True)
class Actuator(Settings):
    """Servo motor of a joint; every part that is not given is ideal."""

    curve: TorqueSpeed | None = None
    """None: any torque within the limit at any speed"""
    bandwidth: Positive | None = None
    """Hz, as `Motors.bandwidth`: first-order filter of the target; None: no filter"""
    delay: Annotated[float, Bounds("from 0 s to 1 s", 0.0, 1.0)] = 0.0
    """s from the arrival of a target at the drive to its effect, rounded to whole physics steps; until the first target
    takes effect in an episode, the drive holds the home pose"""
    thermal: Thermal | None = None
    """None: a winding that stays cold; otherwise needs a curve, for the heat of a torque"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thermal is not None and self.curve is None:
            raise ValueError("a thermal model needs a curve, from which the heat of a torque follows: give one")

    def target_weights(self, timestep: float, period: float) -> Array:
        """Return the weights of the last targets in the mean target of the motors over a control period.

        A motor follows the value of the filter at the start of each physics step.

        Args:
            timestep: Physics step, s.
            period: Control period, s.

        Returns:
            Weights of the target of this control period, of the one before and so on, (k,), sum 1.
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
"""Servo without limits other than the torque limit."""
ACTUATORS = {
    "ideal": IDEAL,
    "torque_speed": Actuator(TorqueSpeed()),
    "motor": Actuator(TorqueSpeed(), bandwidth=66.0, delay=0.002, thermal=Thermal()),
}
"""Actuators by name. `motor`: 66 Hz is the torque bandwidth measured on a quasi-direct drive (Pérez-Díaz et al., 2024),
2 ms is one cycle of a 500 Hz field bus."""


def find_actuator(which: str | Actuator) -> Actuator:
    """Return the actuator called `which`, or the actuator itself; raise ValueError for an unknown name."""
    if isinstance(which, Actuator):
        return which
    if not isinstance(which, str) or which not in ACTUATORS:
        raise ValueError(f"unknown actuator {which!r}; valid: {', '.join(ACTUATORS)}, or a quad_env.Actuator")
    return ACTUATORS[which]


def min_limit(first: float | None, second: float | None) -> float | None:
    """Return the smaller of the limits `first` and `second`; None is no limit."""
    return min((limit for limit in (first, second) if limit is not None), default=None)
