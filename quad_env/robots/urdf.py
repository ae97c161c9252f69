"""A URDF as MuJoCo reads it, with its meshes found, what is only seen of it kept, and its root link free to move."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from quad_env.files.reading import check_file, read_bytes
from quad_env.robots.anatomy import ModelError

READABLE = ".stl", ".obj", ".msh"
"""Endings of the meshes that MuJoCo reads."""
LEAST_INERTIA = 1e-12
"""Of a link, kg·m²; converters write less for links that are mere frames, and MuJoCo refuses such rounding."""
_PACKAGE = re.compile(r"(?:package|model)://([^/]+)/(.*)")


def urdf_spec(mujoco: Any, path: Path) -> Any:
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
    for link in robot.iter("link"):
        for seen in link.findall("visual"):
            mesh = seen.find("geometry/mesh")
            if mesh is not None and not _readable(mesh.get("filename", "")):
                link.remove(seen)
    for inertia in robot.iter("inertia"):
        if all(abs(float(moment)) < LEAST_INERTIA for moment in inertia.attrib.values()):
            inertia.attrib.update(dict.fromkeys(inertia.attrib, "0"))
    files: dict[str, Path] = {}
    for mesh in robot.iter("mesh"):  # by numbers: MuJoCo takes two files of one name in two folders for one
        file = _found(path, compiler.get("meshdir", ""), mesh.get("filename", ""))
        number = next((number for number, known in files.items() if known == file), f"{len(files)}{file.suffix}")
        files[number] = file
        mesh.set("filename", number)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    for mesh in spec.meshes:
        mesh.file = str(files[mesh.file])
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints) and spec.bodies[1:]:
        spec.bodies[1].add_freejoint()
    return spec


def _readable(name: str) -> bool:
    return Path(name).suffix.lower() in READABLE


def _found(path: Path, folder: str, name: str) -> Path:
    """The file of a mesh that a URDF at that path names, in its package or next to it. Raises ModelError, OSError."""
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
            check_file(place)
            return place
    raise ModelError(f"the mesh {name!r} is no file: it is looked for next to {path.name} and in its package")
