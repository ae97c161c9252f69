"""What must be seen: the figures that the benchmarks are held to, each by the command that measures it."""

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
    """One row: met if one of its limits is; without limits the value is only shown."""

    what: str
    command: str
    limits: tuple[Limit, ...]


THRESHOLDS = (0.15, 0.10, 0.08)
"""Flat velocity errors that training is timed to, m/s."""

BARS = {
    "single_env": Bar("single env / bare mj_step loop, speed", "single_env", (Limit("≥", 0.55),)),
    "vector_env": Bar(
        "vector env of 1024 / bare Batch.step, speed; overhead an env step",
        "vector_env",
        (Limit("≥", 0.90), Limit("≤", 6.0, " µs")),
    ),
    "physics": Bar("shipped physics / first settings, speed within the accuracy bar", "physics", (Limit("≥", 1.5),)),
    "async": Bar("vector env of 64 / AsyncVectorEnv of 64, speed", "peers", (Limit("≥", 2.0),)),
    "subproc": Bar("vector env of 64 / SubprocVecEnv of 64, speed", "peers", (Limit("≥", 2.5),)),
    "residual 0.15": Bar("residual, seconds to a velocity error of 0.15 m/s", "training", (Limit("≤", 60.0, " s"),)),
    "residual 0.08": Bar("residual, seconds to a velocity error of 0.08 m/s", "training", (Limit("≤", 300.0, " s"),)),
    "end-to-end 0.15": Bar("end-to-end, seconds to a velocity error of 0.15 m/s", "training --policy end-to-end", ()),
    "end-to-end 0.08": Bar("end-to-end, seconds to a velocity error of 0.08 m/s", "training --policy end-to-end", ()),
    "resume": Bar("of 20 runs killed with SIGKILL, resumed to the bit", "resume", (Limit("≥", 20.0),)),
    "control step": Bar("control step of one robot, 99.9th percentile", "policies", (Limit("≤", 10.0, " ms"),)),
    "joint step": Bar("joint-loop step of one robot, 99.9th percentile", "policies", (Limit("≤", 2.0, " ms"),)),
    "mpc solve": Bar("MPC, a plan of one robot, median", "mpc", (Limit("≤", 2.0, " ms"),)),
    "mpc slow solve": Bar("MPC, a plan of one robot, 99th percentile", "mpc", (Limit("≤", 5.0, " ms"),)),
    "mpc real time": Bar("mpc_wbc, one robot / real time, speed", "mpc", (Limit("≥", 1.0),)),
    "mpc many robots": Bar("mpc_wbc, 64 robots with physics / real time, speed", "mpc", (Limit("≥", 10.0),)),
    "mpc cost": Bar("MPC and WBC, cost above the reference's, relative, worst", "solvers", (Limit("≤", 1e-4),)),
    "mpc violation": Bar("MPC and WBC, violation of a row, N or N·m, worst", "solvers", (Limit("≤", 1e-4),)),
    "import": Bar("import quad_env, gymnasium / import gymnasium, time", "startup", (Limit("≤", 1.15),)),
    "loaded": Bar("of gymnasium, mujoco and torch, loaded by import quad_env", "startup", (Limit("≤", 0.0),)),
    "help": Bar("--help of evaluate and train, the slower", "startup", (Limit("≤", 1.0, " s"),)),
    "view real time": Bar("live view and a browser, speed / real time", "view", (Limit("≥", 1.0),)),
    "view frames": Bar("live view, frames that a browser draws in software", "view", (Limit("≥", 20.0, "/s"),)),
    "view first frame": Bar("live view, from the command to the first frame", "view", (Limit("≤", 10.0, " s"),)),
    "rendering": Bar("frames of 640 x 480, in software on one core", "rendering", (Limit("≥", 15.0, "/s"),)),
    "cluster": Bar("Ray on this machine / worker processes, time without its start", "cluster", (Limit("≤", 1.10),)),
    "killed": Bar("of the workers killed, those that changed episodes.parquet", "cluster", (Limit("≤", 0.0),)),
    "recording": Bar("60 s recorded / not recorded, time of the simulation", "recording", (Limit("≤", 1.15),)),
    "memory": Bar("memory of 4096 envs", "growth", (Limit("≤", 1.5, " GiB"),)),
}

ACCURACY = {
    "trunk_mm": Limit("≤", 2.0),
    "tilt_rad": Limit("≤", 0.01),
    "joints_rad": Limit("≤", 0.01),
    "sinks_mm": Limit("≤", 2.0),
    "slip_mm_s": Limit("≤", 1.0),
}
"""What a physics setting must keep, see `physics_accuracy.Accuracy`."""


@dataclass(frozen=True)
class Check:
    """A bar and the values measured for it, one a limit."""

    bar: str
    values: tuple[float, ...]

    @property
    def met(self) -> bool | None:
        """Whether one limit is met; None for a row that has none."""
        limits = BARS[self.bar].limits
        return any(limit.met(value) for limit, value in zip(limits, self.values, strict=True)) if limits else None


def check(bar: str, *values: float) -> Check:
    """The values, one a limit of that bar; a bar without limits takes one."""
    if len(values) != max(len(BARS[bar].limits), 1):
        raise ValueError(f"{bar}: {len(values)} values for {len(BARS[bar].limits)} limits")
    return Check(bar, values)
