"""Settings of one training run: frozen dataclasses that are the command line, the help text and config.json at once."""

import dataclasses
import json
import types
import typing
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from evaluate.rollouts.hardware import Hardware
from policies.history import Inputs
from policies.parameters import number
from quad_env.cli.command_line import UsageError
from quad_env.config import RewardWeights
from quad_env.files.reading import read_bytes
from quad_env.scenarios.named import scaled_name
from train.reward_term import FileTerm
from train.run_folder import CONFIG_FILE


def _whole(words: list[str]) -> int:
    value = float(words[0])
    if not value.is_integer():
        raise ValueError(f"{words[0]} is no whole number")
    return int(value)


Count = Annotated[
    int,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=_whole,
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    ),
]
"""A whole number that may be written as 1e6."""
OwnTerm = Annotated[
    FileTerm,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="FILE.py:FUNCTION=WEIGHT",
        instance_from_str=lambda words: FileTerm.parse(words[0]),
        is_instance=lambda value: isinstance(value, FileTerm),
        str_from_instance=lambda value: [str(value)],
    ),
]
"""A reward term in a user's file."""


def weights(words: Sequence[str]) -> RewardWeights:
    """The default weights with those of `NAME=WEIGHT` words. Raises ValueError."""
    names, changed = [each.name for each in dataclasses.fields(RewardWeights)], dict[str, float]()
    for word in words:
        name, _, value = word.partition("=")
        if (field := name.replace("-", "_")) not in names:
            raise ValueError(f"there is no reward term {name!r}; valid: {', '.join(names)}")
        changed[field] = float(value)
    return dataclasses.replace(REWARDS, **changed)


def weight_words(rewards: RewardWeights) -> list[str]:
    """The inverse of `weights`."""
    return [f"{name.replace('_', '-')}={weight}" for name, weight in dataclasses.asdict(rewards).items()]


Weights = Annotated[
    RewardWeights,
    PrimitiveConstructorSpec(
        nargs="*",
        metavar="NAME=WEIGHT [NAME=WEIGHT ...]",
        instance_from_str=weights,
        is_instance=lambda value: isinstance(value, RewardWeights),
        str_from_instance=weight_words,
    ),
]
PolicyKind = Literal["residual", "end-to-end"]
BaseName = Literal[
    "bound",
    "crouch",
    "document",
    "document_repaired",
    "gaits",
    "mpc",
    "mpc_wbc",
    "pace",
    "pronk",
    "stand",
    "trot",
    "trot_feedback",
    "trot_integral",
    "walk",
]
"""A name of `policies.residual_bases.BASES`; written out, so that --help lists them at once."""

LARGEST_SEED = 2**32 - 1
_LOG_STD = (-20.0, 2.0)


TIMESTEP = 0.005
"""Physics step in training, s; half the time of the robot's own 2 ms, by which validation and evaluation go."""
PUSHES = 4
"""Pushes in a training episode of a scenario that has any."""
ACTIVATION = "elu"
"""Of the hidden layers."""
MIXTURE = (
    ("flat", 0.09),
    ("flat=3", 0.06),
    ("push=55", 0.12),
    ("rough=0.2", 0.12),
    ("stairs=0.15", 0.05),
    ("soft=0.03", 0.05),
    ("slope=20", 0.06),
    ("slippery=0.1", 0.05),
    ("latency=0.03", 0.05),  # without it robots trained on 0.08 are worse here than their base
    ("latency=0.08", 0.06),
    ("noise=0.8", 0.04),
    ("dropout=0.8", 0.03),
    ("payload=20", 0.07),
    ("force=60", 0.06),
    ("slow_motors=2", 0.05),
    ("weak_motors=10", 0.03),
    ("surprise=1.5", 0.08),
)
"""Every axis at a severity where the base starts to fail, or just beyond, and a small delay; each with its share of the
robots."""
MEMORY = Inputs(lags=(0.04, 0.08, 0.16), averages=(0.5, 2.0))
"""Past observations in which delays, loads, forces and slow motors can be recognised."""
REWARDS = RewardWeights(linear_velocity_error=-0.6, yaw_rate_error=-0.3, fall=-5.0)
"""The environment's, and a slope where the robot is so far off its command that the tracking rewards are flat. A second
there costs about 1: less than a fall, or falling would earn more."""


