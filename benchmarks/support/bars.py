"""Requirements on the figures of the benchmarks, each with the command that measures the figure."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Threshold:
    """Limit of a figure: reached if ≥ `bound`, or kept if ≤ `bound`."""

    sign: str
    """`≥` or `≤`."""
    bound: float
    """Limit, in `unit`."""
    unit: str = ""
    """Unit for display, with a leading space if needed."""

    def is_met(self, value: float) -> bool:
        """Return whether the value is within the limit; NaN is not."""
        return value >= self.bound if self.sign == "≥" else value <= self.bound

    def __str__(self) -> str:
        return f"{self.sign} {self.bound:g}{self.unit}"


@dataclass(frozen=True)
class Requirement:
    """Requirement on figures; met if one of its limits is."""

    name: str
    """Description of the figures."""
    command: str
    """Command that measures the figures."""
    limits: tuple[Threshold, ...]
    """Limit of each figure."""


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
"""Name -> requirement."""

ACCURACY_BARS = {
    "trunk_mm": Threshold("≤", 2.0),
    "tilt_rad": Threshold("≤", 0.01),
    "joints_rad": Threshold("≤", 0.01),
    "penetration_mm": Threshold("≤", 2.0),
    "slip_mm_s": Threshold("≤", 1.0),
}
"""Figure of `physics_accuracy.Accuracy` -> its limit."""


@dataclass(frozen=True)
class RequirementCheck:
    """Values measured for a requirement, one per limit. The fields are keys of the JSON file."""

    bar: str
    """Name of the requirement in BARS."""
    values: tuple[float, ...]
    """Measured value for each limit."""

    @property
    def is_met(self) -> bool:
        """True if one of the limits is met."""
        return any(limit.is_met(value) for limit, value in zip(BARS[self.bar].limits, self.values, strict=True))


def check_requirement(bar: str, *values: float) -> RequirementCheck:
    """Attach measured values to a requirement.

    Args:
        bar: Name of the requirement.
        *values: One value for each of its limits.

    Returns:
        The check.

    Raises:
        ValueError: The number of values is wrong.
    """
    if len(values) != len(BARS[bar].limits):
        raise ValueError(f"{bar}: {len(values)} values for {len(BARS[bar].limits)} limits")
    return RequirementCheck(bar, values)
