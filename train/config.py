"""Settings of a training run: dataclasses for the command line, its help text and config.json."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evaluate import hardware
from evaluate.hardware import HardwareConfig
from policies.history import Inputs
from policies.parameters import limits_of, parameter
from quad_env.actuation.models import find_actuator
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.ray_option import RayOption
from quad_env.config import PhysicsOptions, RewardWeights, TaskConfig
from quad_env.physics.simulators import WARP, check_simulator
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario
from quad_env.sensing.height_scan import HeightScan
from quad_env.sensing.sensor_models import Channel
from quad_env.task.rewards import user_rewards
from train import deployable
from train.deployable import Observations

PolicyKind = Literal["residual", "end-to-end"]
RecipeName = Literal["default", "joystick", "improve"]
BaseName = Literal[
    "bound", "crouch", "document", "document_repaired", "gaits", "mpc", "mpc_wbc", "mpc_wbc_sighted", "pace", "pronk",
    "stand", "trot", "trot_feedback", "trot_integral", "trot_reference", "walk",
]  # fmt: skip
"""Name of a base policy in `policies.residual_bases.BASES`.

The names are repeated here, so that --help can list them without a slow import."""

POSES: tuple[BaseName, ...] = ("crouch", "stand")
"""Names of the base policies on which an end-to-end policy can be trained. Each of them only holds a fixed pose."""
MAX_REWARD_WEIGHT = 1e4
"""Largest absolute value that the command accepts as the weight of a reward term."""
MAX_SHARE = 1e6
"""Largest share of a scenario in the option --mixture. A share is a relative weight.

The shares are divided by their sum, and the quotient is the fraction of the robots that train on the scenario."""
MAX_HIDDEN_LAYERS = 8
"""Largest number of hidden layers of a network in a policy bundle."""
MAX_ROLLOUT_SAMPLES = 2**24
"""Largest number of samples of a PPO rollout: robots times steps per rollout, `envs` * `rollout_steps`."""
MAX_SEED = 2**32 - 1
"""Largest seed of a training run.

Stable-Baselines3 (SB3) passes the seed to the global random generator of NumPy, which accepts no larger seed."""
_LOG_STD_LIMITS = (-20.0, 2.0)
_WIDTH_LIMITS = {"limits": (1, 4096)}
CONTROL_PERIOD = 1.0 / TaskConfig.control_rate
"""Time between two actions of a policy in training, s."""
TIMESTEP = 0.005
"""Default physics time step in training, s. Validation and evaluation use the time step of the robot, 0.002 s."""
SOLVER_ITERATIONS = 4
"""Default limit of the iterations of MuJoCo's contact solver per physics step in training.

Validation and evaluation use the number of the robot model, 30, and a shorter time step. A control step then takes
three to four times as long as with `TIMESTEP` and `SOLVER_ITERATIONS`."""
MIXTURE = (
    ("flat:2", 0.05), ("flat:4", 0.06), ("push:3", 0.20), ("rough:3", 0.12), ("stairs:3", 0.08), ("gravel:3", 0.07),
    ("soft:4", 0.03), ("slope:4", 0.05), ("slippery:4", 0.03), ("latency:2", 0.02), ("latency:4", 0.03),
    ("noise:4", 0.02), ("dropout:4", 0.02), ("payload:4", 0.07), ("force:3", 0.07), ("slow_motors:4", 0.05),
    ("weak_motors:4", 0.04), ("surprise:3", 0.06),
)  # fmt: skip
"""Default scenarios of the training, each with the fraction of the robots that train on it.

A name such as `push:3` means level 3 of the disturbance axis `push`; a higher level is more severe. Each axis is
included one or two levels above its nominal level, the level of the name without a number. The small delay of
`latency:2` is included, because robots that train only on a delay of 0.08 s perform worse than their base policy at
0.03 s."""
REWARDS = RewardWeights(
    linear_velocity_error=-0.6, yaw_rate_error=-0.3, crouch=-3.0, action_rate=-0.05, mechanical_power=-0.0025, fall=-5.0
)
"""Default reward weights of the training: the environment's defaults, linear error terms, and effort terms.