@dataclasses.dataclass(frozen=True)
class PpoConfig:
    """The learner."""

    envs: int = number(1024, limits=(1, 65_536))
    """Robots simulated together."""
    rollout_steps: int = number(24, limits=(1, 65_536))
    """Steps of the learner between two updates, each of `hold` control steps of 10 ms."""
    minibatch: int = number(4096, limits=(2, 2**24))  # advantages are normalised within one
    """Samples in one gradient step; must divide envs x rollout-steps."""
    epochs: int = number(3, limits=(1, 1000))
    """Passes over each rollout."""
    learning_rate: float = number(1e-3, limits=(1e-9, 1.0))
    """Adam's step size at the start."""
    learning_rate_schedule: Literal["linear", "constant", "adaptive"] = "linear"
    """linear: down to zero at the last step; adaptive: halved or raised to keep the KL divergence near target-kl."""
    target_kl: float = number(0.015, limits=(1e-6, 10.0))
    """KL divergence of one update that the adaptive schedule steers towards, nat."""
    hold: int = number(2, limits=(1, 1000))
    """Control steps for which a correction is held, in training and in the policy."""
    gamma: float = number(0.98, limits=(0.0, 1.0))
    """Discount a step of the learner."""
    gae_lambda: float = number(0.95, limits=(0.0, 1.0))
    """Lambda of the generalised advantage estimate."""
    entropy: float = number(0.0, limits=(0.0, 10.0))
    """Weight of the entropy bonus."""
    log_std_init: float = number(-1.2, limits=_LOG_STD)
    """Logarithm of the exploration noise at the start, in units of the authority. Over trot_feedback, which reacts to
    the noise, -2.3 and a learning rate of 4e-4 learn more."""
    log_std_final: float | None = number(None, limits=_LOG_STD)
    """Its value at the last step, reached linearly; the noise is learned when not given."""
    actor: tuple[int, ...] = (128, 128)
    """Hidden layer widths of the policy's network."""
    critic: tuple[int, ...] = (128, 128)
    """Hidden layer widths of the value network."""


