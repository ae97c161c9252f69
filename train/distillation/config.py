"""Settings of a distillation: dataclasses for the command line, its help text and config.json."""

import dataclasses
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evaluate import hardware
from evaluate.hardware import HardwareConfig
from policies.history import Inputs
from policies.parameters import limits_of, parameter
from policies.registry import SIGHTED, STUDENT, WALK
from quad_env.cli.command_line import UsageError, check_numbers
from quad_env.cli.ray_option import RayOption
from quad_env.scenarios.scenario import HARDWARE, SCAN_DROPOUTS, SCAN_LOST
from quad_env.sensing.height_scan import HeightScan
from train import deployable
from train.config import (
    MAX_HIDDEN_LAYERS,
    MAX_SEED,
    ValidationConfig,
    check_mixture,
    check_scan_rate,
    check_scenarios,
)
from train.deployable import Observations
from train.run_record import changed_options
from train.scan_mixtures import with_scan_dropouts

MIXTURE = (
    ("flat:2", 0.08), ("steady", 0.02), ("flat:3", 0.03), ("flat:4", 0.02), ("push:2", 0.05), ("push:3", 0.07),
    ("push:4", 0.03), ("rough:2", 0.04), ("rough:3", 0.05), ("rough:4", 0.03), ("force:2", 0.02), ("force:3", 0.05),
    ("slope:5", 0.05), ("stairs:2", 0.02), ("stairs:3", 0.03), ("gravel:3", 0.04), ("soft:4", 0.03),
    ("slippery:4", 0.03), ("payload:3", 0.03), ("weak_motors:3", 0.03), ("slow_motors:3", 0.03), ("latency:3", 0.02),
    ("latency:4", 0.03), ("noise:3", 0.02), ("noise:4", 0.02), ("dropout:5", 0.03), ("surprise:3", 0.03),
    ("flat:2+hardware", 0.03), ("push:3+hardware", 0.04), ("rough:3+hardware", 0.03), ("force:3+hardware", 0.04),
    ("gravel:3+hardware", 0.03),
)  # fmt: skip
"""Default scenarios on which the student is trained, each with the fraction of the robots on it.

A name such as `push:3` means level 3 of the disturbance `push`; a higher level is more severe. Every kind of
disturbance is included at a hard level, because a student does not learn to resist a disturbance that it has not met.
The suffix `+hardware` adds the robot's hardware profile: the motors, delays and sensors of the real robot."""
VALIDATION_SCENARIOS = (
    "flat", "push", "rough", "force:3", "slope:5", "latency:4", "noise:3", "push:3+hardware", "force:3+hardware",
)  # fmt: skip
"""Names of the scenarios on which the student is validated by default.

A name such as `latency:3` means level 3 of the disturbance `latency`. The suffix `+hardware` adds the motors, delays
and sensors of the real robot."""
TERRAIN_SHARES = {
    "rough": (0.010, 0.015, 0.035, 0.055, 0.020, 0.009, 0.009),
    "stairs": (0.010, 0.030, 0.060, 0.020, 0.009, 0.009),
    "gravel": (0.009, 0.010, 0.025, 0.020, 0.010, 0.009),
}
"""Disturbance axis of uneven ground -> fractions of the robots of a sighted student on its levels 1, 2, …

Each level has at least two robots of 256, so that its difficulty can rise after a segment."""
HARDWARE_TERRAIN_SHARES = {
    "rough": (0.009, 0.009, 0.015, 0.020, 0.009, 0.009, 0.009),
    "stairs": (0.009, 0.012, 0.020, 0.009, 0.009, 0.009),
    "gravel": (0.009, 0.009, 0.010, 0.009, 0.009, 0.009),
}
"""The fractions `TERRAIN_SHARES` of the same scenarios with the robot's hardware profile."""
SCAN_LOSS_SHARES = (
    ("rough:3", SCAN_LOST, "", 0.015), ("rough:4", SCAN_LOST, "", 0.015), ("stairs:2", SCAN_LOST, "", 0.015),
    ("stairs:3", SCAN_LOST, "", 0.015), ("gravel:3", SCAN_LOST, "", 0.010), ("rough:3", SCAN_LOST, HARDWARE, 0.010),
    ("stairs:2", SCAN_LOST, HARDWARE, 0.010), ("rough:4", SCAN_DROPOUTS, "", 0.020),
    ("stairs:3", SCAN_DROPOUTS, "", 0.020), ("gravel:3", SCAN_DROPOUTS, "", 0.010),
    ("rough:3", SCAN_DROPOUTS, HARDWARE, 0.010), ("stairs:2", SCAN_DROPOUTS, HARDWARE, 0.010),
)  # fmt: skip
"""Scenarios of a sighted student with a lost scan, always or at times: level, suffixes, fraction of the robots."""
BLIND_FRACTION = 0.33
"""Fraction of the robots of a sighted student on the scenarios of a blind one, `MIXTURE`, with dropouts of the scan."""