The tracking rewards of the environment have almost no gradient if the velocity error is large. The linear error terms
have a gradient at every velocity error. A large velocity error costs about 1 per second. A fall costs more, because a
robot would otherwise learn to fall.
"""
EFFORT_TERMS = ("action_rate", "torque", "mechanical_power", "touchdown_speed")
"""Names of the reward terms that penalise effort.

Their weights grow linearly from zero at the start of a training run to their full values, see
`TrainConfig.effort_ramp`."""
HISTORY_INPUTS = Inputs(lags=(0.04, 0.08, 0.16), averages=(0.5, 2.0))
"""Default inputs of the network in addition to the current observation: past and averaged observations.

`lags` are the ages of single past observations, and `averages` the time constants of exponential averages, s. From
these inputs the network can recognise delays, payloads, external forces and slow motors."""


@dataclasses.dataclass(frozen=True)
class PpoConfig:
    """Settings of PPO (proximal policy optimisation), the reinforcement-learning algorithm of the training."""

    envs: int = parameter(2048, limits=(1, 65_536))
    """Number of robots simulated together."""
    rollout_steps: int = parameter(12, limits=(1, 65_536))
    """Learner steps between two updates of the networks; a learner step is --ppo.hold control steps of 10 ms."""
    # A minibatch has at least 2 samples, because the advantages are divided by their standard deviation in it.
    minibatch: int = parameter(8192, limits=(2, 2**24))
    """Samples in one gradient step; must divide envs x rollout-steps."""
    epochs: int = parameter(3, limits=(1, 1000))
    """Number of passes over the samples of each rollout in an update."""
    learning_rate: float = parameter(1e-3, limits=(1e-9, 1.0))
    """Learning rate of the Adam optimiser at the start of the run."""
    learning_rate_schedule: Literal["linear", "constant", "adaptive"] = "adaptive"
    """Change of the learning rate during the run. linear: to learning-rate-final at the last step; constant: none;
    adaptive: lowered or raised to keep the KL divergence near target-kl."""
    learning_rate_final: float = parameter(0.0, limits=(0.0, 1.0))
    """Learning rate at the last step of the run, only for the linear schedule."""
    critic_learning_rate: float | None = parameter(None, limits=(1e-9, 1.0))
    """Constant learning rate of the value network; by default the learning rate of the policy network."""
    target_kl: float = parameter(0.012, limits=(1e-6, 10.0))
    """Target KL divergence of the policies before and after one update, for the adaptive schedule, nat."""
    hold: int = parameter(2, limits=(1, 1000))
    """Number of control steps of 10 ms for which a correction is held, in training and in the trained policy."""
    gamma: float = parameter(0.98, limits=(0.0, 1.0))
    """Discount factor per learner step, 0 to 1."""
    gae_lambda: float = parameter(0.95, limits=(0.0, 1.0))
    """Lambda of the generalised advantage estimation (GAE), 0 to 1."""
    entropy: float = parameter(0.0, limits=(0.0, 10.0))
    """Weight of the entropy bonus in the PPO loss."""
    log_std_init: float = parameter(-2.0, limits=_LOG_STD_LIMITS)
    """Natural logarithm of the standard deviation of the exploration noise at the start of the run. The noise is a
    fraction of --joint-authority or --hip-authority."""
    critic_steps: int = parameter(0, limits=(0, 10**12))
    """Number of learner steps at the start in which only the value network learns, so that it does not spoil the
    network of --start."""
    cloning: float = parameter(0.0, limits=(0.0, 1e3))
    """Weight of the cloning loss at the start: the KL divergence of the policy from the network of --start, nat."""
    cloning_steps: int = parameter(5_000_000, limits=(1, 10**12))
    """Number of learner steps in which the weight of the cloning loss falls linearly to --ppo.cloning-final."""
    cloning_final: float = parameter(0.0, limits=(0.0, 1e3))
    """Weight of the cloning loss after --ppo.cloning-steps."""
    log_std_final: float | None = parameter(None, limits=_LOG_STD_LIMITS)
    """Natural logarithm of the standard deviation of the exploration noise at the last step, to which it changes
    linearly; by default the standard deviation is learned."""
    actor: tuple[int, ...] = dataclasses.field(default=(128, 128), metadata=_WIDTH_LIMITS)
    """Numbers of units in the hidden layers of the policy network."""
    critic: tuple[int, ...] = dataclasses.field(default=(128, 128), metadata=_WIDTH_LIMITS)
    """Numbers of units in the hidden layers of the value network."""
    symmetry: Literal["none", "actor", "actor-critic"] = "none"
    """Networks with left-right mirror symmetry; needs --base crouch or stand and no --sighted. The policy network in
    the bundle then has hidden layers of twice the width."""
    normalization: Literal["none", "running"] = "none"
    """running: divide the network inputs by their running standard deviation, after their running mean is subtracted;
    none: only the fixed scales of the observation."""


@dataclasses.dataclass(frozen=True)
class ValidationConfig:
    """Settings of the validation: evaluations of the policy during the training, on separate episodes."""

    interval: int = parameter(1_000_000, limits=(0, 10**12))
    """Learner steps, summed over the robots, between two validations; 0: validate only at the end of the run."""
    episodes: int = parameter(12, limits=(1, 100_000))
    """Number of validation episodes per scenario."""
    scenarios: tuple[str, ...] = ()
    """Scenarios of the validation; by default the scenarios of the training."""


@dataclasses.dataclass(frozen=True)
class TrainConfig:
    """Train a policy for SimpleQuad-v0 with PPO: a bounded correction on a base policy, or one without a base."""

    policy: PolicyKind = "residual"
    """residual: the network corrects the policy --base. end-to-end: the network moves the robot without a gait of a
    base policy; --base is a fixed pose, crouch or stand."""
    recipe: RecipeName = "default"
    """Set of default values of all other options. joystick: --robot go1 learns to walk from scratch in minutes; only
    for --policy end-to-end. improve: --start is a network that walks already, for example a student of --teacher, and
    learns to resist harder disturbances."""
    base: BaseName = "trot_reference"
    """Base policy that the correction is added to."""
    # The upper limit is 10**12 - 1, because the file name of a checkpoint has twelve digits for the number of steps.
    steps: int = parameter(10_000_000, limits=(1, 10**12 - 1))
    """Number of learner steps of the run, summed over all robots, for example 3e6. With --resume a larger number
    extends the run; the extended run does not have exactly the same weights as a new run of that length."""
    seed: int = parameter(0, limits=(0, MAX_SEED))
    """Seed of the network, the noise and the training episodes (never shared with validation or evaluation)."""
    seeds: str | None = None
    """Several seeds in place of --seed, one run after the other: a range such as 0-4, or a list such as 0,3,7. Each
    seed has its own run folder, POLICY-SEED in --out. With --resume, finished runs are skipped and stopped runs are
    continued."""
    part: str | None = None
    """Train only the K-th of N equal shares of --seeds, such as 2/5; other machines train the other shares."""
    ray: RayOption = None
    """Train --seeds on a Ray cluster (pip install -e ".[cluster]"), each on --threads cores: at HOST:PORT, or without a
    value on a cluster that is started on this machine. The trained policies do not depend on it."""
    out: Path | None = None
    """Run folder, new or empty unless --resume; by default runs/POLICY-SEED, or runs/ROBOT-POLICY-SEED for another
    robot than SimpleQuad."""
    start: Path | None = None
    """Folder of a policy bundle or a run with the initial network; by default the initial correction is zero. This
    policy defines the defaults of --base, --inputs, authorities and network widths. The value network and the
    exploration noise of a run of PPO are loaded too."""
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Continue the run in --out from its last checkpoint."""
    threads: int = parameter(2, limits=(1, 256))
    """Number of threads of the simulation; the learner uses one thread."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Processor of simulation and network; cuda: an NVIDIA GPU, with MuJoCo Warp (pip install -e ".[warp]"). Validation
    always runs MuJoCo on the CPU."""
    joint_authority: float = parameter(1.0, limits=(1e-3, 3.0))
    """Largest correction of a thigh or calf joint, rad."""
    hip_authority: float = parameter(0.6, limits=(0.0, 3.0))
    """Largest correction of a hip joint, rad."""
    correction: Literal["bounded", "scaled"] = "bounded"
    """bounded: corrections are clipped to --joint-authority and --hip-authority; scaled: corrections are not clipped,
    and the authorities are only the unit of the network's output."""
    clock_phase: Literal["zero", "random"] = "zero"
    """Phase of the network's clock input, --inputs.clock, at the start of a training episode: zero, or drawn at
    random."""
    inputs: Inputs = HISTORY_INPUTS
    observations: Observations = "all"
    """Observations of the policy. all: the whole observation. deployable: quantities that a robot measures, without
    linear velocity, for robots on their hardware profile; estimated: these and the estimated linear velocity. Both need
    --policy end-to-end, and change the defaults of --inputs, --mixture and --validation.scenarios. The value network
    then observes the true state."""
    sighted: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Give the network a height scan of the ground around the robot, see --scan."""
    scan: HeightScan = dataclasses.field(default_factory=HeightScan)
    mixture: tuple[tuple[str, float], ...] = MIXTURE
    """Scenarios of the training, each with its share of the robots. Scenarios can be combined, as in
    payload=15+slope=10; the suffix +randomised adds domain randomisation."""
    commands: Literal["scenario", "random"] = "scenario"
    """scenario: a new velocity command every 5 s. random: new commands at random times, every 5 s on average, in which
    each component can also be zero or unchanged."""
    kicks: float = parameter(0.0, limits=(0.0, 10.0))
    """Largest velocity change of a robot by a kick, m/s; 0: no kicks. A kick is a horizontal force for 0.05 to 0.2 s,
    every 1 to 3 s."""
    physics: PhysicsOptions = dataclasses.field(default_factory=PhysicsOptions)
    timestep: float | None = parameter(TIMESTEP, limits=(1e-4, CONTROL_PERIOD))
    """Physics time step in training, s; a control step is a whole number of them. None: value of the robot model."""
    solver_iterations: int | None = parameter(SOLVER_ITERATIONS, limits=(1, 1000))
    """Largest number of iterations of the contact solver per physics step in training, only with --device cpu. None:
    value of the robot model."""
    curriculum: float = parameter(0.1, limits=(0.0, 1.0))
    """Initial difficulty of each scenario of the mixture, 0 (mildest level of its axis) to 1 (full severity). The
    difficulty rises if the robots track their commands, and falls if they do not. 1: full severity from the start."""
    effort_ramp: float = parameter(0.25, limits=(0.0, 1.0))
    """Fraction of the run during which the reward weights of effort (action rate, torque, power, touch-down speed) grow
    from zero. The weights change whenever all robots start new episodes, by default every million steps. 0: full
    weights from the start."""
    max_episode_steps: int = parameter(1000, limits=(1, 1_000_000))
    """Length of a training episode, control steps."""
    robot: str = "simple_quad"
    """Robot that is trained: a name of quad_env.ROBOTS like go1, or the path of its MJCF, URDF or TOML."""
    servo: str = ""
    """Stiffness/damping of the servos in training and validation, N·m/rad and N·m·s/rad, for example 35/0.5, or stiff,
    the gains that the scripted controllers need. By default the gains of the base policy, or with --policy end-to-end
    the gains of the robot's manufacturer."""
    actuator: str = "ideal"
    """Motors in training and validation, one of quad_env.ACTUATORS: ideal, torque_speed or motor."""
    sensors: str = "truth"
    """Source of observations in training and validation: truth, or one of quad_env.SENSORS: ideal or typical. Rewards
    and the extra inputs of the value network always use the true state."""
    estimator: str = "complementary"
    """Estimator of gravity and velocity from the sensors, one of quad_env.ESTIMATORS: complementary or kalman."""
    rewards: RewardWeights = REWARDS
    reward_floor: float | None = parameter(None, limits=(-1e6, 1e6))
    """Lower bound of the reward of a learner step, before rewards are scaled for PPO; by default there is none."""
    extension_rewards: tuple[tuple[str, float], ...] = ()
    """Reward terms of installed extensions, each with its weight per second, for example height_error -2."""
    ppo: PpoConfig = dataclasses.field(default_factory=PpoConfig)
    validation: ValidationConfig = dataclasses.field(default_factory=ValidationConfig)

    @property
    def folder(self) -> Path:
        """Folder for all files of the training run: the option `out`, or the default folder if `out` is None."""
        prefix = "" if self.robot == HardwareConfig.robot else f"{Path(self.robot).stem}-"
        return self.out if self.out is not None else Path("runs") / f"{prefix}{self.policy}-{self.seed}"

    @property
    def hardware(self) -> HardwareConfig:
        """Robot, servo gains, motor model, sensors and estimator of the run, as one object of the evaluator."""
        return HardwareConfig(self.actuator, self.sensors, self.estimator, self.robot, self.servo)

    @property
    def height_scan(self) -> HeightScan | None:
        """Height scan of the ground that the network observes with --sighted.

        Without --sighted the property is None, and the robot has a height scan only if the base policy needs one.
        """
        return self.scan if self.sighted else None

    @property
    def complete_validation(self) -> ValidationConfig:
        """Validation settings in which an empty list of scenarios is replaced by the scenarios of the training."""
        trained = tuple(name for name, share in self.mixture if share)
        return dataclasses.replace(self.validation, scenarios=self.validation.scenarios or trained)


