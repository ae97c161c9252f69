"""Registry of policies: functions that make a policy from its name (`make`) or a path (`resolve`)."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

from policies import shipped
from policies.base import CONTROL_PERIOD, Policy, PolicyError
from policies.behaviour import Behaviour
from policies.bundle import DESCRIPTION, load
from policies.description import parse_description
from policies.external import ExternalPolicy, is_reference, unsupported_file_remedy
from policies.mpc.parameters import OTHER_GAITS
from policies.mpc.policy import MpcWbc
from policies.residual_bases import BASES, make_base
from policies.safety import Safe, SafetyLimits
from policies.servo_option import OWN, check_servo, with_servo_option
from policies.summaries import SUMMARIES
from quad_env.actuation.models import Actuator, find_actuator
from quad_env.extensions import check_new
from quad_env.files.paths import missing_file_message
from quad_env.files.text import format_exception
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.sensor_models import delay_to_steps
from quad_env.sensing.suite import SensorSuite, sensor_suite

STUDENT = "student"
"""Name of the policy that is distilled from a controller for a robot."""
SIGHTED = "sighted"
"""Name of the policy with a height scan that is distilled from a controller with a height scan for a robot."""
WALK = "walk"
"""Folder of the deployable policy of a robot, with observations that the robot measures and the maker's servo gains.

The policy has no name, because `walk` is the name of a gait. It is given by its path, for example models/go2/walk."""
_MPC_GAITS = {f"mpc_wbc_{gait}": partial(MpcWbc, gait=gait) for gait in OTHER_GAITS}
"""Name of each policy `mpc_wbc_...` for a gait other than the trot -> function that makes the policy."""
_CONTROLLERS = frozenset({*BASES, *_MPC_GAITS, "behaviour"})
"""Names of the controllers; trained policies in folders of these names are given by path."""


def _bundle_names(robot: Robot = SIMPLE_QUAD) -> tuple[str, ...]:
    """Return the sorted names of the policy bundles in the models folder of `robot`, without controllers' names."""
    folders = (file.parent.name for file in shipped.models_folder(robot).glob(f"*/{DESCRIPTION}"))
    return tuple(sorted(name for name in folders if name.isidentifier() and name not in _CONTROLLERS))


TRAINED = tuple(sorted({"end_to_end", "residual", "robust", SIGHTED, STUDENT, *_bundle_names()}))
"""Names of trained policies. A robot has only those that `trained_names` returns for it."""
SAFE = "safe:"
"""Prefix of a policy name, as in `safe:trot`, that puts the policy into the safety layer `Safe`."""


def _load_shipped(
    name: str, *, robot: Robot, control_period: float, joint_delay_steps: int, actuator: Actuator
) -> Policy:
    """Load the trained policy called `name` for a robot.

    `control_period` is the time between two control steps, s. `joint_delay_steps` is the delay of the observed joint
    angles, control steps. Raises PolicyError if there is no policy bundle for the robot.
    """
    folder = shipped.models_folder(robot) / name
    if not folder.is_dir():
        remedy = f"make one with `python -m train` for {robot.name}, or take one of {', '.join(names(robot))}"
        raise PolicyError(f"no trained policy in {folder}", remedy)
    policy = _load_bundle(folder, robot, control_period, joint_delay_steps, actuator)
    policy.name = name
    return policy


def _load_bundle(
    folder: str | Path, robot: Robot, control_period: float, joint_delay_steps: int, actuator: Actuator
) -> Policy:
    """Load the trained policy in the policy bundle `folder` for a robot and a control period, s.

    `joint_delay_steps` is the delay of the observed joint angles, control steps. Raises PolicyError if the policy was
    trained for another robot or control period.
    """
    policy = load(folder, robot, joint_delay_steps=joint_delay_steps, actuator=actuator, servo=OWN)
    if mismatch := policy.mismatch(robot, control_period):
        raise PolicyError(f"the policy in {folder} was {mismatch}", "take another policy")
    return policy


MAKERS: dict[str, Callable[..., Policy]] = {
    **{name: partial(make_base, base) for name, base in BASES.items()},
    "behaviour": Behaviour,
    **_MPC_GAITS,
    **{name: partial(_load_shipped, name) for name in TRAINED},
}
"""Name of each built-in policy -> function that makes the policy.

The function accepts the keyword arguments `robot` and `control_period` (time between two control steps, s)."""
_MODEL_BASED = (*(name for name, base in BASES.items() if base.is_model_based), *_MPC_GAITS, *TRAINED)
"""Names of the built-in policies that may use a dynamics model of the robot.

The functions in `MAKERS` for these policies also accept the keyword arguments `joint_delay_steps` (delay of the
observed joint angles, control steps) and `actuator`."""


def trained_names(robot: Robot) -> tuple[str, ...]:
    """Return the sorted names of the trained policies of a robot: the policy bundles in its models folder."""
    return tuple(name for name in _bundle_names(robot) if name in TRAINED or name not in MAKERS)