def _sighted_mixture() -> tuple[tuple[str, float], ...]:
    """Return the default scenarios of a sighted student, each with its fraction of the robots."""
    levels = [
        (f"{axis}:{level}{suffix}", share)
        for suffix, axes in (("", TERRAIN_SHARES), (HARDWARE, HARDWARE_TERRAIN_SHARES))
        for axis, shares in axes.items()
        for level, share in enumerate(shares, 1)
    ]
    lost = [(f"{name}{loss}{profile}", share) for name, loss, profile, share in SCAN_LOSS_SHARES]
    given = {name for name, _ in (*levels, *lost)}
    blind = with_scan_dropouts(MIXTURE, BLIND_FRACTION)
    return (*levels, *lost, *((name, share) for name, share in blind if name not in given))


SIGHTED_MIXTURE = _sighted_mixture()
"""Default scenarios on which a student with a height scan is trained, each with the fraction of the robots on it.

Uneven ground is included at every level, with and without the robot's hardware profile. The scan of some robots is lost
in the whole episode. On the scenarios of a blind student, the scan fails at times, and for a quarter of the episodes in
the whole episode, so that the student does not depend on it."""
SIGHTED_VALIDATION_SCENARIOS = (*VALIDATION_SCENARIOS, "rough:4", "stairs:3", f"rough:4{SCAN_LOST}")
"""Names of the scenarios on which a student with a height scan is validated by default.

On SimpleQuad `rough:4` has 0.24 m from valley to peak, and `stairs:3` a rise of 0.15 m."""
SIGHTED_LABELS = 2_800_000
"""Default number of labels of a student with a height scan."""
STUDENT_SCAN = HeightScan(spacing=0.075, noise=0.02, delay=0.04)
"""Default height scan of a student: 17 x 11 points, with the noise and the delay of a map from depth cameras."""
HISTORY_INPUTS = Inputs(lags=(0.01, 0.02, 0.04, 0.08, 0.12), averages=(0.3, 1.5))
"""Default inputs of the student's network in addition to the current observation.

`lags` are the ages of single past observations, and `averages` the time constants of exponential averages, s. A
model-based teacher integrates its position error and estimates loads. From the averages, the network can compute
similar quantities. From the lags, the network can estimate velocities in spite of noise, and recognise delays."""


@dataclasses.dataclass(frozen=True)
class FitConfig:
    """Settings of the supervised learning, in which the network of the student learns from the labels."""

    hidden: tuple[int, ...] = dataclasses.field(default=(512, 256, 128), metadata={"limits": (1, 4096)})
    """Numbers of units in the hidden layers of the network."""
    round_updates: int = parameter(500, limits=(1, 1_000_000))
    """Number of gradient steps after each round, see --round-steps."""
    final_updates: int = parameter(2000, limits=(0, 1_000_000))
    """Number of gradient steps after the last round, in which the learning rate falls to --fit.final-learning-rate. A
    constant rate gives less success on rough ground and under pushes."""
    minibatch: int = parameter(2048, limits=(1, 2**20))
    """Number of labels in one gradient step."""
    learning_rate: float = parameter(1e-3, limits=(1e-9, 1.0))
    """Learning rate of the AdamW optimiser during the rounds."""
    final_learning_rate: float = parameter(1e-5, limits=(1e-9, 1.0))
    """Learning rate of the AdamW optimiser at the last gradient step."""
    weight_decay: float = parameter(1e-4, limits=(0.0, 1.0))
    """Weight decay of the AdamW optimiser."""
    loss: Literal["torque", "target"] = "torque"
    """torque: Huber loss of the servo torques; target: squared error of the joint targets, rad²."""
    huber: float = parameter(0.08, limits=(1e-4, 100.0))
    """Error of a servo torque at which the Huber loss changes from quadratic to linear, as a fraction of robot weight x
    leg length."""