_END_TO_END = TrainConfig(
    policy="end-to-end", base="crouch", joint_authority=1.0, hip_authority=0.4, steps=4_000_000,
    inputs=Inputs(clock=3.5), mixture=(("flat", 1.0),), curriculum=1.0, effort_ramp=0.0,
    rewards=RewardWeights(linear_velocity_error=-0.6, yaw_rate_error=-0.3, foot_air_time=10.0, fall=-5.0),
    ppo=PpoConfig(
        envs=512, rollout_steps=24, minibatch=1024, epochs=5, learning_rate=4e-4, target_kl=0.02, gamma=0.97,
        log_std_init=-1.0, log_std_final=-2.5,
    ),
)  # fmt: skip
JOYSTICK_REWARDS = RewardWeights(
    linear_velocity_tracking=0.6, yaw_rate_tracking=0.24, gait=0.4, pose=0.1, tilt=-1.0, vertical_velocity=-0.1,
    roll_pitch_rate=-0.01, joint_limits=-0.2, action_rate=-0.016, touchdown_speed=-0.4, mechanical_power=-0.0002,
    torque=0.0, fall=0.0,
)  # fmt: skip
"""Reward weights of the recipe `joystick`.

The weights are modelled on the joystick task of MuJoCo Playground, with an additional reward for the gait."""
_JOYSTICK = TrainConfig(
    policy="end-to-end", recipe="joystick", robot="go1", base="stand", steps=6_000_000,
    joint_authority=0.5, hip_authority=0.5, correction="scaled", inputs=Inputs(clock=2.0, clock_at_rest="hidden"),
    clock_phase="random", mixture=(("flat", 1.0),), commands="random", curriculum=1.0, effort_ramp=0.0,
    physics=PhysicsOptions(contacts="feet", joint_friction="none"), rewards=JOYSTICK_REWARDS, reward_floor=0.0,
    ppo=PpoConfig(
        envs=1024, rollout_steps=24, minibatch=6144, epochs=5, learning_rate=1e-3, learning_rate_schedule="linear",
        learning_rate_final=5e-4, gamma=0.99, entropy=0.005, log_std_init=-0.7, symmetry="actor",
        normalization="running",
    ),
)  # fmt: skip
IMPROVE_MIXTURE = (
    ("flat:2", 0.05), ("flat:4", 0.05), ("push:3", 0.10), ("push:4", 0.05), ("rough:4", 0.06), ("force:3", 0.06),
    ("force:4", 0.03), ("slope:5", 0.05), ("stairs:3", 0.06), ("stairs:4", 0.03), ("gravel:4", 0.05), ("soft:5", 0.03),
    ("slippery:4", 0.03), ("payload:4", 0.04), ("weak_motors:4", 0.03), ("slow_motors:4", 0.03), ("latency:4", 0.04),
    ("noise:4", 0.03), ("dropout:5", 0.03), ("surprise:3", 0.04), ("flat:3+hardware", 0.02), ("push:3+hardware", 0.04),
    ("rough:3+hardware", 0.03), ("force:3+hardware", 0.04), ("stairs:3+hardware", 0.03), ("gravel:3+hardware", 0.03),
    ("latency:3+hardware", 0.02), ("surprise:2+hardware", 0.02),
)  # fmt: skip
"""Scenarios of the recipe `improve`, each with the fraction of the robots that train on it.

Every disturbance axis is included at a level at which a student of a model-based controller often fails."""
_IMPROVE = TrainConfig(
    policy="end-to-end", recipe="improve", base="stand", steps=8_000_000, mixture=IMPROVE_MIXTURE, curriculum=1.0,
    effort_ramp=0.0, rewards=REWARDS,
    ppo=PpoConfig(
        envs=2048, rollout_steps=12, minibatch=8192, epochs=3, learning_rate=2e-5,
        critic_learning_rate=5e-4, target_kl=0.01,
        hold=2, gamma=0.99, log_std_init=-3.0, log_std_final=-3.9, critic=(256, 128), critic_steps=400_000, cloning=0.1,
        cloning_steps=3_000_000, normalization="running",
    ),
    validation=ValidationConfig(
        interval=1_000_000, episodes=16,
        scenarios=(
            "flat", "push:3", "rough:3", "force:3", "slope:5", "stairs:3", "latency:4", "surprise:3",
            "push:3+hardware", "force:3+hardware",
        ),
    ),
)  # fmt: skip
DEFAULTS: dict[PolicyKind, TrainConfig] = {"residual": TrainConfig(), "end-to-end": _END_TO_END}
"""Kind of policy, "residual" or "end-to-end" -> its default settings of a training run."""
RECIPES: dict[RecipeName, TrainConfig] = {"joystick": _JOYSTICK, "improve": _IMPROVE}
"""Name of a recipe -> its default settings of a training run.

The recipe `default` is missing here, because its settings depend on the kind of policy, see `DEFAULTS`."""


