"""Requirements on the speed and accuracy of the project, with limits of the measured values.

Each requirement names the benchmark command that measures its values.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Threshold:
    """Lower or upper limit of one measured value, for example a speed ratio."""

    sign: str
    """Kind of the limit: `≥` for a lower limit, `≤` for an upper limit."""
    bound: float
    """Value of the limit, in the unit of the field `unit`."""
    unit: str = ""
    """Unit that is printed directly after a number, with a leading space if needed, for example ` µs` or `/s`."""

    def is_met(self, value: float) -> bool:
        """Return True if the measured `value`, in the unit of the limit, is within the limit; False for NaN."""
        return value >= self.bound if self.sign == "≥" else value <= self.bound

    def __str__(self) -> str:
        return f"{self.sign} {self.bound:g}{self.unit}"


@dataclass(frozen=True)
class Requirement:
    """Requirement on measured values; it is met if at least one of the values is within its limit."""

    name: str
    """Description of the measured values, shown in the table of requirements."""
    command: str
    """Name of the benchmark command that measures the values: NAME in `python -m benchmarks.NAME`."""
    limits: tuple[Threshold, ...]
    """Limits of the measured values, one for each value."""


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
    "network": Requirement(
        "action of a network that runs alone / of mpc_wbc, one robot, time", "network", (Threshold("≤", 0.05),)
    ),
    "training": Requirement(
        "learner steps / physics alone of the same robots, speed", "training", (Threshold("≥", 0.55),)
    ),
    "evaluation": Requirement(
        "evaluation / bare physics of the same robots and the policies, speed", "evaluation", (Threshold("≥", 0.75),)
    ),
    "evaluation hardware": Requirement(
        "evaluation with the hardware profile / bare physics and the policies, speed",
        "evaluation",
        (Threshold("≥", 0.5),),
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
"""All requirements of the benchmarks: name -> requirement."""

ACCURACY_BARS = {
    "trunk_mm": Threshold("≤", 2.0),
    "tilt_rad": Threshold("≤", 0.01),
    "joints_rad": Threshold("≤", 0.01),
    "penetration_mm": Threshold("≤", 2.0),
    "slip_mm_s": Threshold("≤", 1.0),
}
"""Accuracy limits of a physics setting: field of `physics_accuracy.Accuracy` -> limit of the field's value."""


@dataclass(frozen=True)
class RequirementCheck:
    """Check of a requirement: its measured values, and if they meet the requirement; see `check_requirement`.

    The names of the fields are keys of the benchmark's JSON file.
    """

    bar: str
    """Name of the requirement, a key of BARS."""
    values: tuple[float, ...]
    """Measured values of the requirement, one for each of its limits."""

    @property
    def is_met(self) -> bool:
        """True if the requirement is met: at least one measured value is within its limit."""
        return any(limit.is_met(value) for limit, value in zip(BARS[self.bar].limits, self.values, strict=True))


def check_requirement(bar: str, *values: float) -> RequirementCheck:
    """Check if measured values meet a requirement.

    Args:
        bar: Name of the requirement, a key of BARS.
        *values: Measured values, one for each limit of the requirement.

    Returns:
        The check, which has the name of the requirement and the measured values.

    Raises:
        ValueError: The number of values is different from the number of limits.
    """
    if len(values) != len(BARS[bar].limits):
        raise ValueError(f"{bar}: {len(values)} values for {len(BARS[bar].limits)} limits")
    return RequirementCheck(bar, values)