@dataclasses.dataclass(frozen=True)
class DistillationConfig:
    """Distil a policy into a network that runs alone: dataset aggregation (DAgger) on SimpleQuad-v0."""

    teacher: str = "mpc_wbc"
    """Policy to learn from: a name, the folder of a bundle, or a file of another project. The teacher observes the true
    state; the observations of the student may have noise and delay."""
    robot: str = "simple_quad"
    """Robot: a name of quad_env.ROBOTS like go1, or the path of its MJCF, URDF or TOML."""
    servo: str = ""
    """Stiffness/damping of the servos, N·m/rad and N·m·s/rad, for example 35/0.5; by default from the teacher, or with
    --observations deployable or estimated from the robot's manufacturer."""
    observations: Observations = "all"
    """Observations of the student. all: the whole observation. deployable: quantities that a robot measures, without
    linear velocity, for robots on their hardware profile; estimated: these and the estimated linear velocity. Both
    change the defaults of --inputs, --hold, --clock, --position-error, --mixture and --validation.scenarios."""
    labels: int = parameter(1_400_000, limits=(1, 10**12 - 1))
    """Number of labels of the whole run; a label is the action of the teacher for one robot in one control step."""
    seed: int = parameter(0, limits=(0, MAX_SEED))
    """Seed of the network, the noise and the training episodes (never shared with validation or evaluation)."""
    seeds: str | None = None
    """Several seeds in place of --seed, one run after the other: a range such as 0-4, or a list such as 0,3,7. Each
    seed has its own run folder, ROBOT-student-SEED in --out, or ROBOT-sighted-SEED. With --resume, finished runs are
    skipped and stopped runs are continued."""
    part: str | None = None
    """Train only the K-th of N equal shares of --seeds, such as 2/5; other machines train the other shares."""
    ray: RayOption = None
    """Train --seeds on a Ray cluster (pip install -e ".[cluster]"), each on --threads cores: at HOST:PORT, or without a
    value on a cluster that is started on this machine. The trained policies do not depend on it."""
    out: Path | None = None
    """Run folder, new or empty unless --resume; by default runs/ROBOT-student-SEED, runs/ROBOT-sighted-SEED with
    --sighted, or runs/ROBOT-deployable-SEED with --observations deployable."""
    resume: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Continue the run in --out from its last checkpoint."""
    threads: int = parameter(2, limits=(1, 256))
    """Number of threads of simulation and learner. A resumed run gives identical results only with the same number."""
    trust: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Load a teacher also from files that can contain hidden code: a .zip of Stable-Baselines3, TorchScript .pt."""
    envs: int = parameter(256, limits=(1, 65_536))
    """Number of robots simulated together."""
    round_steps: int = parameter(250, limits=(1, 1_000_000))
    """Number of control steps of 10 ms in a round. After each round the network learns from all labels so far."""
    segment_rounds: int = parameter(2, limits=(1, 1000))
    """Number of rounds after which all robots start new episodes and a checkpoint is written."""
    teacher_share: tuple[float, ...] = dataclasses.field(
        default=(1.0, 0.5, 0.25, 0.125, 0.1, 0.0), metadata={"limits": (0.0, 1.0)}
    )
    """Fraction of the time in which the teacher controls a robot, for each round; later rounds have the last value."""
    drive_time: tuple[float, float] = dataclasses.field(default=(0.2, 1.5), metadata={"limits": (0.01, 100.0)})
    """Shortest and longest time for which teacher or student controls a robot before the next random choice, s."""
    sighted: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Give the student a height scan of the ground around the robot, see --scan; the teacher must have one too. The
    defaults of --mixture, --labels and --validation.scenarios then include rough ground, stairs, gravel and lost scans.
    """
    scan: HeightScan = STUDENT_SCAN
    noise: float = parameter(0.04, limits=(0.0, 10.0))
    """Standard deviation of the noise on the joint targets, as change of the servo torque / (robot weight x leg
    length). The noise is added in half of the times in which the teacher controls a robot."""
    hold: int = parameter(1, limits=(1, 1000))
    """Number of control steps of 10 ms for which the student holds each action, in training and in evaluation. Labels
    are taken in every control step."""
    fall_margin: float = parameter(0.1, limits=(0.0, 10.0))
    """Time before each fall in which the labels are not used, s."""
    first_difficulty: float = parameter(0.3, limits=(0.0, 1.0))
    """Difficulty of each scenario at the start of the training, from 0, the mildest level of its disturbance, to 1, the
    severity that --mixture names. After each segment it rises where most velocity commands were tracked, and falls
    where few were. 1 and no change: a student that cannot walk yet collects labels of useless states."""
    max_tilt: float = parameter(0.9, limits=(0.05, 3.2))
    """Tilt of the trunk at which a training episode ends, rad. A robot that stumbles without a fall would collect
    labels of states from which also the teacher cannot walk on."""
    joint_authority: float = parameter(2.0, limits=(1e-3, 3.0))
    """Largest distance of the targets of thigh and calf joints from the home pose, rad."""
    hip_authority: float = parameter(0.9, limits=(0.0, 3.0))
    """Largest distance of the targets of hip joints from the home pose, rad."""
    inputs: Inputs = HISTORY_INPUTS
    """Inputs of the network besides the current observation. If the frequency of the clock input is 0, --clock and
    --position-error decide about clock and position error."""
    clock: Literal["teacher", "constant", "none"] = "teacher"
    """Clock input of the network. teacher: gait clock of the teacher, which steps faster after a push; constant: clock
    of the teacher's step frequency, which does not; none: no clock, the teacher walks by its own."""
    position_error: Literal["teacher", "none", "off"] = "teacher"
    """teacher: the network has the position error as an input if the teacher corrects it; none: it does not; off: the
    network does not have it, and a model-based teacher does not correct it."""
    mixture: tuple[tuple[str, float], ...] = MIXTURE
    """Scenarios of the training, each with its share of the robots. Scenarios can be combined, as in
    payload=15+slope=10; the suffix +randomised adds domain randomisation."""
    max_episode_steps: int = parameter(1000, limits=(1, 1_000_000))
    """Length of a training episode, control steps."""
    fit: FitConfig = dataclasses.field(default_factory=FitConfig)
    validation: ValidationConfig = dataclasses.field(
        default_factory=lambda: ValidationConfig(interval=500_000, episodes=8, scenarios=VALIDATION_SCENARIOS)
    )

    @property
    def folder(self) -> Path:
        """Folder of the run: `out`, or the default folder if `out` is None."""
        kind = self.policy_name if self.observations == "all" else self.observations
        name = f"{Path(self.robot).stem}-{kind}-{self.seed}"
        return self.out if self.out is not None else Path("runs") / name

    @property
    def policy_name(self) -> str:
        """Name of the trained policy, which is also its kind.

        It is `sighted` with a height scan, `walk` with deployable observations and the maker's servo gains, otherwise
        `student`.
        """
        if self.observations == "deployable" and self.has_own_servo:
            return WALK
        return SIGHTED if self.sighted else STUDENT

    @property
    def height_scan(self) -> HeightScan | None:
        """Height scan in the observation of the student; None if the student has none."""
        return self.scan if self.sighted else None

    @property
    def has_student_clock(self) -> bool:
        """True if the student has a gait clock, which a model-based teacher then uses too."""
        return self.inputs.clock > 0.0 or self.clock != "none"

    @property
    def has_own_servo(self) -> bool:
        """True if the servos have the gains of the robot's manufacturer, whichever gains the teacher prefers."""
        return self.observations != "all" and not self.servo

    @property
    def hardware(self) -> HardwareConfig:
        """Hardware of the simulated robots: the robot and its servo gains, and ideal motors.

        Observations are the true state, without sensor models and estimator. Scenarios with the robot's hardware
        profile have the motors, delays and sensors of the real robot instead.
        """
        return HardwareConfig(robot=self.robot, servo=self.servo)

    @property
    def round_labels(self) -> int:
        """Number of labels in a round: one label of each robot in each control step."""
        return self.envs * self.round_steps

    @property
    def rounds(self) -> int:
        """Number of rounds of the run: the smallest number with which the run has at least `labels` labels."""
        return -(-self.labels // self.round_labels)


def default_settings(given: DistillationConfig) -> DistillationConfig:
    """Return the default settings of a distillation with the teacher and the observations of `given`.

    A sighted student has its own scenarios. The flag --sighted itself is off in the result, so that a command line can
    have it.
    """
    default = DistillationConfig(teacher=given.teacher, observations=given.observations)
    if given.sighted:
        validation = dataclasses.replace(default.validation, scenarios=SIGHTED_VALIDATION_SCENARIOS)
        return dataclasses.replace(default, labels=SIGHTED_LABELS, mixture=SIGHTED_MIXTURE, validation=validation)
    if given.observations == "all":
        return default
    scenarios = deployable.hardware_scenarios(default.validation.scenarios)
    return dataclasses.replace(
        default,
        inputs=deployable.deployable_inputs(given.observations, Inputs()),
        hold=deployable.HOLD,
        clock="constant",
        position_error="none",
        mixture=deployable.hardware_mixture(default.mixture),
        validation=dataclasses.replace(default.validation, scenarios=scenarios),
    )


def check(config: DistillationConfig) -> None:
    """Check that a distillation can run with the given settings.

    Args:
        config: Settings of the distillation.

    Raises:
        UsageError: A setting is not valid. The message is one line that names the option.
    """
    for group, part in (("", config), ("fit.", config.fit), ("validation.", config.validation)):
        check_numbers(part, limits_of(part), group)
    if len(config.fit.hidden) > MAX_HIDDEN_LAYERS:
        raise UsageError(f"--fit.hidden must be at most {MAX_HIDDEN_LAYERS} widths")
    if not config.teacher_share:
        raise UsageError("--teacher-share needs at least one number")
    if config.drive_time[0] > config.drive_time[1]:
        raise UsageError(f"--drive-time: the shortest time, {config.drive_time[0]:g} s, is above the longest")
    if not config.sighted and config.scan != STUDENT_SCAN:
        raise UsageError(f"--scan: needs --sighted, got {config.scan}; valid: --scan options with --sighted")
    check_scan_rate(config.scan)
    try:
        hardware.check_hardware(config.hardware)
    except ValueError as error:
        raise UsageError(str(error)) from None
    robot = config.hardware.robot_model
    if config.sighted and (config.observations != "all" or config.inputs.terms):
        raise UsageError("--sighted: deployable observations have no height scan; leave one of the options out")
    deployable.check_observations(config.observations, config.inputs)
    if config.inputs.terms and config.clock == "teacher" and not config.inputs.clock:
        raise UsageError("--clock: the teacher's clock needs the linear velocity, got teacher; valid: constant, none")
    if config.inputs.terms and config.position_error == "teacher":
        raise UsageError("--position-error: --inputs.terms have no position error, got teacher; valid: none, off")
    check_mixture(config.mixture, robot)
    check_scenarios("--validation.scenarios", config.validation.scenarios, robot)


def distillation_command(config: DistillationConfig) -> str:
    """Return the command line that repeats the distillation with the settings `config`."""
    default = dataclasses.replace(default_settings(config), observations="all")
    return f"python -m train --teacher {config.teacher} {changed_options(default, config)}"
