"""Groups of ablations: variants of one training that each change one choice of its default command."""

from collections.abc import Mapping
from dataclasses import dataclass

from train.config import DEFAULTS
from train.distillation.config import DistillationConfig

DEFAULT = "default"
"""Name of the variant without further options; all other variants of a group are compared with it."""
ROBOTS = ("go1", "simple_quad")
"""Names of the robots on which the groups are trained by default."""
JOYSTICK = "--policy end-to-end --recipe joystick"
"""Command-line options of the recipe `joystick`, in which a network learns to walk from scratch."""


@dataclass(frozen=True)
class Variant:
    """Variant of a training."""

    options: str = ""
    """Command-line options that the variant adds to the options of its group."""
    budget_fraction: float = 1.0
    """Number of labels or learner steps of a run, as a fraction of the number in the default variant."""
    equal_on: tuple[str, ...] = ()
    """Names of the robots on which the variant would equal the default, so that it is left out."""

    def description(self, unit: str) -> str:
        """Return the options as text for a table; a smaller budget is given with its `unit`, labels or steps."""
        parts = [self.options] if self.options else []
        if self.budget_fraction != 1.0:
            parts.append(f"--{unit} x {self.budget_fraction:g}")
        return " ".join(parts)


@dataclass(frozen=True)
class AblationGroup:
    """Group of variants with the same budget, the same seeds and the same validation episodes."""

    title: str
    """Description of the training, for the table of results."""
    options: str
    """Command-line options of `python -m train` in all variants of the group."""
    budget: int
    """Default number of labels, or of learner steps, of a run."""
    scenarios: tuple[str, ...]
    """Scenarios of the validation of all variants."""
    flat: str
    """Scenario in `scenarios`, on level ground; the table has the velocity error on it."""
    variants: Mapping[str, Variant]
    """Name of a variant -> variant; the first one is `DEFAULT`."""
    robots: tuple[str, ...] = ROBOTS
    """Names of the robots on which the group is trained by default."""

    @property
    def is_distillation(self) -> bool:
        """True if the training is a distillation, False if it is PPO."""
        return "--teacher" in self.options

    @property
    def unit(self) -> str:
        """Unit of the budget, which is also the name of its option: `labels` or `steps`."""
        return "labels" if self.is_distillation else "steps"

    def variants_of(self, robot: str) -> list[str]:
        """Return the names of the variants that differ from the default on a robot, and the default."""
        return [name for name, variant in self.variants.items() if robot not in variant.equal_on]


