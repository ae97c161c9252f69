"""`python -m train export`: a trained policy as one ONNX file, or as deployment files of another project.

Without --to, the policy becomes an ONNX file with its base and all settings, which every command takes where it takes
policies. With --to, a policy that is a network becomes a folder with the files that a project deploys on robots.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from evaluate.hardware import HardwareConfig, parse_robot_option
from policies import bundle
from policies.external import onnx_file
from policies.shipped import models_folder
from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.robots.robot import Robot

NUM_CHECKED = 10_000
"""Number of random observations for the check of an ONNX file.

The check compares the outputs of the ONNX file and of the policy bundle for these observations."""
RESULTS = Path("results")
"""Folder of the default of --out."""


@dataclass(frozen=True)
class ExportOptions:
    """Export a trained policy as an ONNX file, or with --to as deployment files of another project."""

    folder: Annotated[Path, tyro.conf.Positional] = Path("models/residual")
    """Folder of a trained policy or of a training run, or the name of a trained policy, such as end_to_end."""
    to: Literal["unitree", "mjlab", "isaac-lab", "rl-sar", "toml"] | None = None
    """Format of the deployment files: unitree (deploy.yaml and ONNX), mjlab (ONNX with metadata), isaac-lab (env.yaml,
    ONNX and TorchScript), rl-sar (base.yaml, config.yaml and TorchScript) or toml (this project's, which describes
    everything). Default: one ONNX file of this project."""
    robot: str | None = None
    """Robot of the policy, if not a built-in one: the path of its MJCF, URDF or TOML."""
    out: Path | None = None
    """File to write, or with --to a folder that is new or empty. Default: results/residual.onnx, or results/FORMAT."""


def main(options: ExportOptions) -> int:
    """Write the file or the folder and return the exit code.

    Raises UsageError, PolicyError or OSError if the policy cannot be exported.
    """
    robot = None if options.robot is None else parse_robot_option(options.robot).robot_model
    policy = _find_policy(options.folder, robot)
    if options.to is None:
        _export_file(policy, options.out or RESULTS / "residual.onnx", robot)
    else:
        _export_folder(policy, options.to, options.out or RESULTS / options.to, robot)
    return 0


def _find_policy(folder: Path, robot: Robot | None) -> Path:
    """Return the folder of a policy: the `folder` itself, or the trained policy of the robot with this name."""
    shipped = models_folder(robot or HardwareConfig().robot_model) / folder.name
    is_name = len(folder.parts) == 1 and not folder.exists() and shipped.is_dir()
    return shipped if is_name else folder


def _export_file(policy: Path, out: Path, robot: Robot | None) -> None:
    """Write one ONNX file and print its difference from the bundle."""
    if out.suffix != ".onnx":
        raise UsageError(f"--out must be an .onnx, not {out}")
    make_folder_of(out, "--out")
    error = onnx_file.export_residual(policy, out, NUM_CHECKED, robot)
    print(f"{out}: agrees with the bundle at {NUM_CHECKED:,} random observations to {error:.1e} of the authority")


def _export_folder(policy: Path, to: str, out: Path, robot: Robot | None) -> None:
    """Write a folder of deployment files and print its difference from the bundle."""
    # The module is imported here, because --help must answer at once.
    from train.export.export import NUM_STEPS, export

    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"--out: must be a new or an empty folder, got {out}")
    make_folder_of(out.absolute().with_name("README.md"), "--out")
    result = export(bundle.load(policy, robot, servo="own"), str(policy), to, out)
    print(f"{out}: read back, the joint targets agree to {result.difference:.1e} rad over {NUM_STEPS} steps")
    if not result.has_program:
        print(f"{out}: no run.py, because a colliding part of the robot is a mesh")