@dataclasses.dataclass(frozen=True)
class ValidationConfig:
    """Evaluation during training, by the code of `evaluate`, on episodes of its own."""

    interval: Count = number(1_000_000, limits=(0, 10**12))
    """Steps between two validations; 0 for none but the last."""
    episodes: int = number(12, limits=(1, 100_000))
    """Episodes a scenario."""
    scenarios: tuple[str, ...] = ()
    """Scenarios of the validation; those trained on when not given."""


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """Train a policy for SimpleQuad-v0 with PPO: a bounded correction on a base policy, or one without a base."""

    policy: PolicyKind = "residual"
    """residual: a correction of --base. end-to-end: the same learner on a pose, crouch or stand."""
    base: BaseName = "trot_integral"
    """Base policy that the correction is added to."""
    steps: Count = number(5_000_000, limits=(1, 10**12 - 1))  # a checkpoint's name has twelve digits
    """Steps of the learner, all robots together, such as 3e6. With --resume a larger number than before extends the
    run; its schedules continue as in a run of that length, though the weights are not that run's to the bit."""
    seed: int = number(0, limits=(0, LARGEST_SEED))  # NumPy's global generator, which SB3 seeds, takes no other
    """Seed of the network, the noise and the training episodes (never shared with validation or evaluation)."""
    seeds: int = number(1, limits=(1, 1000))
    """Number of runs, with --seed and the seeds after it. Several are in folders seed-NUMBER of --out or runs/POLICY,
    which `python -m evaluate` takes for seeds of one run; with --resume finished ones stay as they are."""
    engine: Literal["local", "ray"] = "local"
    """Where seeds are trained: in this process one after the other, or on a Ray cluster (pip install -e ".[cluster]"),
    each on --threads cores. The policies are the same."""
    address: str | None = None
    """Address of the Ray cluster, such as 10.0.0.1:6379; without it one is started here and ended with the runs."""
    out: Path | None = None
    """Run folder, new or empty unless --resume; runs/POLICY-SEED when not given, for another robot than SimpleQuad
    runs/ROBOT-POLICY-SEED."""
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Continue the run in --out from its last checkpoint."""
    threads: int = number(2, limits=(1, 256))
    """Threads of the simulation; the learner needs one."""
    joint_authority: float = number(0.3, limits=(1e-3, 3.0))
    """Largest correction of a thigh or calf joint, rad."""
    hip_authority: float = number(0.15, limits=(0.0, 3.0))
    """Largest correction of a hip joint, rad."""
    foothold_authority: float = number(0.0, limits=(0.0, 0.5))
    """Largest shift of where the feet land, along each axis, m; 0 for none. Those of mpc and mpc_wbc can be shifted."""
    inputs: Inputs = MEMORY
    mixture: tuple[tuple[str, float], ...] = MIXTURE
    """Scenarios trained on, each with its share of the robots; payload=15+slope=10 is one too."""
    curriculum: float = number(0.4, limits=(0.0, 1.0))
    """Share of its severity, from the mildest level of its axis, with which each scenario of the mixture begins; it
    grows where the robots track their commands and shrinks where they do not. 1: full severity from the start."""
    max_episode_steps: int = number(1000, limits=(1, 1_000_000))
    """Length of a training episode, control steps."""
    robot: str = "simple_quad"
    """Robot that is trained: a name of quad_env.ROBOTS such as go1, or the path of its MJCF or TOML."""
    actuator: str = "ideal"
    """Motors in training and validation, one of quad_env.ACTUATORS: ideal, torque_speed or motor."""
    sensors: str = "truth"
    """Source of observations in training and validation: truth, or one of quad_env.SENSORS: ideal or typical. Rewards
    and the value network's extra inputs stay the truth."""
    estimator: str = "complementary"
    """Estimator of gravity and velocity from the sensors, one of quad_env.ESTIMATORS: complementary or kalman."""
    reward_terms: tuple[OwnTerm, ...] = ()
    """Your own reward terms: a function in a Python file, from the state of n robots to the term's n values; each
    control step is rewarded with weight x value x control period."""
    rewards: Weights = REWARDS
    """Weights of reward terms of `quad_env.task.rewards` by name, such as fall=-10 tilt=-1; the others stay."""
    ppo: PpoConfig = dataclasses.field(default_factory=PpoConfig)
    validation: ValidationConfig = dataclasses.field(default_factory=ValidationConfig)

    @property
    def folder(self) -> Path:
        """Run folder, or that of the folders of several seeds."""
        several = self.policy if self.seeds > 1 else f"{self.policy}-{self.seed}"
        of_robot = "" if self.robot == Hardware.robot else f"{Path(self.robot).stem}-"
        return self.out if self.out is not None else Path("runs") / f"{of_robot}{several}"

    @property
    def runs(self) -> "tuple[TrainConfig, ...]":
        """The settings of each seed's run."""
        if self.seeds == 1:
            return (self,)
        seeds = range(self.seed, self.seed + self.seeds)
        return tuple(dataclasses.replace(self, seed=n, seeds=1, out=self.folder / f"seed-{n}") for n in seeds)

    @property
    def hardware(self) -> Hardware:
        """Hardware of the robots."""
        return Hardware(self.actuator, self.sensors, self.estimator, self.robot)

    @property
    def complete_validation(self) -> ValidationConfig:
        """The validation with its scenarios: those given, or those trained on."""
        trained = tuple(name for name, share in self.mixture if share)
        return dataclasses.replace(self.validation, scenarios=self.validation.scenarios or trained)


DEFAULTS: dict[PolicyKind, TrainConfig] = {
    "residual": TrainConfig(),
    "end-to-end": TrainConfig(
        policy="end-to-end",
        base="crouch",
        joint_authority=1.0,
        hip_authority=0.4,
        steps=4_000_000,
        inputs=Inputs(clock=3.5),
        mixture=(("flat", 1.0),),
        curriculum=1.0,
        rewards=dataclasses.replace(REWARDS, foot_air_time=10.0),
        ppo=PpoConfig(
            envs=512,
            minibatch=1024,
            epochs=5,
            learning_rate=4e-4,
            learning_rate_schedule="adaptive",
            target_kl=0.02,
            gamma=0.97,
            log_std_init=-1.0,
            log_std_final=-2.5,
        ),
    ),
}
"""Defaults of each kind of policy."""


def likewise(config: TrainConfig, hardware: Hardware) -> TrainConfig:
    """SimpleQuad's settings for another robot: the same shares on scenarios as hard for it."""
    mixture = tuple((scaled_name(name, hardware.quadruped), share) for name, share in config.mixture)
    return dataclasses.replace(config, robot=hardware.robot, mixture=mixture)


_NOT_OF_THE_RUN = ("seeds", "engine", "address", "out", "resume", "threads")


def to_dict(config: TrainConfig) -> dict[str, Any]:
    """The settings that decide a run's result, as JSON types: all but where it is written and with how many threads."""
    settings = {key: value for key, value in dataclasses.asdict(config).items() if key not in _NOT_OF_THE_RUN}
    return typing.cast(dict[str, Any], json.loads(json.dumps(settings)))