RESIDUAL_VARIANTS = {
    DEFAULT: Variant(),
    "base: trot": Variant("--base trot"),
    "base: trot_integral": Variant("--base trot_integral"),
    "base: stand": Variant("--base stand"),
    "sighted": Variant("--sighted"),
    "domain randomisation": Variant("--mixture flat:2+randomised 0.6 push:3+randomised 0.2 rough:3+randomised 0.2"),
    "no effort": Variant("--rewards.mechanical-power 0 --rewards.action-rate 0 --rewards.torque 0"),
    "effort in full from the start": Variant("--effort-ramp 0"),
    "twice the power weight": Variant("--rewards.mechanical-power -0.005"),
    "no crouch term": Variant("--rewards.crouch 0"),
    "no memory": Variant("--inputs.lags --inputs.averages"),
    "no slope far from the command": Variant("--rewards.linear-velocity-error 0 --rewards.yaw-rate-error 0"),
    "corrections at 100 Hz": Variant("--ppo.hold 1 --ppo.gamma 0.99"),
    "authority of 0.3 rad": Variant("--joint-authority 0.3 --hip-authority 0.15"),
    "three scenarios": Variant("--mixture flat:2 0.6 push:3 0.2 rough:3 0.2"),
    "a rate that falls linearly": Variant("--ppo.learning-rate-schedule linear"),
    "fewer robots, smaller minibatches": Variant("--ppo.envs 512 --ppo.minibatch 2048"),
    "no curriculum": Variant("--curriculum 1"),
}
"""Variants of the training of a correction, by name."""
DISTILLATION_VARIANTS = {
    DEFAULT: Variant(),
    "teacher always drives": Variant("--teacher-share 1"),
    "student always drives": Variant("--teacher-share 0"),
    "no history": Variant("--inputs.lags --inputs.averages"),
    "constant clock": Variant("--clock constant"),
    "no clock": Variant("--clock none"),
    "no position error": Variant("--position-error none"),
    "half of the labels": Variant(budget_fraction=0.5),
    "a quarter of the labels": Variant(budget_fraction=0.25),
    "no curriculum": Variant("--first-difficulty 1"),
    "episodes until a fall": Variant("--max-tilt 3.2"),
    "squared error of the targets": Variant("--fit.loss target"),
    "256, 128 and 64 units": Variant("--fit.hidden 256 128 64"),
    "128 and 128 units": Variant("--fit.hidden 128 128"),
}
"""Variants of the distillation, by name."""
END_TO_END_VARIANTS = {
    DEFAULT: Variant(),
    "clipped corrections": Variant("--correction bounded"),
    "no gait reward": Variant("--rewards.gait 0"),
    "no pose reward": Variant("--rewards.pose 0"),
    "no mirror symmetry": Variant("--ppo.symmetry none"),
    "no running normalisation": Variant("--ppo.normalization none"),
    "commands every 5 s": Variant("--commands scenario"),
    "clock shown at rest": Variant("--inputs.clock-at-rest shown"),
    "no reward floor": Variant("--reward-floor None"),
    "256 robots": Variant("--ppo.envs 256 --ppo.minibatch 1536"),
    "4096 robots": Variant("--ppo.envs 4096 --ppo.minibatch 24576"),
}
"""Variants of the recipe `joystick`, by name; the number of minibatches does not depend on the number of robots."""
PHYSICS_VARIANTS = {
    DEFAULT: Variant(),
    "contacts of feet and trunk": Variant("--physics.contacts feet-trunk"),
    "contacts of the feet": Variant("--physics.contacts feet"),
    "pyramidal cones": Variant("--physics.cone pyramidal"),
    "no joint friction": Variant("--physics.joint-friction none", equal_on=("simple_quad",)),
    "time step of 5 ms": Variant("--timestep 0.005"),
    "10 solver iterations": Variant("--solver-iterations 10"),
    "4 solver iterations": Variant("--solver-iterations 4"),
    "recipe joystick": Variant(
        "--physics.contacts feet --physics.joint-friction none --timestep 0.005 --solver-iterations 4"
    ),
}
"""Simplifications of the physics in training, by name; SimpleQuad has no joint friction."""
GROUPS: Mapping[str, AblationGroup] = {
    "distillation": AblationGroup(
        title="Distillation of `mpc_wbc`",
        options="--teacher mpc_wbc",
        budget=DistillationConfig.labels,
        scenarios=("flat", "push", "rough", "force", "payload", "latency:3", "noise:3", "push:3+hardware"),
        flat="flat",
        variants=DISTILLATION_VARIANTS,
    ),
    "end-to-end": AblationGroup(
        title="PPO without a base controller, recipe `joystick`",
        options=JOYSTICK,
        budget=6_000_000,
        scenarios=("flat", "push", "rough"),
        flat="flat",
        variants=END_TO_END_VARIANTS,
    ),
    "physics": AblationGroup(
        title="Recipe `joystick`; the default trains in the full model of the validation",
        options=f"{JOYSTICK} --physics.contacts all --physics.joint-friction model --timestep None "
        "--solver-iterations None",
        budget=6_000_000,
        scenarios=("flat", "push", "rough"),
        flat="flat",
        variants=PHYSICS_VARIANTS,
    ),
    "residual": AblationGroup(
        title="PPO that corrects a base controller",
        options="",
        budget=1_000_000,
        scenarios=DEFAULTS["residual"].complete_validation.scenarios,
        flat="flat:2",
        variants=RESIDUAL_VARIANTS,
        robots=("simple_quad",),
    ),
}
"""All groups, by name. In the group `physics`, the default variant is the full model of the validation."""