def default_settings(given: TrainConfig) -> TrainConfig:
    """Return the default settings of a training run for the policy, the recipe and the robot that `given` names.

    Raises UsageError if the recipe is for another kind of policy.
    """
    if given.recipe == "default":
        settings = dataclasses.replace(DEFAULTS[given.policy], robot=given.robot)
        return with_observations(settings, given.observations)
    recipe = RECIPES[given.recipe]
    if given.policy != recipe.policy:
        raise UsageError(f"--recipe {given.recipe} is for --policy {recipe.policy}")
    settings = recipe if given.robot == HardwareConfig.robot else dataclasses.replace(recipe, robot=given.robot)
    return with_observations(settings, given.observations)


def with_observations(settings: TrainConfig, observations: Observations) -> TrainConfig:
    """Return default settings of a training run for a value of the option --observations.

    Args:
        settings: Default settings of a run with all observations.
        observations: Value of `--observations`.

    Returns:
        The settings. Unless the value is all, inputs, scenarios and the time of an action suit a policy for robots.

    Raises:
        UsageError: The policy corrects a base policy, which has all observations.
    """
    if observations == "all":
        return settings
    if settings.policy != "end-to-end":
        raise UsageError(f"--observations: {observations} needs --policy end-to-end, got {settings.policy}")
    return dataclasses.replace(
        settings,
        observations=observations,
        inputs=deployable.deployable_inputs(observations, settings.inputs),
        mixture=deployable.hardware_mixture(settings.mixture),
        ppo=dataclasses.replace(settings.ppo, hold=deployable.HOLD),
        validation=dataclasses.replace(
            settings.validation, scenarios=deployable.hardware_scenarios(settings.validation.scenarios)
        ),
    )


