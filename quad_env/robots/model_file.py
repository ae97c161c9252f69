"""Reading and compiling of a user's model file, MJCF or URDF.

MuJoCo can crash or run for hours on an invalid file. A subprocess with limits on time and memory therefore reads each
file first; this process reads the file only if the subprocess succeeds.
"""

import os
import sysconfig
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from quad_env.files.text import format_exception
from quad_env.robots.finite_check import nonfinite_line
from quad_env.robots.inertias import compile_balanced, remove_inferred_masses
from quad_env.robots.locked_joints import bodies_moved_by, find_non_leg_joints, lock_joints
from quad_env.robots.missing_files import recorded_missing_files, remove_missing_files
from quad_env.robots.mujoco_messages import explain_message
from quad_env.robots.omissions import Lines, find_omissions, join_names, unlimited_joint_lines
from quad_env.robots.referenced_files import referenced_files
from quad_env.robots.structure import ModelError, RobotStructure, detect_structure, find_root_body
from quad_env.robots.urdf import load_urdf

MAX_PARTS = 2000
"""Largest number of parts of one type, such as keyframes or sensors, that a user's model may have.

The limit is needed because the time in which MuJoCo deletes parts grows with the square of their number. Published
models have some hundreds of parts of one type at most.
"""
_LIMITED_KINDS = ("keys", "sensors", "actuators", "tendons", "equalities", "cameras", "lights", "flexes", "texts")
"""Attributes of `mujoco.MjSpec` with the parts that `MAX_PARTS` limits.

The number of these parts is limited because an import deletes them from the user's model.
"""
_DEFAULT_LOG = "MUJOCO_LOG.TXT"
"""File to which MuJoCo writes warnings if the user has chosen no other log file."""


@dataclass(frozen=True, eq=False)
class UserModel:
    """Compiled model of a user's file, in which joints that belong to no leg are locked; made by `read`."""

    spec: Any
    """The `mujoco.MjSpec` of the file, from which `model` was compiled; copy it before changing it."""
    model: Any
    """Compiled `mujoco.MjModel` of `spec`."""
    structure: RobotStructure
    """Trunk, legs and colliding geoms that were found in `model`."""
    modified: int
    """Modification time of the file when it was read, ns; a later time shows that the file has changed."""


def read(path: Path) -> UserModel:
    """Read and compile a user's model file, after a subprocess with limits on time and memory has read it.

    Args:
        path: MJCF or URDF file. A file of an installed package is trusted and read without the subprocess.

    Returns:
        The compiled model and its detected trunk and legs.

    Raises:
        FileNotFoundError: The file is missing.
        ModelError: MuJoCo cannot read the file within the limits, or the model is no quadruped.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    if not _is_installed(path):
        # The import is here because it is slow, and because files of installed packages do not need it.
        from quad_env.cli.limited_process import CrashError, LimitExceededError, read_limited

        try:
            read_limited(check, path, again=False)
        except LimitExceededError as error:
            raise ModelError(f"MuJoCo cannot read it: {error}") from None
        except CrashError as error:
            raise ModelError(f"MuJoCo crashes as it reads it: {error}") from None
    return _read(path)


def check(path: Path) -> None:
    """Raise ModelError if the model file at `path` cannot be read.

    `read` calls this function in a subprocess with limits on time and memory.
    """
    referenced_files(path)
    try:
        _read(path)
    except (ModelError, OSError, MemoryError):
        raise
    except Exception as error:
        raise ModelError(f"MuJoCo cannot read it, or lacks the memory: {format_exception(error)}") from None


@cache
def _installed_folders() -> tuple[str, ...]:
    """Return the paths of the folders with installed packages, including the folder of this package.

    Model files in these folders are trusted.
    """
    places = [str(Path(__file__).parents[1]), *(sysconfig.get_paths()[name] for name in ("purelib", "platlib"))]
    return tuple(os.path.realpath(place) + os.sep for place in places)


def _is_installed(path: Path) -> bool:
    return os.path.realpath(path).startswith(_installed_folders())


def _read(path: Path) -> UserModel:
    """Read and compile a user's model file in this process. Raises ModelError if the model is invalid."""
    import mujoco

    log_to_console()
    modified = path.stat().st_mtime_ns
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # MuJoCo warns of deprecated attributes, but still reads them.
            spec, model, omissions = _compile(mujoco, path)
            model, structure = _detect_locked_structure(mujoco, spec, model)
    except ModelError:
        raise
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read it: {explain_message(str(error))}") from error
    omissions = (*omissions, *unlimited_joint_lines(model, structure.joints))
    return UserModel(spec, model, replace(structure, omission_lines=omissions), modified)


