"""A user's model file, MJCF or URDF, as MuJoCo compiles it.

MuJoCo can crash on a file, or work on it for hours. A limited process therefore reads each file first.
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
"""Largest number of parts of a kind, as keyframes or sensors. MuJoCo's time to delete them grows with the square
of their number; published models have some hundreds at most.
"""
_LIMITED_KINDS = ("keys", "sensors", "actuators", "tendons", "equalities", "cameras", "lights", "flexes", "texts")
"""Kinds of parts with this limit: the scene deletes them, see `scene`."""
_DEFAULT_LOG = "MUJOCO_LOG.TXT"


@dataclass(frozen=True, eq=False)
class UserModel:
    """A user's model file as compiled, with the joints that belong to no leg locked; made by `read`."""

    spec: Any
    """Specification, `mujoco.MjSpec`; copy it before changing it."""
    model: Any
    """Compiled `mujoco.MjModel` of it."""
    structure: RobotStructure
    """Trunk and legs of the model."""
    modified: int
    """Modification time of the file when it was read, ns."""


def read(path: Path) -> UserModel:
    """Read a model file, after a limited process has read it.

    Args:
        path: MJCF or URDF. The files of installed packages are read here at once.

    Returns:
        The compiled model.

    Raises:
        FileNotFoundError: The file is missing.
        ModelError: MuJoCo cannot read it within its limits, or it is no quadruped.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    if not _is_installed(path):
        from quad_env.cli.limited_process import CrashError, LimitExceededError, read_limited  # here: a slow import

        try:
            read_limited(check, path, again=False)
        except LimitExceededError as error:
            raise ModelError(f"MuJoCo cannot read it: {error}") from None
        except CrashError as error:
            raise ModelError(f"MuJoCo crashes as it reads it: {error}") from None
    return _read(path)


def check(path: Path) -> None:
    """Check in a limited process that the file at `path` can be read as by `read`. Raises ModelError."""
    check_referenced_files(path)
    try:
        _read(path)
    except (ModelError, OSError, MemoryError):
        raise
    except Exception as error:
        raise ModelError(f"MuJoCo cannot read it, or lacks the memory: {format_exception(error)}") from None


@cache
def _installed_folders() -> tuple[str, ...]:
    """Return the folders of this package and of installed packages, with trusted code."""
    places = [str(Path(__file__).parents[1]), *(sysconfig.get_paths()[name] for name in ("purelib", "platlib"))]
    return tuple(os.path.realpath(place) + os.sep for place in places)


def _is_installed(path: Path) -> bool:
    return os.path.realpath(path).startswith(_installed_folders())


def _read(path: Path) -> UserModel:
    """Read a model file in this process. Raises ModelError."""
    import mujoco

    log_to_console()
    modified = path.stat().st_mtime_ns
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about deprecated attributes, which are read nevertheless
            spec, model, omissions = _compile(mujoco, path)
            model, structure = _detect_locked_structure(mujoco, spec, model)
    except ModelError:
        raise
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read it: {explain_message(str(error))}") from error
    omissions = (*omissions, *unlimited_joint_lines(model, structure.joints))
    return UserModel(spec, model, replace(structure, omission_lines=omissions), modified)


def _compile(mujoco: Any, path: Path) -> tuple[Any, Any, Lines]:
    """Return the specification of a file, its compiled model, and the lines about omitted parts. Raises ModelError."""
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
    """Lock the joints of a specification that belong to no leg; return its model and structure. Raises ModelError."""
    joints = find_non_leg_joints(mujoco, model)
    if not joints:
        return model, detect_structure(mujoco, model)
    names = tuple(model.joint(joint).name or f"number {joint}" for joint in joints)
    carried = bodies_moved_by(model, joints)
    locked = lock_joints(mujoco, spec, model, joints)
    structure = detect_structure(mujoco, locked)
    return locked, replace(structure, locked_joints=names, carried_bodies=carried)


def _check_counts(spec: Any) -> None:
    """Raise ModelError for a kind with more parts than `MAX_PARTS`."""
    for kind in _LIMITED_KINDS:
        if (count := len(getattr(spec, kind))) > MAX_PARTS:
            raise ModelError(f"it has {count} {kind}: at most {MAX_PARTS} are read")


def _inertia_lines(massless: Iterable[str], balanced: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield lines about links without a mass and about changed inertias."""
    if names := join_names(massless):
        yield "no mass", f"{names}: the URDF gives none, and shapes do not"
    if names := join_names(balanced):
        yield "inertia", f"of {names} is impossible: three equal moments of the same mean instead"


def _missing_file_lines(spec: Any) -> Iterator[tuple[str, str]]:
    """Yield a line about missing files."""
    if (files := recorded_missing_files(spec)) is not None:
        yield "not there", f"visual files, left out: {files}"


def _keep_parts(mujoco: Any, spec: Any) -> None:
    """Have the compiler keep every body, geom and frame as the file has it: parts are found by their ids."""
    for part in (spec, *spec.bodies, *spec.joints, *spec.geoms):
        compiler = part.compiler
        compiler.fusestatic = 0
        compiler.discardvisual = 0
        compiler.alignfree = 0
    for joint in spec.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE


def log_to_console() -> None:
    """Keep MuJoCo's warnings out of MUJOCO_LOG.TXT in the working folder; a log file that the user chose is kept."""
    import mujoco

    log = mujoco.MjLogConfig.get()
    if log.logfile == _DEFAULT_LOG:
        log.logto_file = False
        log.set()
