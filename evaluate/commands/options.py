"""Options of `python -m evaluate`."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from evaluate.hardware import HardwareConfig
from quad_env.cli.child_process import available_cores
from quad_env.cli.ray_option import RayOption

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
PROGRAM = "python -m evaluate"
WALKING_POLICIES = ("trot", "trot_feedback", "trot_integral", "residual", "robust")
DEFAULT_POLICIES = ("document@flat", "document_repaired@flat", *WALKING_POLICIES)
DEFAULT_BATTERY = ("default",)
EPISODES = {None: 20, "settled": 96}
"""Value of the option `--until` -> default number of episodes of each policy on each scenario.

A run with `--until settled` adds episodes until adjacent policies of the ranking are distinguished. For this run, the
value is the maximum number of episodes.
"""
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
    (payload=15+slope=10), batteries (quick, default, full, all), terrain files (hill.toml), or a quad_env.Scenario in
    my_file.py:NAME. The ending +randomised adds domain randomisation, +hardware the robot's hardware profile
    (push:3+hardware)."""
    hardware: Flag = False
    """Run every scenario with the robot's hardware profile: motors, delays, sensors and estimator of the real robot."""
    quick: Flag = False
    """Run the quick battery, as --scenarios quick does."""
    episodes: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: 20)")] = None
    """Episodes of 10 s of each policy on each scenario (count), the same episodes for every policy."""
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
        return ("quick",) if self.quick else self.scenarios

    @property
    def max_episodes(self) -> int:
        """Number of episodes of each policy on each scenario.

        A run with `--until settled` adds episodes until adjacent policies of the ranking are distinguished. For this
        run, the value is the maximum number of episodes.
        """
        return EPISODES[self.until] if self.episodes is None else self.episodes

    def run_options(self) -> dict[str, Any]:
        """Return the options that must not change when an interrupted run is resumed: name -> JSON value."""
        values = asdict(self) | {"episodes": self.max_episodes}
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
    defaults = EvaluateOptions().run_options()
    words = PROGRAM.split()
    for name, value in values.items():
        if value != defaults.get(name, False):
            words.append(f"--{name}")
            if isinstance(value, list):
                words += map(str, value)
            elif value is not True:
                words.append(str(value))
    return shlex.join(words)


def _words(value: Any) -> str:
    """Format the `value` of an option as on the command line; the items of a list are separated by spaces."""
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
