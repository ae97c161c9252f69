"""Options of `python -m evaluate`."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from evaluate.hardware import HardwareConfig
from quad_env.cli.child_process import available_cores
from quad_env.cli.ray_option import RayOption

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
PROGRAM = "python -m evaluate"
WALKING_POLICIES = ("trot", "trot_feedback", "trot_integral", "residual", "robust", "mpc_wbc")
DEFAULT_POLICIES = ("document@flat", "document_repaired@flat", *WALKING_POLICIES)
DEFAULT_BATTERY = ("quick",)
FULL_BATTERY = ("default",)
"""Battery of the option `--full`, from which the tables and figures of the README come."""
EPISODES = {None: 20, "settled": 96}
"""Value of the option `--until` -> default number of episodes of each policy on each scenario.

A run with `--until settled` adds episodes until adjacent policies of the ranking are distinguished. For this run, the
value is the maximum number of episodes.
"""
FULL_EPISODES = 24
"""Default number of episodes of each policy on each scenario with the option `--full`."""
DEFAULT_MINUTES = 3.0
"""Time limit of a run without options, min."""
TIMED_EPISODES = 48
"""Default maximum number of episodes of each policy on each scenario in a run with a time limit."""
RESULT_NEUTRAL_OPTIONS = ("out", "threads", "at_once", "resume", "add", "baseline", "trust", "ray")
"""Names of the options that may change when an interrupted run is resumed; no result depends on them."""


@dataclass(frozen=True)
class EvaluateOptions:
    """Policies and scenarios to compare, and the folder of the results."""

    policies: tuple[str, ...] = DEFAULT_POLICIES
    """Policies to compare: names, bundle folders (models/residual), my_file.py:MyPolicy, .onnx files, .zip files of
    Stable-Baselines3 (with --trust), or deployment files of other projects (deploy.yaml). NAME@SCENARIO restricts a
    policy to one scenario: document@flat. NAME=PATTERN makes the training seeds of an algorithm one entry:
    residual=runs/residual/seed-*."""
    trust: Flag = False
    """Load policies from files that can hide code: a .zip of Stable-Baselines3, TorchScript .pt."""
    scenarios: tuple[str, ...] = DEFAULT_BATTERY
    """Scenarios: names (push), levels (push:3, push:all), severities in the unit of the axis (push=42) and combinations
    (payload=15+slope=10), batteries (quick: each axis at one severity; default: at three; full: at every one; all: at
    the nominal one), terrain files (hill.toml), or a quad_env.Scenario in
    my_file.py:NAME. The ending +randomised adds domain randomisation, +hardware the robot's hardware profile
    (push:3+hardware)."""
    hardware: Flag = False
    """Run every scenario with the robot's hardware profile: motors, delays, sensors and estimator of the real robot."""
    quick: Flag = False
    """The comparison without options: each axis at one severity, with and without the hardware profile, 3 minutes."""
    full: Flag = False
    """The README's comparison: each axis at three severities (--scenarios default), 24 episodes, no time limit."""
    episodes: Annotated[
        int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: 20; 24 with --full)")
    ] = None
    """Episodes of 10 s of each policy on each scenario (count), the same episodes for every policy. The maximum in a
    run with --minutes (default 48) or --until (default 96)."""
    minutes: Annotated[float | None, tyro.conf.arg(metavar="FLOAT", help_behavior_hint="(default: 3 or no limit)")] = (
        None
    )
    """Time limit, min: add whole rounds of episodes until the ranking is settled or a further round would end too late;
    the report takes extra time. By default there is no limit if other options name scenarios or a number of episodes,
    divide the run or end it."""
    until: Literal["settled"] | None = None
    """settled: add episodes in four stages until adjacent policies of the ranking differ significantly or are unlikely
    to; --episodes is the maximum (default 96). Group-sequential test, one error rate for all stages."""
    robot: str = "simple_quad"
    """Robot of every policy: a name of quad_env.ROBOTS such as go1, or the path of its MJCF, URDF or TOML."""
    servo: str = ""
    """Stiffness/damping of the servos for our controllers, N·m/rad and N·m·s/rad (35/0.5), or stiff. By default each
    policy commands its own gains; external policies always do."""
    actuator: str = "ideal"
    """Motors of the joints, one of quad_env.ACTUATORS: ideal, torque_speed or motor."""
    sensors: str = "truth"
    """Source of the observations: truth, or one of quad_env.SENSORS: ideal or typical."""
    estimator: str = "complementary"
    """Estimator of gravity and velocity from the sensors, one of quad_env.ESTIMATORS: complementary or kalman."""
    simulator: str = "mujoco"
    """Simulator of the physics: mujoco, or drake (pip install -e ".[drake]"; twelve times slower). drake supports ideal
    motors and the true state, on flat, steady, push, force, slippery, slope, stairs and payload; other scenarios of a
    battery are left out."""
    seed: int = 0
    """Evaluation seed (whole number >= 0). Evaluation episodes are never used in training."""
    out: Path = Path("results/evaluation")
    """Folder for results.json, episodes.parquet, report.html and manifest.json; files of these names are replaced."""
    part: Annotated[str | None, tyro.conf.arg(metavar="K/N")] = None
    """Simulate only the K-th of N equal shares of all episodes, such as 3/40, into the folder --out: the same command
    on other machines simulates the other parts, and python -m evaluate merge puts them together."""
    resume: Flag = False
    """Continue the interrupted run in the folder --out with its stored options; the interruption changes no result."""
    add: tuple[str, ...] = ()
    """Policies to add to the finished run in the folder --out, with its options; only their episodes are simulated.
    More episodes: --episodes 48 --out RUN."""
    baseline: str | None = None
    """Policy to compare the others with; by default trot, or without it the policy named first."""
    threads: int = available_cores()
    """Worker processes that simulate in parallel (count; default: this machine's cores). No result depends on it."""
    at_once: int = 256
    """Episodes that a process simulates and writes together (count). No result depends on it."""
    ray: RayOption = None
    """Simulate on a Ray cluster (pip install -e ".[cluster]"): at HOST:PORT, or without a value on one of --threads
    workers that is started on this machine. No result depends on it."""

    @property
    def hardware_config(self) -> HardwareConfig:
        """Robot, servo gains, motors, sensors, estimator and simulator that the options select.

        These settings apply to scenarios without the hardware profile (models of the real robot's motors and sensors).
        """
        return HardwareConfig(self.actuator, self.sensors, self.estimator, self.robot, self.servo, self.simulator)

    @property
    def battery(self) -> tuple[str, ...]:
        """Names of the scenarios and batteries (named lists of scenarios) to run."""
        return FULL_BATTERY if self.full else self.scenarios

    @property
    def time_limit(self) -> float:
        """Time limit of the simulation, min; 0 without a limit."""
        if self.minutes is not None:
            return self.minutes
        is_fixed = self.full or self.until or self.part is not None or self.episodes is not None
        return 0.0 if is_fixed or self.scenarios != DEFAULT_BATTERY else DEFAULT_MINUTES

    @property
    def max_episodes(self) -> int:
        """Number of episodes of each policy on each scenario.

        A run with `--until settled` or a time limit adds episodes until adjacent policies of the ranking are
        distinguished. For this run, the value is the maximum number of episodes.
        """
        if self.episodes is not None:
            return self.episodes
        if self.until:
            return EPISODES[self.until]
        if self.time_limit:
            return TIMED_EPISODES
        return FULL_EPISODES if self.full else EPISODES[None]

    def run_options(self) -> dict[str, Any]:
        """Return the options that must not change when an interrupted run is resumed: name -> JSON value."""
        values = asdict(self) | {"episodes": self.max_episodes, "minutes": self.time_limit or None}
        run_values = {name: value for name, value in values.items() if name not in RESULT_NEUTRAL_OPTIONS}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in run_values.items()}