_REMOVED: Mapping[str, Mapping[str, Any]] = {
    "": {"foot_authority": None, "space": "joints", "command_authority": 0.0, "shift_time": 0.0}
    | {"gait_authority": {"frequency": 0.0, "step_height": 0.0, "body_height": 0.0}}
    | {"pushes": PUSHES, "hardness": 1.0, "timestep": TIMESTEP},
    "ppo": {"overlap": False, "standardise": False, "symmetry": False, "privileged": True, "activation": ACTIVATION}
    | {"clip_range": 0.2, "reward_scale": 10.0, "value_weight": 0.5, "max_gradient": 1.0},
}
"""Settings of version 0.1.0, by group, and the only value with which a run still loads; None: any."""


def from_dict(settings: Mapping[str, Any]) -> TrainConfig:
    """The inverse of `to_dict`, of version 0.1.0 too. Raises UsageError on what is no configuration."""
    try:
        return typing.cast(TrainConfig, decode(TrainConfig, _of_today(settings)))
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UsageError(f"not a training configuration: {error}") from None


def _of_today(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Settings without those that were removed. Raises ValueError where a run depends on one of them."""
    found = {**settings, "ppo": dict(settings.get("ppo", {}))}
    for group, removed in _REMOVED.items():
        values = found[group] if group else found
        for name, only in removed.items():
            if values.pop(name, only) != only and only is not None:
                raise ValueError(f"{name} was removed after version 0.1.0")
    return found


def load_config(folder: Path) -> TrainConfig:
    """The settings of the run in `folder`. Raises UsageError where there is none."""
    try:
        settings = json.loads(read_bytes(folder / CONFIG_FILE))
    except OSError as error:
        raise UsageError(
            f"no run in {folder}: {CONFIG_FILE} cannot be read ({error.strerror}); name its folder with --out"
        ) from None
    except ValueError:
        raise UsageError(f"no run in {folder}: {CONFIG_FILE} is not JSON; name another folder with --out") from None
    return from_dict(settings)


def decode(kind: Any, value: Any) -> Any:
    """A value of that type, dataclasses among them, from JSON types. Raises an error of Python's for what is none."""
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        unknown = set(value) - set(hints)
        if unknown:
            raise ValueError(f"unknown settings {sorted(unknown)}")
        decoded = {name: decode(hints[name], entry) for name, entry in value.items()}
        return typing.cast(type[Any], kind)(**decoded)
    parts = typing.get_args(kind)
    if typing.get_origin(kind) is tuple:
        item, *rest = parts
        kinds = [item] * len(value) if rest == [Ellipsis] else [item, *rest]
        return tuple(decode(k, v) for k, v in zip(kinds, value, strict=True))
    if typing.get_origin(kind) is Literal:
        if value not in parts:
            raise ValueError(f"{value!r} is none of {', '.join(parts)}")
        return value
    if typing.get_origin(kind) is types.UnionType:  # with None
        return None if value is None else decode(parts[0], value)
    return kind(value)


class Change(NamedTuple):
    """A setting in which two runs differ, by its option."""

    option: str
    old: Any
    new: Any

    @property
    def extends(self) -> bool:
        """Whether the change only makes the run longer."""
        return self.option == "--steps" and self.new > self.old

    def __str__(self) -> str:
        return f"{self.option}: the run has {self.old}, the command {self.new}"


def differences(old: TrainConfig, new: TrainConfig) -> list[Change]:
    """Differences between two runs' settings, of those that decide the result."""
    after = dict(flat(to_dict(new)))
    return [Change(f"--{name}", value, after[name]) for name, value in flat(to_dict(old)) if value != after[name]]


def flat(settings: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings of `to_dict` by the names of their options, groups flattened."""
    for key, value in settings.items():
        name = prefix + key.replace("_", "-")
        if isinstance(value, dict):
            yield from flat(value, f"{name}.")
        else:
            yield name, value


def robots_per_scenario(config: TrainConfig) -> dict[str, int]:
    """Number of robots on each scenario: shares rounded by largest remainder, scenarios without robots left out."""
    total = sum(share for _, share in config.mixture)
    exact = [(name, share / total * config.ppo.envs) for name, share in config.mixture]
    counts = {name: int(amount) for name, amount in exact}
    by_remainder = sorted(exact, key=lambda entry: int(entry[1]) - entry[1])
    for name, _ in by_remainder[: config.ppo.envs - sum(counts.values())]:
        counts[name] += 1
    return {name: count for name, count in counts.items() if count}
