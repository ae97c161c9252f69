"""Controllers of the SimpleQuad: batched, from observations to joint targets, in NumPy alone.

Make one for an environment and ask it at every control step:

    policy = policies.make("trot", robot=env.robot, control_period=env.dt)
    policy.reset(num_envs=n)
    action = policy.act(observation)  # (n, k) -> (n, 12) rad
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from policies import shipped
from policies.base import CONTROL_PERIOD, Policy, PolicyError
from policies.behaviour import Behaviour
from policies.bundle import DESCRIPTION, load
from policies.external import ExternalPolicy, is_reference, unsupported
from policies.mpc.parameters import OTHER_GAITS
from policies.mpc.policy import MpcWbc
from policies.poses import Stand
from policies.residual import ResidualPolicy
from policies.residual_bases import BASES, make_base
from policies.safety import Safe, SafetyLimits
from policies.summaries import SUMMARIES
from policies.trot.open_loop import Trot
from quad_env.actuation.models import Actuator
from quad_env.actuation.models import actuator as _actuator
from quad_env.files.paths import missing_file
from quad_env.robots.registry import get_robot
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.sensing.channel import delay_to_steps
from quad_env.sensing.suite import SensorSuite, sensor_suite

TRAINED = tuple(sorted({"residual", *(file.parent.name for file in shipped.MODELS.glob(f"*/{DESCRIPTION}"))}))
"""Names of the trained policies that ship with the project; the residual's, whether it is there or not."""


def _shipped(name: str, *, robot: Robot, control_period: float, joint_delay_steps: int, actuator: Actuator) -> Policy:
    folder = shipped.folder_of(robot) / name
    if not folder.is_dir():
        raise PolicyError(f"no trained policy in {folder}", f"make one with `python -m train` for {robot.name}")
    policy = _loaded(folder, robot, control_period, joint_delay_steps, actuator)
    policy.name = name
    return policy


def _loaded(
    folder: str | Path, robot: Robot, control_period: float, joint_delay_steps: int, actuator: Actuator
) -> Policy:
    """The policy of a bundle, which was trained for one robot and one control period."""
    policy = load(folder, robot, joint_delay_steps=joint_delay_steps, actuator=actuator)
    if misfit := policy.mismatch(robot, control_period):
        raise PolicyError(f"the policy in {folder} was {misfit}", "take another policy")
    return policy


def is_missing(name: str, robot: Robot) -> bool:
    """Return whether `name` is a trained policy without a bundle for this robot."""
    return name in TRAINED and not (shipped.folder_of(robot) / name).is_dir()


_OTHER_GAITS = {f"mpc_wbc_{gait}": partial(MpcWbc, gait=gait) for gait in OTHER_GAITS}
_MAKERS: dict[str, Callable[..., Policy]] = {
    **{name: partial(make_base, base) for name, base in BASES.items()},
    "behaviour": Behaviour,
    **_OTHER_GAITS,
    **{name: partial(_shipped, name) for name in TRAINED},
}
"""What makes a policy for a `robot` and a `control_period`, s, by its name."""
_PREDICTING = (*(name for name, base in BASES.items() if base.is_model_based), *_OTHER_GAITS, *TRAINED)
"""Those that are given by how many control steps the observed joints are `late`, and the actuator."""

SAFE = "safe:"
"""Before the name of any policy: that policy within the safety layer."""


def names() -> tuple[str, ...]:
    """The names that `make` knows, sorted."""
    return tuple(sorted(_MAKERS))


def _known(name: str) -> None:
    if name not in _MAKERS:
        raise PolicyError(f"unknown policy {name!r}; there are {', '.join(names())}")


def summary(name: str) -> str:
    """What the policy of that name is, in a line. Raises PolicyError for a name that does not exist."""
    _known(name)
    return SUMMARIES.get(name, "a trained policy in models/ that does not ship with the project")


def make(
    name: str,
    *,
    robot: str | Robot = SIMPLE_QUAD,
    control_period: float = CONTROL_PERIOD,
    actuator: str | Actuator = "ideal",
    sensors: str | SensorSuite | None = None,
    **given: Any,
) -> Policy:
    """A fresh policy by name, for an environment's `robot`, which may be a name of `quad_env.ROBOTS`, `dt`, s,
    `actuator` and `sensors`, of which policies that predict take the encoders' delay; for `safe:NAME` within the safety
    layer, whose limits are those of the actuator. What else is `given` goes to what makes it, such as `parameters`.

    Raises PolicyError for a name that does not exist or a model that is not there or was trained for others.
    """
    _known(name.rpartition(SAFE)[2])
    return resolve(name, robot=robot, control_period=control_period, actuator=actuator, sensors=sensors, **given)


def resolve(
    name_or_path: str | Path,
    *,
    robot: str | Robot = SIMPLE_QUAD,
    control_period: float = CONTROL_PERIOD,
    actuator: str | Actuator = "ideal",
    sensors: str | SensorSuite | None = None,
    trust: bool = False,
    **given: Any,
) -> Policy:
    """A fresh policy by name, see `make`, else from the bundle in the folder of that path, or from outside, see
    `Foreign`; `trust` lets it load files in which code can be hidden. Raises PolicyError.
    """
    text, robot = str(name_or_path), get_robot(robot)
    if text.startswith(SAFE):
        inner = text.removeprefix(SAFE)
        policy = resolve(
            inner, robot=robot, control_period=control_period, actuator=actuator, sensors=sensors, trust=trust, **given
        )
        return Safe(policy, SafetyLimits.of(robot, actuator))
    if is_reference(text):
        return ExternalPolicy(text, robot=robot, control_period=control_period, trust=trust)
    suite = sensor_suite(sensors)
    joint_delay_steps = 0 if suite is None else delay_to_steps(suite.encoders.delay, 1.0 / control_period)
    if text in _MAKERS:
        made = partial(_MAKERS[text], robot=robot, control_period=control_period, **given)
        return (
            made(joint_delay_steps=joint_delay_steps, actuator=_actuator(actuator)) if text in _PREDICTING else made()
        )
    if Path(text).is_dir():
        return _loaded(text, robot, control_period, joint_delay_steps, _actuator(actuator))
    if (remedy := unsupported(text)) is not None:
        raise PolicyError(remedy)
    if (missing := missing_file(text)) is not None:
        raise PolicyError(missing)
    raise PolicyError(
        f"no policy {text!r}: name one of {', '.join(names())}, the folder of a trained policy, or a policy of yours: "
        "my_file.py:MyPolicy, an .onnx file, a .zip of Stable-Baselines3, a deployment file of another project"
    )


__all__ = [
    "TRAINED",
    "Behaviour",
    "ExternalPolicy",
    "Policy",
    "PolicyError",
    "ResidualPolicy",
    "Safe",
    "Stand",
    "Trot",
    "is_missing",
    "is_reference",
    "load",
    "make",
    "names",
    "resolve",
    "summary",
    "unsupported",
]