def check(config: TrainConfig) -> None:
    """Check that the settings of a training run are valid and fit together.

    Args:
        config: Settings of the training run.

    Raises:
        UsageError: A setting is not valid. The message is one line that names the option.
    """
    for group, settings in (("", config), ("ppo.", config.ppo), ("validation.", config.validation)):
        check_numbers(settings, limits_of(settings), group)
    terms = [term.name for term in dataclasses.fields(config.rewards)]
    check_numbers(config.rewards, dict.fromkeys(terms, (-MAX_REWARD_WEIGHT, MAX_REWARD_WEIGHT)), "rewards.")
    _check_extension_rewards(config)
    if max(len(config.ppo.actor), len(config.ppo.critic)) > MAX_HIDDEN_LAYERS:
        raise UsageError(f"--ppo.actor and --ppo.critic must be at most {MAX_HIDDEN_LAYERS} widths")
    total = config.ppo.envs * config.ppo.rollout_steps
    if total % config.ppo.minibatch or total > MAX_ROLLOUT_SAMPLES:
        fact = f"--ppo.minibatch, {config.ppo.minibatch}, must divide ppo.envs x ppo.rollout-steps, {total}"
        raise UsageError(f"{fact}, which must be at most {MAX_ROLLOUT_SAMPLES}")
    try:
        hardware.check_hardware(config.hardware)
    except ValueError as error:
        raise UsageError(str(error)) from None
    check_mixture(config.mixture, config.hardware.robot_model)
    check_scan_rate(config.scan)
    _check_physics_steps(config)
    if config.device == "cuda":
        _check_warp(config)
    check_scenarios("--validation.scenarios", config.complete_validation.scenarios, config.hardware.robot_model)
    _check_hardware_profile(config)
    if config.policy == "end-to-end" and config.base not in POSES:
        raise UsageError(f"--policy end-to-end learns on --base {' or '.join(POSES)}, not on {config.base}")
    _check_observations(config)
    if config.recipe == "improve" and config.start is None:
        raise UsageError("--recipe improve needs --start, the folder of a policy that walks")
    if config.ppo.symmetry != "none" and (config.base not in POSES or config.sighted):
        raise UsageError(f"--ppo.symmetry needs --base {' or '.join(POSES)}, without --sighted")