def names(robot: str | Robot = SIMPLE_QUAD) -> tuple[str, ...]:
    """Return the sorted names of all policies that `make` can make for a robot.

    They are the controllers, the trained policies in the models folder of the robot, the policies of installed
    extension packages, and the policies that were registered by `add_extension`.

    Args:
        robot: The robot, or its name.

    Returns:
        Names of the policies.
    """
    controllers = (name for name in MAKERS if name not in TRAINED)
    return tuple(sorted({*controllers, *trained_names(get_robot(robot)), *check_new("policies", MAKERS)}))


def is_missing(name: str, robot: Robot) -> bool:
    """Return True if `name` is a trained policy that has no policy bundle for `robot`."""
    return name in TRAINED and name not in trained_names(robot)


def summary(name: str, robot: str | Robot = SIMPLE_QUAD) -> str:
    """Return a one-line summary of a policy. Raises PolicyError if the robot has no policy with this name.

    Args:
        name: Name of the policy.
        robot: Robot of the policy, or its name; the trained policies of two robots may have other summaries.

    Returns:
        The summary.
    """
    model = get_robot(robot)
    _check_name(name, model)
    if name in trained_names(model):
        return _summarise_training(name, model)
    if name not in MAKERS:
        return "a policy of an installed extension"
    return SUMMARIES.get(name, "a trained policy in models/ that does not ship with the project")


def shipped_summaries(policy_names: Iterable[str], robot: Robot) -> dict[str, str]:
    """Return the one-line summaries of the policies that ship with the project: policy name -> summary.

    Args:
        policy_names: Names of policies. Names of policies that do not ship with the project are left out.
        robot: Robot of the policies.

    Returns:
        The summaries, in the order of `policy_names`.
    """
    trained = trained_names(robot)
    return {name: summary(name, robot) for name in policy_names if name in trained or name in SUMMARIES}


def _summarise_training(name: str, robot: Robot) -> str:
    """Return the summary of the trained policy `name` of a robot, by the training settings in its policy bundle."""
    folder = shipped.models_folder(robot) / name
    try:
        training = parse_description(folder, (folder / DESCRIPTION).read_bytes()).training
    except (OSError, PolicyError):
        training = {}
    if teacher := training.get("teacher"):
        scan = ", observes a height scan" if training.get("sighted") else ""
        return f"network that has learned the actions of {teacher}{scan} and runs alone"
    if training.get("recipe") == "improve":
        return "network that has learned the actions of a controller, improved by PPO against harder disturbances"
    return SUMMARIES.get(name, "a trained policy in models/ that does not ship with the project")


def make(
    name: str,
    *,
    robot: str | Robot = SIMPLE_QUAD,
    control_period: float = CONTROL_PERIOD,
    actuator: str | Actuator = "ideal",
    sensors: str | SensorSuite | None = None,
    servo: Any = None,
    **options: Any,
) -> Policy:
    """Make a new policy from its name.

    An environment that `gym.make` makes with the same `robot` and `servo` has the servo gains that the policy commands.
    PolicyError is raised for a policy that commands other servo gains, and for an unknown name. PolicyError is also
    raised for a trained policy that is missing, or that was trained for another robot or control period.

    Args:
        name: One of `names(robot)`, or `safe:NAME` for the policy NAME inside the safety layer `Safe`.
        robot: Robot that the policy controls: `env.unwrapped.robot` of the environment, or a name in `quad_env.ROBOTS`.
        control_period: Time between two control steps, s: `env.unwrapped.dt` of the environment.
        actuator: Actuator model of the environment. Model-based policies and the safety layer use its limits.
        sensors: Sensors of the environment. Model-based policies compensate the delay of the joint encoders.
        servo: Servo gains of the robot, as in `gym.make`: None for the robot's own, which are its maker's if `robot` is
            a name; "stiff" for the gains of controllers that need stiff servos; or a pair of stiffness, N·m/rad, and
            damping, N·m·s/rad. "own" lets the policy choose: then make the environment with `robot=policy.robot`.
        **options: Further keyword arguments for the constructor of the policy, for example `parameters`.

    Returns:
        The policy. It controls one robot until `reset` sets another number.
    """
    _check_name(name.rpartition(SAFE)[2], get_robot(robot))
    return resolve(
        name, robot=robot, control_period=control_period, actuator=actuator, sensors=sensors, servo=servo, **options
    )


