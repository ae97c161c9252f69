"""Functions that read the mutated files of the fuzz test, and check that the content is plausible.

A mutated file is a valid file with random changes; it describes a robot, a policy or a terrain. Each function raises
PolicyError, ValueError or OSError for a faulty file, and AbsurdError for implausible content.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from policies import bundle
from policies.base import CONTROL_PERIOD, PolicyError
from policies.external import onnx_file, readers
from policies.external.network_policy import control_period_ratio, with_spec_gains
from policies.external.observation_adapter import ObservationAdapter
from policies.external.reference import PolicyReference, resolve_reference
from policies.external.spec import PolicySpec
from quad_env.robots.plausibility import find_warnings
from quad_env.robots.robot import Robot
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.terrain import HeightField

Read = Callable[[Path], None]
"""Type of a function that takes the path of a file or folder, reads it, and checks its content.

The function raises PolicyError, ValueError or OSError if the file is faulty. It raises AbsurdError if the robot, policy
or terrain in the file is implausible.
"""
MAX_ADAPTED_WIDTH = 10_000_000
"""Number of values in an observation history from which on `read_spec` makes no observation adapter.

The adapter converts observations of this project to observations of the policy. The number of values in a history is
the number of values in an observation, multiplied by the longest history of an observation term, in control steps of
the policy.
"""


class AbsurdError(AssertionError):
    """Raised if a file was read without an error, but its robot, policy or terrain is implausible."""


def read_spec(file: Path) -> None:
    """Read the specification of a policy, check its numbers, and adapt it to the robot SimpleQuad.

    The specification has the observations, the actions, the servo gains and the control rate of the policy. The
    function raises AbsurdError if these numbers are implausible. It does nothing if the file has no specification.
    """
    spec = readers.read(file)
    if spec is None:
        return
    _check_spec(spec)
    robot = with_spec_gains(SIMPLE_QUAD, spec)
    control_period_ratio(spec, CONTROL_PERIOD)
    if spec.width * max(term.history for term in spec.terms) < MAX_ADAPTED_WIDTH:
        ObservationAdapter(spec, robot, CONTROL_PERIOD)


def _check_spec(spec: PolicySpec) -> None:
    """Raise AbsurdError if servo gains, action scale, control rate or observation width are implausible."""
    numbers = np.concatenate([np.ravel(getattr(spec, name)) for name in ("stiffness", "damping", "action_scale")])
    if not (np.isfinite(numbers).all() and np.abs(numbers).max() <= 1e4 and 1.0 <= spec.control_rate <= 1e4):
        raise AbsurdError(f"a description with gains up to {np.abs(numbers).max():g} at {spec.control_rate:g} Hz")
    if spec.width > 100_000:
        raise AbsurdError(f"an observation of {spec.width} numbers")


def read_onnx(file: Path) -> None:
    """Read an ONNX file and call its network once, on zeros; raise PolicyError if the call fails."""
    readers.read(file)
    policy = onnx_file.load_onnx(PolicyReference(file), SIMPLE_QUAD)
    act: Any = policy()  # type: ignore[operator]
    try:
        act(np.zeros(48, np.float32))
    # Every exception is caught, because the subprocess of a policy reports every exception as an error of the policy.
    except Exception as error:
        raise PolicyError(f"it raises {type(error).__name__}") from None


def read_bundle(folder: Path) -> None:
    """Load a bundle (trained policy's folder); raise AbsurdError if its correction limit is implausible.

    The correction limit is the largest correction of each joint target, rad. It must be between 0 and π.
    """
    policy = bundle.load(folder)
    if not (np.isfinite(policy.authority).all() and policy.authority.min() >= 0.0 and policy.authority.max() <= np.pi):
        raise AbsurdError(f"an authority of {policy.authority}")


def read_sb3(file: Path) -> None:
    """Try to load a model of Stable-Baselines3, although the user has not given the option --trust.

    The option permits files that can contain hidden code. Raises AbsurdError if the model is accepted, because models
    of Stable-Baselines3 need this permission.
    """
    resolve_reference(file, trust=False)
    raise AbsurdError("a model of Stable-Baselines3 is taken without --trust")


def read_robot(file: Path) -> None:
    """Read a robot from an MJCF or URDF file.

    Raises AbsurdError if a number of the robot is not finite, or if mass, leg length or torque are implausible and
    `find_warnings` gives no warning.
    """
    robot = Robot.from_mjcf(file)
    model = robot.model
    warnings = list(find_warnings(robot))
    numbers = [robot.mass, robot.leg_length, robot.home_height, robot.rated_torque]
    for per_joint in (robot.joint_lower, robot.joint_upper, robot.servo_stiffness, robot.servo_damping):
        numbers += [*per_joint]
    numbers += [*robot.trunk_size, *robot.home_pose]
    if not np.isfinite(numbers).all() or not np.isfinite(model.body_mass).all():
        raise AbsurdError("a robot with figures that are not finite")
    is_plausible = 0.05 < robot.mass < 5000.0 and 0.02 < robot.leg_length < 5.0 and robot.rated_torque < 1e5
    if not warnings and not is_plausible:
        size = f"{robot.mass:g} kg on legs of {robot.leg_length:g} m"
        raise AbsurdError(f"a robot of {size} with {robot.rated_torque:g} N·m")


def read_terrain(file: Path) -> None:
    """Read a terrain with a height field from a TOML file; raise AbsurdError if a height is not finite."""
    terrain = HeightField.from_toml(file)
    if not np.isfinite([terrain.heights.min_height, terrain.heights.span]).all():
        raise AbsurdError("heights that are not finite")