def _compile(mujoco: Any, path: Path) -> tuple[Any, Any, Lines]:
    """Compile a user's model file.

    Impossible inertias are corrected, and visual parts with missing files are removed.

    Args:
        mujoco: The package `mujoco`.
        path: MJCF or URDF file.

    Returns:
        spec: The `mujoco.MjSpec` of the file after these changes.
        model: Compiled `mujoco.MjModel` of `spec`.
        lines: Report about the parts of the file that the imported robot does not have: heading and text of each line.

    Raises:
        ModelError: The model is invalid.
    """
    is_urdf = path.suffix == ".urdf"
    spec = load_urdf(mujoco, path) if is_urdf else mujoco.MjSpec.from_file(str(path))
    _check_counts(spec)
    remove_missing_files(spec)
    _keep_parts(mujoco, spec)
    massless = remove_inferred_masses(spec) if is_urdf else ()
    model, balanced = compile_balanced(mujoco, spec)
    if (line := nonfinite_line(model)) is not None:
        raise ModelError(line)
    lines = find_omissions(mujoco, spec, model, find_root_body(mujoco, model))
    return spec, model, (*lines, *_inertia_lines(massless, balanced), *_missing_file_lines(spec))


def _detect_locked_structure(mujoco: Any, spec: Any, model: Any) -> tuple[Any, RobotStructure]:
    """Lock the joints that belong to no leg, and detect the trunk and the legs.

    A model that is not a quadruped with four legs of three hinges raises ModelError.

    Args:
        mujoco: The package `mujoco`.
        spec: The `mujoco.MjSpec` of the user's file; it is changed if joints are locked.
        model: Compiled `mujoco.MjModel` of `spec`.

    Returns:
        model: Compiled `mujoco.MjModel` with locked joints; `model` itself if no joint is locked.
        structure: Trunk and legs of this model.
    """
    joints = find_non_leg_joints(mujoco, model)
    if not joints:
        return model, detect_structure(mujoco, model)
    names = tuple(model.joint(joint).name or f"number {joint}" for joint in joints)
    carried = bodies_moved_by(model, joints)
    locked = lock_joints(mujoco, spec, model, joints)
    structure = detect_structure(mujoco, locked)
    return locked, replace(structure, locked_joints=names, carried_bodies=carried)


def _check_counts(spec: Any) -> None:
    """Raise ModelError if a `mujoco.MjSpec` has more than `MAX_PARTS` parts of one kind, such as sensors."""
    for kind in _LIMITED_KINDS:
        if (count := len(getattr(spec, kind))) > MAX_PARTS:
            raise ModelError(f"it has {count} {kind}: at most {MAX_PARTS} are read")


def _inertia_lines(massless: Iterable[str], balanced: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield lines of the import report about links without a mass and bodies with a corrected inertia.

    Args:
        massless: Names of the links of a URDF that have colliding shapes but no mass.
        balanced: Names of the bodies with an impossible inertia, which has been replaced.

    Yields:
        Heading and text of a line.
    """
    if names := join_names(massless):
        yield "no mass", f"{names}: the URDF gives none, and shapes do not"
    if names := join_names(balanced):
        yield "inertia", f"of {names} is impossible: three equal moments of the same mean instead"


def _missing_file_lines(spec: Any) -> Iterator[tuple[str, str]]:
    """Yield a line of the import report, heading and text, about missing visual files.

    No line is yielded if no file is missing.
    """
    if (files := recorded_missing_files(spec)) is not None:
        yield "not there", f"visual files, left out: {files}"


def _keep_parts(mujoco: Any, spec: Any) -> None:
    """Set MuJoCo's compiler options so that it keeps every body, geom and frame of the file.

    The function is needed because the elements of the `mujoco.MjSpec` are later found by their ids in the compiled
    model.
    """
    for part in (spec, *spec.bodies, *spec.joints, *spec.geoms):
        compiler = part.compiler
        compiler.fusestatic = 0
        compiler.discardvisual = 0
        compiler.alignfree = 0
    for joint in spec.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE


def log_to_console() -> None:
    """Stop MuJoCo from writing warnings to MUJOCO_LOG.TXT in the working folder.

    A log file that the user has chosen is still written.
    """
    import mujoco

    log = mujoco.MjLogConfig.get()
    if log.logfile == _DEFAULT_LOG:
        log.logto_file = False
        log.set()
