"""A user's model file, MJCF or URDF: read as MuJoCo compiles it, what it holds besides the robot, a model's digest."""

import hashlib
import os
import re
import sysconfig
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from quad_env.files.reading import check_file, read_bytes
from quad_env.files.text import format_exception
from quad_env.robots.collision_rules import GROUND_BIT
from quad_env.robots.finite_check import nonfinite_line
from quad_env.robots.inertias import compile_balanced, remove_inferred_masses
from quad_env.robots.locked_joints import bodies_moved_by, find_non_leg_joints, lock_joints
from quad_env.robots.missing_files import missing_files, record_missing_files, remove_missing_files
from quad_env.robots.mujoco_messages import explain_message
from quad_env.robots.omissions import CONTACT, find_omissions, join_names, unlimited_joint_lines
from quad_env.robots.structure import ModelError, RobotStructure, detect_structure, find_root_body

READABLE = ".stl", ".obj", ".msh"
"""Endings of the meshes that MuJoCo reads, of a URDF."""
MIN_LINK_INERTIA = 1e-12
"""Of a URDF's link, kg·m²; converters write less for links that are mere frames, which MuJoCo refuses."""
_PACKAGE = re.compile(r"(?:package|model)://([^/]+)/(.*)")
_FILES = re.compile(rb"""\b(?:file|filename)\s*=\s*(["'])([^"'<>\0]{1,1000})\1""")
_FOLDERS = re.compile(rb"""\b(?:meshdir|texturedir|assetdir)\s*=\s*(["'])([^"'<>\0]{1,1000})\1""")
_MAX_FILES = 5000
"""Largest number of checked files of a model."""
_LARGEST_MESH = 2**28
"""Byte. Largest file of a model; the largest published meshes have 50 MiB."""
MAX_PARTS = 2000
"""Keyframes, sensors and other such parts, of each kind; MuJoCo takes a time that grows with their square to delete
them. Published models have some hundreds at most."""
_DELETED = "keys", "sensors", "actuators", "tendons", "equalities", "cameras", "lights", "flexes", "texts"
"""Kinds of parts that a robot's model has not from its file, see `arena`."""
_DEFAULT_LOG = "MUJOCO_LOG.TXT"

