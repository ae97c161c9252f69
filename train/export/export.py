"""Export of a policy bundle to a folder of deployment files, and the proof by reading the folder back."""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from policies.base import Policy, PolicyError
from policies.external.network_policy import NetworkPolicy
from policies.external.readers.detect import read
from policies.residual import ResidualPolicy
from quad_env.task.observations import ObservationTable, observation_table
from train.export import isaac_lab, mjlab, readme, rl_sar, stand_alone, toml, unitree
from train.export.export_format import ExportFormat
from train.export.plain_network import plain_network

FORMATS: dict[str, ExportFormat] = {
    each.name: each for each in (unitree.FORMAT, mjlab.FORMAT, isaac_lab.FORMAT, rl_sar.FORMAT, toml.FORMAT)
}
"""Name of a format, the value of `--to` -> format."""
NUM_STEPS = 200
"""Number of control steps in which a written policy is compared with the exported one."""
NUM_ROBOTS = 2
"""Number of robots of this comparison."""
NUM_COMMAND_STEPS = 50
"""Number of control steps of this comparison for which a velocity command is kept."""
TOLERANCE = 5e-5
"""Maximum difference between the joint targets of an export and of its bundle, as a fraction of the action scale.

A bundle rounds the inputs of its layers to 2^-20, so that its bits are the same on every processor; ONNX Runtime and
PyTorch compute in float32."""
GAIN_TOLERANCE = 1e-6
"""Maximum relative difference between the servo gains of an export and of its bundle."""


@dataclass(frozen=True)
class ExportResult:
    """Result of an export."""

    difference: float
    """Largest difference between the joint targets of the export, as read back, and of the bundle, rad."""
    has_program: bool
    """True if the export contains the stand-alone program."""


def export(policy: ResidualPolicy, source: str, format_name: str, folder: Path) -> ExportResult:
    """Export a trained policy to a new folder, read the folder back, and compare.

    The folder is complete or absent: it is written next to its place and then renamed. PolicyError is raised if the
    format cannot describe the policy, or if the export differs from the policy.

    Args:
        policy: Trained policy.
        source: Path or name of the policy, for messages and the README.
        format_name: Name of the format, a key of FORMATS.
        folder: Folder of the export; it does not exist, or is empty.

    Returns:
        Difference from the bundle, and whether there is a stand-alone program.
    """
    export_format = FORMATS[format_name]
    network = plain_network(policy, source, export_format.describes_all)
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}."))
    try:
        written = export_format.write(network, temporary)
        has_program = stand_alone.write(written, export_format.onnx, temporary)
        readme.write(written, export_format, source, has_program, temporary)
        difference = compare(policy, temporary / export_format.settings)
        temporary.chmod(0o755)
        if folder.exists():
            folder.rmdir()
        temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return ExportResult(difference, has_program)


def compare(policy: ResidualPolicy, settings: Path) -> float:
    """Compare a policy with an export of it, as the readers of deployment files read it.

    Args:
        policy: Trained policy.
        settings: File of the export with the settings.

    Returns:
        Largest difference of the joint targets, rad.

    Raises:
        PolicyError: The joint targets or the servo gains differ.
    """
    copy = read_back(policy, settings)
    if not np.allclose(copy.robot.gains, policy.robot.gains, rtol=GAIN_TOLERANCE, atol=0.0):
        raise PolicyError(f"{settings.name}: the servo gains read back differ from those of the policy")
    difference = largest_difference(policy, copy)
    if not difference <= TOLERANCE * policy.authority.max():
        fault = f"the joint targets read back differ from those of the policy by {difference:.1g} rad"
        raise PolicyError(f"{settings.name}: {fault}")
    return difference


def read_back(policy: ResidualPolicy, settings: Path) -> NetworkPolicy:
    """Return the policy that the readers of deployment files make of an export.

    Args:
        policy: Exported policy.
        settings: File of the export with the settings.

    Returns:
        Policy for the robot of the exported policy.

    Raises:
        PolicyError: The export cannot be read.
    """
    spec = read(settings)
    if spec is None:
        raise PolicyError(f"{settings.name}: the file that was written cannot be read back")
    return NetworkPolicy(spec, robot=policy.robot, control_period=policy.control_period)


def largest_difference(policy: Policy, copy: Policy) -> float:
    """Compute the largest difference of the joint targets of two policies over NUM_STEPS control steps.

    Both act on the same random observations of several robots, with the previous actions of the first policy.

    Args:
        policy: First policy.
        copy: Second policy, for the same robot.

    Returns:
        Largest difference, rad.
    """
    for each in (policy, copy):
        each.reset(NUM_ROBOTS, 0)
    robot = policy.robot
    table = observation_table(robot)
    random = np.random.default_rng(0)
    difference = 0.0
    previous = np.zeros((NUM_ROBOTS, robot.num_joints), np.float32)
    command = _observe(random, table)[:, table.slices["command"]]
    for step in range(NUM_STEPS):
        observation = _observe(random, table)
        if step % NUM_COMMAND_STEPS:
            observation[:, table.slices["command"]] = command
        elif step // NUM_COMMAND_STEPS % 2:
            observation[:, table.slices["command"]] = 0.0
        command = observation[:, table.slices["command"]]
        observation[:, table.slices["previous_action"]] = previous
        action = policy.act(observation)
        difference = max(difference, float(np.abs(copy.act(observation) - action).max()))
        previous = action - robot.home_pose.astype(np.float32)
    return difference


def _observe(random: np.random.Generator, table: ObservationTable) -> np.ndarray:
    """Return random observations of several robots, with magnitudes as in a walk, (robots, components)."""
    scale = np.minimum(1.0 / table.scale, 10.0) / 2.0
    values: np.ndarray = (scale * random.standard_normal((NUM_ROBOTS, table.size))).astype(np.float32)
    gravity = values[:, table.slices["projected_gravity"]]
    gravity[:, 2] = -2.0
    gravity /= np.linalg.norm(gravity, axis=1, keepdims=True)
    return values