def options_from_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert option values that `run_options` has stored back to field values of EvaluateOptions.

    Args:
        values: Name of an option -> JSON value.

    Returns:
        Name of a field of EvaluateOptions -> value of the field.

    Raises:
        ValueError: The values do not match the options, because another version of the program wrote them.
    """
    names = {field.name for field in fields(EvaluateOptions)} - set(RESULT_NEUTRAL_OPTIONS)
    if set(values) != names:
        raise ValueError(f"its options are those of another version: {', '.join(sorted(set(values) ^ names))}")
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def describe_changes(then: EvaluateOptions, now: EvaluateOptions) -> list[str]:
    """Describe each option that differs between two runs, for example `--seed was 0, not 1`.

    Args:
        then: Options of the earlier run.
        now: Options of the present run.

    Returns:
        A text for each option that differs.
    """
    before = then.run_options()
    after = now.run_options()
    return [
        f"--{name} was {_words(before[name])}, not {_words(after[name])}"
        for name in before
        if before[name] != after[name]
    ]


def command(values: Mapping[str, Any]) -> str:
    """Return the command line of a run from its stored option `values`, name -> JSON value.

    Options with default values are left out.
    """
    defaults = _default_values(values)
    words = PROGRAM.split()
    for name, value in values.items():
        if value is not None and value != defaults.get(name, False):
            words.append(f"--{name}")
            if isinstance(value, list):
                words += map(str, value)
            elif value is not True:
                words.append(str(value))
    return shlex.join(words)


def _default_values(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values that options have if only the options that select the kind of run are given.

    Args:
        values: Name of an option -> JSON value, of all options.

    Returns:
        Name of an option -> default value. The options that select the kind of run have their own default values.
    """
    kind = {name: values[name] for name in ("full", "part") if values.get(name)}
    if values.get("scenarios"):
        kind["scenarios"] = tuple(values["scenarios"])
    defaults = EvaluateOptions()
    chosen = replace(defaults, **kind).run_options()
    return defaults.run_options() | {name: chosen[name] for name in ("episodes", "minutes")}


def _words(value: Any) -> str:
    """Format the `value` of an option as on the command line; the items of a list are separated by spaces."""
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