DIGEST_FIELDS = (
    *("body_mass", "body_inertia", "body_pos", "body_quat", "body_ipos", "body_iquat"),
    *("jnt_pos", "jnt_axis", "jnt_range", "jnt_stiffness", "qpos_spring"),
    *("dof_armature", "dof_damping", "dof_frictionloss"),
    *("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_conaffinity", "geom_friction"),
    *("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "key_qpos"),
)
"""Arrays of a model that its motion hangs on."""
OPTIONAL_DIGEST_FIELDS = "jnt_stiffnesspoly", "dof_dampingpoly"
"""Arrays that are zero in most models and enter digests only if not zero, since digests are older."""


def digest(names: Iterable[str], model: Any) -> str:
    """SHA-256 of the robot by its model on flat ground, see `Robot.sha256`."""
    found = hashlib.sha256(" ".join(names).encode())
    for name in (*DIGEST_FIELDS, *(name for name in OPTIONAL_DIGEST_FIELDS if getattr(model, name).any())):
        values = np.asarray(getattr(model, name)).ravel()
        values = (values & ~GROUND_BIT if name in ("geom_contype", "geom_conaffinity") else values).astype(np.float64)
        found.update(" ".join(f"{value + 0.0:.6g}" for value in values).encode())
    return found.hexdigest()


def read(path: Path) -> tuple[Any, Any, RobotStructure]:
    """Read a file: its specification, its model and its parts, with the joints of no leg held.

    A limited process reads the file first: MuJoCo can crash on a file, or work on it for hours.
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
    """Read a file as `read` does, in a limited process, and check the sizes of the files that it names.

    Raises ModelError for an unreadable file.
    """
    _check_files(path)
    try:
        _read(path)
    except (ModelError, OSError, MemoryError):
        raise
    except Exception as error:
        raise ModelError(f"MuJoCo cannot read it, or lacks the memory: {format_exception(error)}") from None


def _check_files(path: Path) -> None:
    """Raise ModelError for a file that a model names and that is too large or not regular."""
    waiting = [path]
    seen = set[Path]()
    while waiting:
        model = waiting.pop()
        try:
            text = read_bytes(model)
        except OSError as error:
            raise ModelError(f"{model.name} cannot be read ({error.strerror})") from None
        folders = {b"", *(found[2] for found in _FOLDERS.finditer(text))}
        for found in _FILES.finditer(text):
            for folder in folders:
                file = path.parent / os.fsdecode(folder) / os.fsdecode(found[2])
                if file in seen or len(seen) > _MAX_FILES:
                    continue
                seen.add(file)
                try:
                    check_file(file, _LARGEST_MESH)
                except (FileNotFoundError, NotADirectoryError, ValueError):  # MuJoCo reports missing files
                    continue
                except OSError as error:
                    if not file.is_dir():
                        raise ModelError(
                            f"the file {file.name} that it names cannot be read: {error.strerror}"
                        ) from None
                    continue
                if file.suffix.lower() in (".xml", ".mjcf", ".urdf"):
                    waiting.append(file)


@cache
def _installed() -> tuple[str, ...]:
    """Return the folders of this package and of installed ones: their code runs anyway."""
    places = [str(Path(__file__).parents[1]), *(sysconfig.get_paths()[name] for name in ("purelib", "platlib"))]
    return tuple(os.path.realpath(place) + os.sep for place in places)


def _is_installed(path: Path) -> bool:
    return os.path.realpath(path).startswith(_installed())


def _read(path: Path) -> tuple[Any, Any, RobotStructure]:
    import mujoco

    log_to_console()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of attributes that are deprecated: they are read all the same
            is_urdf = path.suffix == ".urdf"
            spec = _urdf_spec(mujoco, path) if is_urdf else mujoco.MjSpec.from_file(str(path))
            _check_counts(spec)
            remove_missing_files(spec)
            _keep_parts(mujoco, spec)
            massless = remove_inferred_masses(spec) if is_urdf else ()
            model, balanced = compile_balanced(mujoco, spec)
            if (line := nonfinite_line(model)) is not None:
                raise ModelError(line)
            omitted = (
                *find_omissions(mujoco, spec, model, find_root_body(mujoco, model)),
                *_about_inertias(massless, balanced),
                *_about_files(spec),
            )
            if not (spare := find_non_leg_joints(mujoco, model)):
                found = detect_structure(mujoco, model)
                return (
                    spec,
                    model,
                    replace(found, omission_lines=(*omitted, *unlimited_joint_lines(model, found.joints))),
                )
            names = [model.joint(joint).name or f"number {joint}" for joint in spare]
            still = lock_joints(mujoco, spec, model, spare)
    except ModelError:
        raise
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read it: {explain_message(str(error))}") from error
    found = detect_structure(mujoco, still)
    omitted = (*omitted, *unlimited_joint_lines(still, found.joints))
    return (
        spec,
        still,
        replace(
            found, locked_joints=tuple(names), carried_bodies=bodies_moved_by(model, spare), omission_lines=omitted
        ),
    )


def _check_counts(spec: Any) -> None:
    """Raise ModelError for more parts of a kind than are read."""
    for kind in _DELETED:
        if (count := len(getattr(spec, kind))) > MAX_PARTS:
            raise ModelError(f"it has {count} {kind}: at most {MAX_PARTS} are read")


def _about_inertias(massless: Iterable[str], balanced: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield lines about links without a mass and about changed inertias."""
    if names := join_names(massless):
        yield "no mass", f"{names}: the URDF gives none, and shapes do not"
    if names := join_names(balanced):
        yield "inertia", f"of {names} is impossible: three equal moments of the same mean instead"


def _about_files(spec: Any) -> Iterator[tuple[str, str]]:
    """Yield a line about missing files."""
    if (files := missing_files(spec)) is not None:
        yield "not there", f"visual files, left out: {files}"


def describe_extras(path: Path, keeps_contact: bool = False) -> Iterator[tuple[str, str]]:
    """Yield the remarks on the model in a user's file: heading and text of each line.

    `keeps_contact`: whether the robot keeps the contact parameters, see `Figures.keeps_contact`.
    """
    import mujoco

    _, model, found = read(path)
    feet = [geom for leg in found.legs for geom in leg.foot.geoms]
    names = [model.geom(geom).name or model.body(model.geom_bodyid[geom]).name for geom in feet]
    kinds = {mujoco.mjtGeom(int(model.geom_type[geom])).name.removeprefix("mjGEOM_").lower() for geom in feet}
    yield "feet", f"{', '.join(names)} ({', '.join(sorted(kinds))})"
    if not found.trunk_collides(model):
        yield "trunk", "does not collide in the model: the box around what is shown of it does here"
    yield from _remark_lines(found, keeps_contact)


def omitted_from(path: Path, keeps_contact: bool = False) -> Iterator[tuple[str, str]]:
    """Yield the parts of a user's model that the robot lacks, the last lines of `remarks`."""
    yield from _remark_lines(read(path)[2], keeps_contact)


def _remark_lines(found: RobotStructure, keeps_contact: bool) -> Iterator[tuple[str, str]]:
    yield from (line for line in found.omission_lines if not (keeps_contact and line[0] == CONTACT))


def _keep_parts(mujoco: Any, spec: Any) -> None:
    """Have the compiler keep every body, geom and frame as the file has it: parts are found by their ids."""
    for part in (spec, *spec.bodies, *spec.joints, *spec.geoms):
        compiler = part.compiler
        compiler.fusestatic = compiler.discardvisual = compiler.alignfree = 0
    for joint in spec.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE


def log_to_console() -> None:
    """Keep MuJoCo's warnings out of MUJOCO_LOG.TXT in the working folder; a log file that the user chose is kept."""
    import mujoco

    log = mujoco.MjLogConfig.get()
    if log.logfile == _DEFAULT_LOG:
        log.logto_file = False
        log.set()


def _urdf_spec(mujoco: Any, path: Path) -> Any:
    """A URDF's `mujoco.MjSpec`; shapes that are only seen, and whose meshes MuJoCo does not read, are left out.

    Raises:
        ModelError: it is no XML, or a mesh is not there or of a kind that MuJoCo does not read.
        ValueError: from MuJoCo, of what it does not read.
    """
    try:
        robot = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise ModelError(f"it is no URDF: {error}") from error
    extension = robot.find("mujoco")
    extension = ElementTree.SubElement(robot, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib.update(discardvisual="false", fusestatic="false")
    compiler.attrib.setdefault("inertiafromgeom", "false")
    missing: list[str] = []
    for link in robot.iter("link"):
        for seen in link.findall("visual"):
            mesh = seen.find("geometry/mesh")
            name = "" if mesh is None else mesh.get("filename", "")
            if mesh is not None and not _readable(name):
                link.remove(seen)
            elif mesh is not None and not _mesh_exists(path, compiler.get("meshdir", ""), name):
                link.remove(seen)
                missing.append(name)
    for inertia in robot.iter("inertia"):
        if all(abs(float(moment)) < MIN_LINK_INERTIA for moment in inertia.attrib.values()):
            inertia.attrib.update(dict.fromkeys(inertia.attrib, "0"))
    files: dict[str, Path] = {}
    for mesh in robot.iter("mesh"):  # by numbers: MuJoCo takes two files of one name in two folders for one
        file = _found(path, compiler.get("meshdir", ""), mesh.get("filename", ""))
        number = next((number for number, known in files.items() if known == file), f"{len(files)}{file.suffix}")
        files[number] = file
        mesh.set("filename", number)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    record_missing_files(spec, missing)
    for mesh in spec.meshes:
        mesh.file = str(files[mesh.file])
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints) and spec.bodies[1:]:
        spec.bodies[1].add_freejoint()
    return spec


def _mesh_exists(path: Path, folder: str, name: str) -> bool:
    """Return whether the mesh file that a URDF names exists."""
    try:
        _found(path, folder, name)
    except ModelError:
        return False
    return True


def _readable(name: str) -> bool:
    return Path(name).suffix.lower() in READABLE


def _found(path: Path, folder: str, name: str) -> Path:
    """The file of a mesh that a URDF at that path names, in its package or next to it. Raises ModelError."""
    if not _readable(name):
        raise ModelError(f"MuJoCo cannot read it: convert {name!r}, which collides, to {' or '.join(READABLE)}")
    here = path.resolve().parent
    within = _PACKAGE.fullmatch(name)
    inner = within[2] if within else name.removeprefix("file://")
    places = [here / folder / inner, here / inner, here.parent / inner, here / folder / Path(inner).name]
    if within:
        places = [*(above / within[1] / inner for above in (here, *here.parents)), *places]
    for place in places:
        if place.exists():
            return place
    raise ModelError(f"the mesh {name!r} is no file: it is looked for next to {path.name} and in its package")