def resolve(
    name_or_path: str | Path,
    *,
    robot: str | Robot = SIMPLE_QUAD,
    control_period: float = CONTROL_PERIOD,
    actuator: str | Actuator = "ideal",
    sensors: str | SensorSuite | None = None,
    servo: Any = None,
    trust: bool = False,
    **options: Any,
) -> Policy:
    """Make a new policy from its name, from a policy bundle, or from a file that a user provides.

    PolicyError is raised if there is no policy with this name or path, if the policy cannot be loaded, or if it
    commands other servo gains than the robot has.

    Args:
        name_or_path: Name of a policy, path of a policy bundle or a training run, or reference of an `ExternalPolicy`,
            for example `my_file.py:MyPolicy`. The prefix `safe:` puts the policy into the safety layer.
        robot: Robot that the policy controls, or its name.
        control_period: Time between two control steps, s.
        actuator: Actuator model of the environment. Model-based policies and the safety layer use its limits.
        sensors: Sensors of the environment. Model-based policies compensate the delay of the joint encoders.
        servo: Servo gains of the robot, as in `gym.make`: None for the robot's own, which are its maker's if `robot` is
            a name; "stiff" for the gains of controllers that need stiff servos; or a pair of stiffness, N·m/rad, and
            damping, N·m·s/rad. "own" lets the policy choose: then make the environment with `robot=policy.robot`.
        trust: True: also load files of types that can contain hidden code.
        **options: Further keyword arguments for the constructor of the policy, for example `parameters`.

    Returns:
        The policy. It controls one robot until `reset` sets another number.
    """
    robot = with_servo_option(get_robot(robot), servo)
    policy = _resolve(
        str(name_or_path),
        robot=robot,
        control_period=control_period,
        actuator=actuator,
        sensors=sensors,
        trust=trust,
        **options,
    )
    check_servo(policy, robot, servo)
    return policy


def _resolve(
    reference: str,
    *,
    robot: Robot,
    control_period: float,
    actuator: str | Actuator,
    sensors: str | SensorSuite | None,
    trust: bool,
    **options: Any,
) -> Policy:
    """Make a policy as `resolve` does, but do not check the servo gains that the policy has chosen."""
    if reference.startswith(SAFE):
        policy = _resolve(
            reference.removeprefix(SAFE),
            robot=robot,
            control_period=control_period,
            actuator=actuator,
            sensors=sensors,
            trust=trust,
            **options,
        )
        return Safe(policy, SafetyLimits.for_robot(robot, actuator))
    if is_reference(reference):
        return ExternalPolicy(reference, robot=robot, control_period=control_period, trust=trust)
    suite = sensor_suite(sensors)
    joint_delay_steps = 0 if suite is None else delay_to_steps(suite.encoders.delay, 1.0 / control_period)
    if (maker := _find_maker(reference, robot)) is not None:
        if reference in _MODEL_BASED or reference not in MAKERS:
            options |= {"joint_delay_steps": joint_delay_steps, "actuator": find_actuator(actuator)}
        return maker(robot=robot, control_period=control_period, **options)
    if reference.isidentifier() and reference in (factories := check_new("policies", MAKERS)):
        return _make_from_extension(reference, factories[reference], robot, control_period, options)
    if Path(reference).is_dir():
        return _load_bundle(reference, robot, control_period, joint_delay_steps, find_actuator(actuator))
    raise PolicyError(_unknown_reference(reference, robot))


def _find_maker(name: str, robot: Robot) -> Callable[..., Policy] | None:
    """Return the function that makes a built-in policy, or a trained policy of `robot`; None if there is no `name`."""
    if name in MAKERS:
        return MAKERS[name]
    return partial(_load_shipped, name) if name in trained_names(robot) else None


def _make_from_extension(
    name: str, factory: Callable[..., Any], robot: Robot, control_period: float, options: dict[str, Any]
) -> Policy:
    """Make the policy `name` by the function `factory`, which an extension package has registered.

    Raises PolicyError if the function raises an exception or does not return a `Policy`.
    """
    try:
        policy = factory(robot=robot, control_period=control_period, **options)
    except Exception as error:  # any exception, because the code belongs to another package
        raise PolicyError(f"extension: policies {name}: {format_exception(error)}") from error
    if not isinstance(policy, Policy):
        raise PolicyError(f"extension: policies {name}: expected a policies.Policy, got {type(policy).__name__}")
    policy.name = name
    return policy


def _check_name(name: str, robot: Robot) -> None:
    """Raise PolicyError if no built-in policy, no trained policy of `robot` and no extension is called `name`."""
    if name not in MAKERS and name not in names(robot):
        raise PolicyError(f"unknown policy {name!r}; there are {', '.join(names(robot))}")


def _unknown_reference(reference: str, robot: Robot) -> str:
    """Return the error message for an unknown policy reference.

    The `reference` is neither the name of a policy of `robot`, nor the folder of a policy bundle, nor an external
    policy.
    """
    if (remedy := unsupported_file_remedy(reference)) is not None:
        return remedy
    if (missing := missing_file_message(reference)) is not None:
        return missing
    return (
        f"no policy {reference!r}: name one of {', '.join(names(robot))}, the folder of a trained policy, or a policy "
        "of yours: my_file.py:MyPolicy, an .onnx file, a .zip of Stable-Baselines3, a deployment file of another "
        "project"
    )
