"""A user's model file, MJCF or URDF: read as MuJoCo compiles it, what it holds besides the robot, a model's digest."""

import hashlib
import re
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from quad_env.files.reading import check_file, read_bytes
from quad_env.robots.anatomy import Anatomy, ModelError, anatomy
from quad_env.robots.collisions import GROUND_BIT
from quad_env.robots.held import carried_by, hold, spare_joints
from quad_env.robots.shapes import SHAPES
from quad_env.robots.urdf import urdf_spec

LARGEST_FILE = 50_000_000
"""Of an MJCF, bytes."""
_DEFAULT_LOG = "MUJOCO_LOG.TXT"

DECISIVE = (
    *("body_mass", "body_inertia", "body_pos", "body_quat", "body_ipos", "body_iquat"),
    *("jnt_pos", "jnt_axis", "jnt_range", "jnt_stiffness", "qpos_spring"),
    *("dof_armature", "dof_damping", "dof_frictionloss"),
    *("geom_type", "geom_size", "geom_pos", "geom_quat", "geom_contype", "geom_conaffinity", "geom_friction"),
    *("actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "key_qpos"),
)
"""Arrays of a model that its motion hangs on."""


def digest(names: Iterable[str], model: Any) -> str:
    """SHA-256 of the robot by its model on flat ground, see `Robot.sha256`."""
    found = hashlib.sha256(" ".join(names).encode())
    for name in DECISIVE:
        values = np.asarray(getattr(model, name)).ravel()
        values = (values & ~GROUND_BIT if name in ("geom_contype", "geom_conaffinity") else values).astype(np.float64)
        found.update(" ".join(f"{value + 0.0:.6g}" for value in values).encode())
    return found.hexdigest()


def read(path: Path) -> tuple[Any, Any, Anatomy]:
    """A file's specification, its model and what it is made of, joints that belong to no leg held."""
    import mujoco

    log_to_the_console()
    if not path.is_file():
        raise FileNotFoundError(f"{path} is no file")
    if path.stat().st_size > LARGEST_FILE:
        raise ModelError(f"it is larger than {LARGEST_FILE // 1_000_000} MB")
    try:
        check_named(path)
    except OSError as error:
        raise ModelError(f"cannot read {error.filename} ({error.strerror})") from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of attributes that are deprecated: they are read all the same
            spec = urdf_spec(mujoco, path) if path.suffix == ".urdf" else mujoco.MjSpec.from_file(str(path))
            _keep_parts(mujoco, spec)
            model = spec.compile()
            if not (spare := spare_joints(mujoco, model)):
                return spec, model, anatomy(mujoco, model)
            names = [model.joint(joint).name or f"number {joint}" for joint in spare]
            still = hold(mujoco, spec, model, spare)
    except ModelError:
        raise
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read it: {' '.join(str(error).split())}") from error
    return spec, still, replace(anatomy(mujoco, still), held=tuple(names), carried=carried_by(model, spare))


def remarks(path: Path) -> Iterator[tuple[str, str]]:
    """What the model in a user's file has that one should know of: heading and text, a line each."""
    own, model, found = read(path)
    feet = [geom for leg in found.legs for geom in leg.foot.geoms]
    names = [model.geom(geom).name or model.body(model.geom_bodyid[geom]).name for geom in feet]
    kinds = {SHAPES[int(model.geom_type[geom])] for geom in feet}
    yield "feet", f"{', '.join(names)} ({', '.join(sorted(kinds))})"
    if not found.trunk_collides(model):
        yield "trunk", "does not collide in the model: the box around what is shown of it does here"
    others = np.flatnonzero(~found.own & (model.body_parentid == 0))[1:]  # the first is the world
    scene = [f"body {model.body(int(body)).name or body}" for body in others]
    loose = sum(geom.parent.id == 0 for geom in own.geoms)
    for kind, count in (("geom", loose), ("tendon", len(own.tendons)), ("equality", len(own.equalities))):
        scene += [f"{count} {kind}{' of the world' if kind == 'geom' else ''}"] if count else []
    if scene:
        yield "left out", ", ".join(scene)


def _keep_parts(mujoco: Any, spec: Any) -> None:
    """Have the compiler keep every body, geom and frame as the file has it: parts are found by their ids."""
    for part in (spec, *spec.bodies, *spec.joints, *spec.geoms):
        compiler = part.compiler
        compiler.fusestatic = compiler.discardvisual = compiler.alignfree = 0
    for joint in spec.joints:
        joint.align = mujoco.mjtAlignFree.mjALIGNFREE_FALSE


def log_to_the_console() -> None:
    """Keep MuJoCo's warnings out of MUJOCO_LOG.TXT in the working folder; a log file that the user chose is kept."""
    import mujoco

    log = mujoco.MjLogConfig.get()
    if log.logfile == _DEFAULT_LOG:
        log.logto_file = False
        log.set()


_FILE = re.compile(r"""\bfile\w*\s*=\s*["']([^"'\0]+)["']""")
_FOLDER = re.compile(r"""\b(?:mesh|texture|asset)dir\s*=\s*["']([^"'\0]*)["']""")
_MODELS = ".xml", ".urdf"


def check_named(path: Path) -> None:
    """Raise OSError if the MJCF, or a file that it names, is no regular file or too large; what is missing is MuJoCo's
    to say."""
    todo, texts = [path], dict[Path, str]()
    while todo:
        file = todo.pop()
        text = texts[file] = read_bytes(file).decode(errors="replace")
        folders = {"", *(folder for each in texts.values() for folder in _FOLDER.findall(each))}
        for place in {path.parent / folder / name for folder in folders for name in _FILE.findall(text)}:
            if place.exists():
                check_file(place)
                if place.suffix.lower() in _MODELS and place not in texts:
                    todo.append(place)
