"""URDF files: prepared for MuJoCo's reader, with their meshes found in packages and next to the file."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from quad_env.files.reading import read_bytes
from quad_env.robots.missing_files import record_missing_files
from quad_env.robots.structure import ModelError

MESH_SUFFIXES = (".stl", ".obj", ".msh")
"""Endings of the meshes that MuJoCo reads from a URDF."""
MIN_LINK_INERTIA = 1e-12
"""kg·m². Smaller moments of a link become 0: converters write them for links that are mere frames, and MuJoCo refuses
them.
"""
_PACKAGE = re.compile(r"(?:package|model)://([^/]+)/(.*)")


def load_urdf(mujoco: Any, path: Path) -> Any:
    """Return the `mujoco.MjSpec` of a URDF; visual shapes with meshes that MuJoCo does not read are left out.

    The root link gets a free joint. Its functions raise ModelError for a file that is no XML, and for a collision mesh
    that is missing or that MuJoCo does not read.

    Args:
        mujoco: The package.
        path: The file.

    Returns:
        The `mujoco.MjSpec` of a URDF; visual shapes with meshes that MuJoCo does not read are left out.

    Raises:
        ModelError: The file is no XML.
    """
    try:
        robot = ElementTree.fromstring(read_bytes(path))
    except ElementTree.ParseError as error:
        raise ModelError(f"it is no URDF: {error}") from error
    folder = _set_compiler_options(robot).get("meshdir", "")
    missing = _remove_unreadable_visuals(robot, path, folder)
    _zero_tiny_inertias(robot)
    files = _number_meshes(robot, path, folder)
    spec = mujoco.MjSpec.from_string(ElementTree.tostring(robot, encoding="unicode"))
    record_missing_files(spec, missing)
    for mesh in spec.meshes:
        mesh.file = str(files[mesh.file])
    if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints) and spec.bodies[1:]:
        spec.bodies[1].add_freejoint()
    return spec


def _set_compiler_options(robot: ElementTree.Element) -> ElementTree.Element:
    """Have MuJoCo keep all shapes and links, and the inertias of the file; return its compiler element."""
    extension = robot.find("mujoco")
    extension = ElementTree.SubElement(robot, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib.update(discardvisual="false", fusestatic="false")
    compiler.attrib.setdefault("inertiafromgeom", "false")
    return compiler


def _remove_unreadable_visuals(robot: ElementTree.Element, path: Path, folder: str) -> list[str]:
    """Remove visual shapes with unreadable or missing meshes; return the names of the missing ones."""
    missing: list[str] = []
    for link in robot.iter("link"):
        for visual in link.findall("visual"):
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            name = mesh.get("filename", "")
            if not _is_readable(name):
                link.remove(visual)
            elif not _mesh_exists(path, folder, name):
                link.remove(visual)
                missing.append(name)
    return missing


def _zero_tiny_inertias(robot: ElementTree.Element) -> None:
    """Set inertias to 0 with all moments below `MIN_LINK_INERTIA`."""
    for inertia in robot.iter("inertia"):
        if all(abs(float(moment)) < MIN_LINK_INERTIA for moment in inertia.attrib.values()):
            inertia.attrib.update(dict.fromkeys(inertia.attrib, "0"))


def _number_meshes(robot: ElementTree.Element, path: Path, folder: str) -> dict[str, Path]:
    """Name the meshes by numbers and return the file of each name.

    MuJoCo takes two files of one name in two folders for the same file.
    """
    files: dict[str, Path] = {}
    for mesh in robot.iter("mesh"):
        file = _find_mesh(path, folder, mesh.get("filename", ""))
        number = next((number for number, known in files.items() if known == file), f"{len(files)}{file.suffix}")
        files[number] = file
        mesh.set("filename", number)
    return files


def _mesh_exists(path: Path, folder: str, name: str) -> bool:
    """Return whether the mesh file that a URDF names exists."""
    try:
        _find_mesh(path, folder, name)
    except ModelError:
        return False
    return True


def _is_readable(name: str) -> bool:
    return Path(name).suffix.lower() in MESH_SUFFIXES


def _find_mesh(path: Path, folder: str, name: str) -> Path:
    """Return the file of a mesh, in the package of its URDF or next to the URDF.

    Args:
        path: The URDF.
        folder: Its `meshdir`.
        name: Name of the mesh in the URDF, as `package://robot/meshes/thigh.stl`.

    Returns:
        The file of a mesh, in the package of its URDF or next to the URDF.

    Raises:
        ModelError: MuJoCo does not read its kind, or the file is missing.
    """
    if not _is_readable(name):
        raise ModelError(f"MuJoCo cannot read it: convert {name!r}, which collides, to {' or '.join(MESH_SUFFIXES)}")
    here = path.resolve().parent
    package = _PACKAGE.fullmatch(name)
    inner = package[2] if package else name.removeprefix("file://")
    places = [here / folder / inner, here / inner, here.parent / inner, here / folder / Path(inner).name]
    if package:
        places = [*(above / package[1] / inner for above in (here, *here.parents)), *places]
    for place in places:
        if place.exists():
            return place
    raise ModelError(f"the mesh {name!r} is no file: it is looked for next to {path.name} and in its package")