def check_scan_rate(scan: HeightScan) -> None:
    """Raise UsageError if the control rate is not an integer multiple of the sample rate of a height scan."""
    try:
        Channel(1, 1, scan.rate, scan.delay, 1.0 / CONTROL_PERIOD)
    except ValueError as error:
        raise UsageError(f"--scan.rate: {error}") from None


def _check_observations(config: TrainConfig) -> None:
    """Raise UsageError if the policy cannot have the observation terms of the settings."""
    deployable.check_observations(config.observations, config.inputs)
    if config.inputs.terms and config.policy != "end-to-end":
        raise UsageError(f"--inputs.terms: terms need --policy end-to-end, got {config.policy}")
    if config.inputs.terms and config.sighted:
        raise UsageError("--sighted: --inputs.terms have no height scan; leave one of them out")


def _check_hardware_profile(config: TrainConfig) -> None:
    """Raise UsageError if hardware options are given for a scenario with the robot's hardware profile.

    The profile defines the motors and sensors of the real robot, so that the options cannot choose other ones.
    """
    names = dict.fromkeys((*dict(config.mixture), *config.complete_validation.scenarios))
    on_profile = ", ".join(name for name in names if scenario(name, config.hardware.robot_model).hardware)
    if on_profile and config.hardware.is_customized:
        raise UsageError(
            f"{on_profile}: the profile has its own --actuator, --sensors and --estimator: leave these out"
        )


