"""The limits that the benchmarks' figures must keep, each with the command that measures the figure."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Limit:
    """A figure that must be reached, ≥, or not be passed, ≤."""

    sign: str
    figure: float
    unit: str = ""

    def met(self, value: float) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return value >= self.figure if self.sign == "≥" else value <= self.figure

    def __str__(self) -> str:
        return f"{self.sign} {self.figure:g}{self.unit}"


@dataclass(frozen=True)
class Bar:
    """One row: met if one of its limits is."""

    what: str
    command: str
    limits: tuple[Limit, ...]


BARS = {
    "single_env": Bar("single env / bare mj_step loop, speed", "single_env", (Limit("≥", 0.55),)),
    "vector_env": Bar(
        "vector env of 1024 / bare Batch.step, speed; overhead an env step",
        "vector_env",
        (Limit("≥", 0.90), Limit("≤", 6.0, " µs")),
    ),
    "physics": Bar("shipped physics / first settings, speed within the accuracy bar", "physics", (Limit("≥", 1.5),)),
    "control step": Bar("control step of one robot, 99.9th percentile", "policies", (Limit("≤", 10.0, " ms"),)),
    "joint step": Bar("joint-loop step of one robot, 99.9th percentile", "policies", (Limit("≤", 2.0, " ms"),)),
    "training": Bar("learner steps / physics alone of the same robots, speed", "training", (Limit("≥", 0.55),)),
    "import": Bar("import quad_env, gymnasium / import gymnasium, time", "startup", (Limit("≤", 1.25),)),
    "loaded": Bar("of gymnasium, mujoco and torch, loaded by import quad_env", "startup", (Limit("≤", 0.0),)),
    "help": Bar("--help of evaluate and train, the slower", "startup", (Limit("≤", 0.8, " s"),)),
    "view real time": Bar("live view and a browser, speed / real time", "view", (Limit("≥", 1.0),)),
    "view frames": Bar("live view, frames that a browser draws in software", "view", (Limit("≥", 20.0, "/s"),)),
    "view first frame": Bar("live view, from the command to the first frame", "view", (Limit("≤", 10.0, " s"),)),
    "rendering": Bar("frames of 640 x 480, in software on one core", "rendering", (Limit("≥", 15.0, "/s"),)),
    "recording": Bar("60 s recorded / not recorded, time of the simulation", "recording", (Limit("≤", 1.15),)),
}

ACCURACY = {
    "trunk_mm": Limit("≤", 2.0),
    "tilt_rad": Limit("≤", 0.01),
    "joints_rad": Limit("≤", 0.01),
    "sinks_mm": Limit("≤", 2.0),
    "slip_mm_s": Limit("≤", 1.0),
}
"""What a physics setting must keep, as in `physics_accuracy.Accuracy`."""


@dataclass(frozen=True)
class Check:
    """A bar and the values measured for it, one a limit."""

    bar: str
    values: tuple[float, ...]

    @property
    def met(self) -> bool:
        """Whether one of the bar's limits is met."""
        return any(limit.met(value) for limit, value in zip(BARS[self.bar].limits, self.values, strict=True))


def check(bar: str, *values: float) -> Check:
    """The values, one for each limit of that bar. Raises ValueError where there are more or fewer."""
    if len(values) != len(BARS[bar].limits):
        raise ValueError(f"{bar}: {len(values)} values for {len(BARS[bar].limits)} limits")
    return Check(bar, values)
