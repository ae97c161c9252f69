"""Options of `python -m evaluate`."""

import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from evaluate.hardware import HardwareConfig
from quad_env.cli.child_process import available_cores

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
PROGRAM = "python -m evaluate"
WALKING_POLICIES = ("trot", "trot_feedback", "trot_integral", "residual", "robust")
DEFAULT_POLICIES = ("document@flat", "document_repaired@flat", *WALKING_POLICIES)
DEFAULT_BATTERY = ("default",)
EPISODES = {None: 20, "settled": 96}
"""Default number of episodes by `until`; the maximum in a run until settled."""
RESULT_NEUTRAL_OPTIONS = ("out", "threads", "at_once", "resume", "baseline", "trust")
"""Options that --resume may change."""


@dataclass(frozen=True)
class EvaluateOptions:
    """Policies and scenarios to compare, and the folder of the results."""

    policies: tuple[str, ...] = DEFAULT_POLICIES
    """Names of policies, or folders of trained ones such as models/residual; document@flat runs on that scenario alone.
    Or one of yours: my_file.py:MyPolicy, an .onnx file, a .zip of Stable-Baselines3 (with --trust), or a deployment
    file of another project, such as deploy.yaml."""
    trust: Flag = False
    """Load policies from files that can hide code: a .zip of Stable-Baselines3, TorchScript .pt."""
    scenarios: tuple[str, ...] = DEFAULT_BATTERY
    """Names of scenarios such as push, levels of severity such as push:3 or push:all, severities in their axes' units
    such as push=42 or, together, payload=15+slope=10, a battery (quick, default, full, all), a terrain of yours,
    hill.toml, or a quad_env.Scenario in a file of yours, my_file.py:NAME; each with +randomised at its end for domain
    randomisation, with +hardware for the robot's hardware profile, as push:3+hardware."""
    hardware: Flag = False
    """Every scenario with the robot's hardware profile: motors, delays, sensors and estimator like the real ones."""
    quick: Flag = False
    """The quick battery, for a first look: --scenarios quick."""
    episodes: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: 20)")] = None
    """Episodes of 10 s of each policy on each scenario (count). The same for every policy."""
    until: Literal["settled"] | None = None
    """settled: simulate a quarter of --episodes (then by default 96) at a time, until every two neighbours in the
    ranking are distinguished, or hardly can be: a group-sequential test with one error rate for all looks."""
    robot: str = "simple_quad"
    """Robot of every policy: a name of quad_env.ROBOTS such as go1, or the path of its MJCF, URDF or TOML."""
    servo: str = ""
    """Stiffness/damping of the servos for every controller of ours, N·m/rad and N·m·s/rad, such as 35/0.5. By default
    each policy commands its own; policies from outside always do."""
    actuator: str = "ideal"
    """Motors of the joints, one of quad_env.ACTUATORS: ideal, torque_speed or motor."""
    sensors: str = "truth"
    """Source of the observations: truth, or one of quad_env.SENSORS: ideal or typical."""
    estimator: str = "complementary"
    """Estimator of gravity and velocity from the sensors, one of quad_env.ESTIMATORS: complementary or kalman."""
    simulator: str = "mujoco"
    """Simulator of the physics: mujoco, or drake (pip install -e ".[drake]"; twelve times slower) with ideal motors
    and the true state, on flat, steady, push, force, slippery, slope, stairs, payload; of a battery it takes these."""
    seed: int = 0
    """Which set of episodes (whole number from 0). Training never sees any of them, whatever its own seed."""
    out: Path = Path("results/evaluation")
    """Folder for results.json, episodes.parquet, report.html and manifest.json; files of these names are replaced."""
    resume: Flag = False
    """Continue the interrupted run in the folder --out with its options, to the results of an uninterrupted run."""
    baseline: str | None = None
    """Policy to compare the others with; by default trot, or without it the policy named first."""
    threads: int = available_cores()
    """Worker processes that simulate side by side (count; default: this machine's cores). No result depends on it."""
    at_once: int = 256
    """Episodes that a process simulates and writes together (count). No result depends on it."""

    @property
    def hardware_config(self) -> HardwareConfig:
        """Hardware of the robots where a scenario does not bring the hardware profile."""
        return HardwareConfig(self.actuator, self.sensors, self.estimator, self.robot, self.servo, self.simulator)

    @property
    def battery(self) -> tuple[str, ...]:
        """Names of the scenarios."""
        return ("quick",) if self.quick else self.scenarios

    @property
    def max_episodes(self) -> int:
        """Maximum number of episodes of each policy on each scenario."""
        return EPISODES[self.until] if self.episodes is None else self.episodes

    def run_options(self) -> dict[str, Any]:
        """Return the options that --resume may not change, as JSON values."""
        values = asdict(self) | {"episodes": self.max_episodes}
        run_values = {name: value for name, value in values.items() if name not in RESULT_NEUTRAL_OPTIONS}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in run_values.items()}


def options_from_json(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields of EvaluateOptions from `values` of `run_options`; ValueError for another version."""
    names = {field.name for field in fields(EvaluateOptions)} - set(RESULT_NEUTRAL_OPTIONS)
    if set(values) != names:
        raise ValueError(f"its options are those of another version: {', '.join(sorted(set(values) ^ names))}")
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}


def describe_changes(then: EvaluateOptions, now: EvaluateOptions) -> list[str]:
    """Describe each option of a run that differs in `now` from `then`, as in `--seed was 0, not 1`."""
    before = then.run_options()
    after = now.run_options()
    return [
        f"--{name} was {_words(before[name])}, not {_words(after[name])}"
        for name in before
        if before[name] != after[name]
    ]


def command(values: Mapping[str, Any]) -> str:
    """Return the command of a run from `values` of `run_options`, without defaults."""
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
    """Return the text of an option's value on the command line."""
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