def _check_physics_steps(config: TrainConfig) -> None:
    """Raise UsageError if time step or solver iterations of the physics do not fit control period or simulator."""
    if config.timestep is not None:
        steps = round(CONTROL_PERIOD / config.timestep)
        if abs(steps * config.timestep - CONTROL_PERIOD) > 1e-9:
            fact = f"a control step of {CONTROL_PERIOD:g} s is no whole number of physics steps"
            valid = ", ".join(f"{CONTROL_PERIOD / count:g}" for count in (10, 5, 4, 2, 1))
            raise UsageError(f"--timestep: {fact}, got {config.timestep:g}; valid: {valid}")
    if config.device == "cuda" and config.solver_iterations != SOLVER_ITERATIONS:
        raise UsageError(f"--solver-iterations: valid with only --device cpu, got {config.solver_iterations}")


def _check_extension_rewards(config: TrainConfig) -> None:
    """Raise UsageError if a reward term in --extension-rewards is unknown, repeated, or has an invalid weight."""
    names = [name for name, _ in config.extension_rewards]
    if len(set(names)) < len(names):
        raise UsageError("--extension-rewards: a term is given twice")
    try:
        terms = user_rewards(dict(config.extension_rewards))
    except ValueError as error:
        raise UsageError(f"--extension-rewards: {error}") from None
    if any(abs(term.weight) > MAX_REWARD_WEIGHT for term in terms.values()):
        raise UsageError(f"--extension-rewards: weights are from {-MAX_REWARD_WEIGHT:g} to {MAX_REWARD_WEIGHT:g}")


