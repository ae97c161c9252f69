"""What drives the joints, as values in physical units at the joint, behind the gear; `actuator=` of `make` chooses one.

The ideal servo is limited by `Motors.torque_limit` alone and follows its target at once. Where an actuator and the
`Motors` of a scenario limit the same thing, the weaker one holds; delays add up with `Latency`.
"""

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple, cast

import numpy as np

from quad_env.columns import Array
from quad_env.config import Bounds, Fraction, Positive, Settings
from quad_env.robots.robot import JOINTS, Robot
from quad_env.robots.structure import JOINTS_PER_LEG

UNSETTLED = 0.01
"""Share of a target's change that a lag has not made yet when it is taken to be over."""
EachJoint = Positive | tuple[Positive, ...] | None
"""A figure of all joints, of hip, thigh and calf, or of each of the twelve; None: the robot's own."""


@dataclass(frozen=True)
class TorqueSpeed(Settings):
    """The torque-speed curve of a DC motor on a constant voltage: τ ≤ stall_torque · (1 − ω / no_load_speed), and the
    same with both signs turned; a figure is one number for all joints, or three, of hip, thigh and calf, or twelve.

    The line is that of a winding of resistance R and motor constant K on a voltage of at most ±V: τ = K (v − K ω) / R
    (MuJoCo DC Motor Model, equation 2). It goes on through all four quadrants: a motor that brakes could exceed the
    stall torque, but the drive's current limit holds the torque within ±peak_torque. Above the speed without load the
    motor can do nothing but brake, at least along the line.
    """

    stall_torque: EachJoint = None
    """N·m at standstill on the line; None: the robot's rated torque"""
    no_load_speed: EachJoint = None
    """rad/s at which no torque is left; None: the robot's rated speed"""
    peak_torque: EachJoint = None
    """N·m, the limit of the current, braking included; None: the stall torque, at most the robot's rated torque"""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value in vars(self).items():
            if np.size(value) not in (1, JOINTS_PER_LEG, JOINTS):
                raise ValueError(f"{name} is a number, or {JOINTS_PER_LEG} or {JOINTS} of them, got {value}")

    def resolve(self, robot: Robot) -> "ResolvedTorqueSpeed":
        """The curves of that robot's motors."""
        stall = _each(self.stall_torque, robot.rated_torque)
        peak = np.minimum(stall, robot.rated_torque) if self.peak_torque is None else _each(self.peak_torque, 0.0)
        return ResolvedTorqueSpeed(stall, _each(self.no_load_speed, robot.rated_speed), peak)


class ResolvedTorqueSpeed(NamedTuple):
    """The figures of a `TorqueSpeed` on a robot, each of shape (12,)."""

    stall_torque: Array
    """N·m"""
    no_load_speed: Array
    """rad/s"""
    peak_torque: Array
    """N·m"""

    @property
    def slope(self) -> Array:
        """Torque lost per speed, K²/R, N·m·s/rad; the winding turns τ² / slope into heat, W."""
        return self.stall_torque / self.no_load_speed

    def limits(self, speed: Array) -> tuple[Array, Array]:
        """Least and largest torque at these joint speeds, rad/s, (…, 12), N·m."""
        lost, peak = self.slope * speed, self.peak_torque
        return (-self.stall_torque - lost).clip(-peak, peak), (self.stall_torque - lost).clip(-peak, peak)


def _each(value: EachJoint, own: float) -> Array:
    """That of each joint, (12,)."""
    return np.resize(own if value is None else value, JOINTS).astype(np.float64)


@dataclass(frozen=True)
class Thermal(Settings):
    """A winding that its own losses heat and that cools to its surroundings: one node, first order.

    C dT/dt = τ² / slope − (T − ambient) / resistance, where C = time_constant / resistance and τ is the torque of each
    physics step. The winding's resistance is taken to be constant.

    From `derating` to `shutdown` the torque limit falls linearly to the share `derated` of itself; a motor that reaches
    `shutdown` is switched off: its winding is open, it gives no torque and does not brake, until the end of the
    episode, however much it cools, as drives of moteus and ODrive do. An episode starts at `ambient`.

    The default figures are those of a small leg motor whose case stays at ambient temperature: 1.07 K/W, 16.3 J/K, at
    most 115 °C with a soft border of 15 °C below it (opensourceleg, `hardware/thermal.py`).
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
    """Share of the torque limit that is left just before; with 0 a motor hardly ever gets so hot"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not -273.15 <= self.ambient <= self.derating < self.shutdown < float("inf"):
            raise ValueError(
                "temperatures must rise from ambient to derating to shutdown, got "
                f"{self.ambient}, {self.derating} and {self.shutdown} °C"
            )


@dataclass(frozen=True)
class Actuator(Settings):
    """A joint's servo motor; every part is ideal unless it is given."""

    curve: TorqueSpeed | None = None
    """None: any torque within the limit at any speed"""
    bandwidth: Positive | None = None
    """Hz, as `Motors.bandwidth`: a first-order lag of the target; None: no lag"""
    delay: Annotated[float, Bounds("from 0 s to 1 s", 0.0, 1.0)] = 0.0
    """s from a target's arrival at the drive to its effect, rounded to whole physics steps; at the start of an episode
    the drive holds the home pose for so long"""
    thermal: Thermal | None = None
    """None: a winding that stays cold; otherwise needs a curve, whose slope says what a torque costs"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.thermal is not None and self.curve is None:
            raise ValueError("a thermal model needs a curve, from which the heat of a torque follows: give one")

    def target_weights(self, timestep: float, period: float) -> Array:
        """Shares of the targets of a control period, of the one before and so on in what the motors go by on average
        over it, (k,), sum 1; a motor goes by the lag's value at the start of each physics step. `timestep`, `period`: s
        """
        steps, late = round(period / timestep), round(self.delay / timestep)
        kept = 0.0 if self.bandwidth is None else math.exp(-timestep * 2 * math.pi * self.bandwidth)
        settling = 0 if self.bandwidth is None else math.ceil(math.log(UNSETTLED) / math.log(kept))
        count = math.ceil((late + settling) / steps) + 1
        since = np.arange(count * steps) - late + (self.bandwidth is None)
        reached = (1.0 - kept ** np.maximum(since, 0)).reshape(count, steps).mean(axis=1)
        target_weights = np.diff(reached, prepend=0.0)
        return cast("Array", target_weights / target_weights.sum())


IDEAL = Actuator()
ACTUATORS = {
    "ideal": IDEAL,
    "torque_speed": Actuator(TorqueSpeed()),
    "motor": Actuator(TorqueSpeed(), bandwidth=66.0, delay=0.002, thermal=Thermal()),
}
"""By name. `motor`: 66 Hz is the torque bandwidth measured on a quasi-direct drive (Pérez-Díaz et al., 2024), 2 ms one
cycle of a 500 Hz field bus."""


def actuator(which: str | Actuator) -> Actuator:
    """The actuator of that name, or the actuator itself; ValueError lists the valid names."""
    if isinstance(which, Actuator):
        return which
    if not isinstance(which, str) or which not in ACTUATORS:
        raise ValueError(f"unknown actuator {which!r}; valid: {', '.join(ACTUATORS)}, or a quad_env.Actuator")
    return ACTUATORS[which]


def min_limit(first: float | None, second: float | None) -> float | None:
    """The smaller of two limits, of which None is no limit."""
    return min((limit for limit in (first, second) if limit is not None), default=None)
