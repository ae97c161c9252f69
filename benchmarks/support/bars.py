"""The limits that the benchmarks' figures must keep, each with the command that measures the figure."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Threshold:
    """A figure that must be reached, ≥, or not be passed, ≤."""

    sign: str
    bound: float
    unit: str = ""

    def is_met(self, value: float) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return value >= self.bound if self.sign == "≥" else value <= self.bound

    def __str__(self) -> str:
        return f"{self.sign} {self.bound:g}{self.unit}"


@dataclass(frozen=True)
class Requirement:
    """One row: met if one of its limits is."""

    name: str
    command: str
    limits: tuple[Threshold, ...]


BARS = {
    "single_env": Requirement("single env / bare mj_step loop, speed", "single_env", (Threshold("≥", 0.55),)),
    "vector_env": Requirement(
        "vector env of 1024 / bare Batch.step, speed; overhead an env step",
        "vector_env",
        (Threshold("≥", 0.90), Threshold("≤", 6.0, " µs")),
    ),
    "physics": Requirement(
        "shipped physics / first settings, speed within the accuracy bar", "physics", (Threshold("≥", 1.5),)
    ),
    "control step": Requirement(
        "control step of one robot, 99.9th percentile", "policies", (Threshold("≤", 10.0, " ms"),)
    ),
    "joint step": Requirement(
        "joint-loop step of one robot, 99.9th percentile", "policies", (Threshold("≤", 2.0, " ms"),)
    ),
    "training": Requirement(
        "learner steps / physics alone of the same robots, speed", "training", (Threshold("≥", 0.55),)
    ),
    "import": Requirement("import quad_env, gymnasium / import gymnasium, time", "startup", (Threshold("≤", 1.25),)),
    "loaded": Requirement(
        "of gymnasium, mujoco and torch, loaded by import quad_env", "startup", (Threshold("≤", 0.0),)
    ),
    "help": Requirement("--help of evaluate and train, the slower", "startup", (Threshold("≤", 0.8, " s"),)),
    "view real time": Requirement("live view and a browser, speed / real time", "view", (Threshold("≥", 1.0),)),
    "view frames": Requirement(
        "live view, frames that a browser draws in software", "view", (Threshold("≥", 20.0, "/s"),)
    ),
    "view first frame": Requirement(
        "live view, from the command to the first frame", "view", (Threshold("≤", 10.0, " s"),)
    ),
    "rendering": Requirement(
        "frames of 640 x 480, in software on one core", "rendering", (Threshold("≥", 15.0, "/s"),)
    ),
    "recording": Requirement(
        "60 s recorded / not recorded, time of the simulation", "recording", (Threshold("≤", 1.15),)
    ),
}

ACCURACY_BARS = {
    "trunk_mm": Threshold("≤", 2.0),
    "tilt_rad": Threshold("≤", 0.01),
    "joints_rad": Threshold("≤", 0.01),
    "penetration_mm": Threshold("≤", 2.0),
    "slip_mm_s": Threshold("≤", 1.0),
}
"""What a physics setting must keep, as in `physics_accuracy.Accuracy`."""


@dataclass(frozen=True)
class RequirementCheck:
    """A bar and the values measured for it, one a limit."""

    bar: str
    values: tuple[float, ...]

    @property
    def is_met(self) -> bool:
        """Whether one of the bar's limits is met."""
        return any(limit.is_met(value) for limit, value in zip(BARS[self.bar].limits, self.values, strict=True))


def check_requirement(bar: str, *values: float) -> RequirementCheck:
    """The values, one for each limit of that bar. Raises ValueError where there are more or fewer."""
    if len(values) != len(BARS[bar].limits):
        raise ValueError(f"{bar}: {len(values)} values for {len(BARS[bar].limits)} limits")
    return RequirementCheck(bar, values)