def check_mixture(mixture: Sequence[tuple[str, float]], robot: Robot) -> None:
    """Check the scenarios of a training and their shares of the robots.

    Args:
        mixture: Value of --mixture: name and share of each scenario.
        robot: Robot of the training, which must support the scenarios.

    Raises:
        UsageError: A scenario does not exist or is repeated, a share is negative or too large, or all shares are zero.
    """
    shares = [share for _, share in mixture]
    check_scenarios("--mixture", [name for name, _ in mixture], robot)
    if not all(0 <= share <= MAX_SHARE for share in shares):
        raise UsageError(f"--mixture needs shares that are not negative and at most {MAX_SHARE:g}, as in: flat 0.5")
    # The shares are divided by their sum. The bound 1e-6 keeps the quotients finite; meaningful shares are larger.
    if sum(shares) < 1e-6:
        raise UsageError("--mixture: at least one share must be above zero")


def _check_warp(config: TrainConfig) -> None:
    """Raise UsageError if MuJoCo Warp, the simulator of --device cuda, cannot simulate a scenario in --mixture."""
    try:
        for name, share in config.mixture:
            if share:
                each = scenario(name, config.hardware.robot_model)
                check_simulator(
                    WARP, each, find_actuator(config.actuator), sensors=config.sensors != HardwareConfig.sensors
                )
    except ValueError as error:
        raise UsageError(f"--device cuda: {error}") from None


def check_scenarios(option: str, names: Sequence[str], robot: Robot = SIMPLE_QUAD) -> None:
    """Check the list of scenario names that a user gave for a command-line option.

    Args:
        option: Name of the option, with dashes.
        names: Names of the scenarios.
        robot: Robot to which the scenarios are scaled.

    Raises:
        UsageError: The list is empty, or a scenario is unknown or named twice.
    """
    if not names:
        raise UsageError(f"{option} needs at least one scenario")
    for name in names:
        try:
            scenario(name, robot)
        except ValueError as error:
            raise UsageError(f"{option}: {error}") from None
    if len(set(names)) < len(names):
        raise UsageError(f"{option} names a scenario twice")
