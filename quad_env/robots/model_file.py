"""Reading and compiling of a user's model file, MJCF or URDF.

MuJoCo can crash or run for hours on an invalid file. A limited process, a subprocess with time and memory limits,
therefore reads each file first.
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
from quad_env.robots.referenced_files import check_referenced_files
from quad_env.robots.structure import ModelError, RobotStructure, detect_structure, find_root_body
from quad_env.robots.urdf import load_urdf

MAX_PARTS = 2000
"""Largest number of parts of one kind, such as keyframes or sensors.

The time in which MuJoCo deletes parts grows with the square of their number. Published models have some hundreds of
parts at most.
"""
_LIMITED_KINDS = ("keys", "sensors", "actuators", "tendons", "equalities", "cameras", "lights", "flexes", "texts")
"""Kinds of parts to which MAX_PARTS applies, because `scene` deletes all of them."""
_DEFAULT_LOG = "MUJOCO_LOG.TXT"


@dataclass(frozen=True, eq=False)
class UserModel:
    """Compiled model of a user's file, in which joints that belong to no leg are locked; made by `read`."""

    spec: Any
    """Specification of the model, `mujoco.MjSpec`; it must be copied before a change."""
    model: Any
    """Compiled `mujoco.MjModel` of `spec`."""
    structure: RobotStructure
    """Trunk and legs of the model."""
    modified: int
    """Modification time of the file when it was read, ns."""


def read(path: Path) -> UserModel:
    """Read a model file, after a limited process has read it without error.

    Args:
        path: MJCF or URDF file. A file of an installed package is trusted and read directly.

    Returns:
        The compiled model.

    Raises:
        FileNotFoundError: The file is missing.
        ModelError: MuJoCo cannot read the file within the limits, or the model is no quadruped.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    if not _is_installed(path):
        # The import is local because it is slow.
        from quad_env.cli.limited_process import CrashError, LimitExceededError, read_limited

        try:
            read_limited(check, path, again=False)
        except LimitExceededError as error:
            raise ModelError(f"MuJoCo cannot read it: {error}") from None
        except CrashError as error:
            raise ModelError(f"MuJoCo crashes as it reads it: {error}") from None
    return _read(path)


def check(path: Path) -> None:
    """Check that the model file at `path` can be read; runs in the limited process. Raises ModelError."""
    check_referenced_files(path)
    try:
        _read(path)
    except (ModelError, OSError, MemoryError):
        raise
    except Exception as error:
        raise ModelError(f"MuJoCo cannot read it, or lacks the memory: {format_exception(error)}") from None


@cache
def _installed_folders() -> tuple[str, ...]:
    """Return the folders of this package and of installed packages; the files in them are trusted."""
    places = [str(Path(__file__).parents[1]), *(sysconfig.get_paths()[name] for name in ("purelib", "platlib"))]
    return tuple(os.path.realpath(place) + os.sep for place in places)


def _is_installed(path: Path) -> bool:
    return os.path.realpath(path).startswith(_installed_folders())


def _read(path: Path) -> UserModel:
    """Read and compile a model file in this process. Raises ModelError."""
    import mujoco

    log_to_console()
    modified = path.stat().st_mtime_ns
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Ignore warnings about deprecated attributes: MuJoCo still reads them.
            spec, model, omissions = _compile(mujoco, path)
            model, structure = _detect_locked_structure(mujoco, spec, model)
    except ModelError:
        raise
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read it: {explain_message(str(error))}") from error
    omissions = (*omissions, *unlimited_joint_lines(model, structure.joints))
    return UserModel(spec, model, replace(structure, omission_lines=omissions), modified)


def _compile(mujoco: Any, path: Path) -> tuple[Any, Any, Lines]:
    """Compile a model file with corrected inertias and without missing visual files.

    Args:
        mujoco: The package `mujoco`.
        path: MJCF or URDF file.

    Returns:
        spec: Specification of the model, `mujoco.MjSpec`.
        model: Compiled `mujoco.MjModel`.
        lines: Report of the parts that the robot lacks, see `omissions`.

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
    """Lock the joints that belong to no leg. Raises ModelError.

    The new compiled model and its structure are returned.
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
    """Raise ModelError if a specification has more than `MAX_PARTS` parts of one kind."""
    for kind in _LIMITED_KINDS:
        if (count := len(getattr(spec, kind))) > MAX_PARTS:
            raise ModelError(f"it has {count} {kind}: at most {MAX_PARTS} are read")


def _inertia_lines(massless: Iterable[str], balanced: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield lines of the report about links without a mass, and about bodies with a changed inertia."""
    if names := join_names(massless):
        yield "no mass", f"{names}: the URDF gives none, and shapes do not"
    if names := join_names(balanced):
        yield "inertia", f"of {names} is impossible: three equal moments of the same mean instead"


def _missing_file_lines(spec: Any) -> Iterator[tuple[str, str]]:
    """Yield a line of the report about missing visual files, if there are any."""
    if (files := recorded_missing_files(spec)) is not None:
        yield "not there", f"visual files, left out: {files}"


def _keep_parts(mujoco: Any, spec: Any) -> None:
    """Set the compiler options so that MuJoCo keeps every body, geom and frame of the file.

    This is needed because elements of the specification are found by their ids in the compiled model.
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
