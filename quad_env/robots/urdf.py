"""Loading of URDF files into MuJoCo; mesh files are searched in ROS packages and next to the URDF."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from quad_env.files.reading import read_bytes
from quad_env.robots.missing_files import record_missing_files
from quad_env.robots.structure import ModelError

MESH_SUFFIXES = (".stl", ".obj", ".msh")
"""Endings of the names of mesh files that MuJoCo can read from a URDF."""
MIN_LINK_INERTIA = 1e-12
"""Smallest moment of inertia of a link in a URDF that is kept, kg·m².

If all moments of an inertia are smaller, they are set to 0. File converters write these small moments for links that
are only frames, and MuJoCo refuses them.
"""
_PACKAGE = re.compile(r"(?:package|model)://([^/]+)/(.*)")
"""Pattern of a mesh name with a ROS package: name of the package, and path of the file in the package."""


def load_urdf(mujoco: Any, path: Path) -> Any:
    """Load a URDF as a `mujoco.MjSpec`. The root link gets a free joint if the URDF has none.

    A visual shape is left out if its mesh file is missing or has a format that MuJoCo cannot read. For a collision
    shape with this fault, ModelError is raised.

    Args:
        mujoco: The package `mujoco`.
        path: The URDF file.

    Returns:
        The `mujoco.MjSpec` of the robot.

    Raises:
        ModelError: The file is no valid XML.
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
    """Set compiler options in a URDF so that MuJoCo keeps its visual shapes, fixed links and inertias.

    Args:
        robot: Root element of the URDF, which is changed.

    Returns:
        The element `compiler` with all compiler options.
    """
    extension = robot.find("mujoco")
    extension = ElementTree.SubElement(robot, "mujoco") if extension is None else extension
    compiler = extension.find("compiler")
    compiler = ElementTree.SubElement(extension, "compiler") if compiler is None else compiler
    compiler.attrib.update(discardvisual="false", fusestatic="false")
    compiler.attrib.setdefault("inertiafromgeom", "false")
    return compiler


def _remove_unreadable_visuals(robot: ElementTree.Element, path: Path, folder: str) -> list[str]:
    """Remove visual shapes from a URDF if their mesh file is missing or unreadable for MuJoCo.

    Args:
        robot: Root element of the URDF, which is changed.
        path: The URDF file.
        folder: Value of the compiler option `meshdir` in the URDF.

    Returns:
        Names of the missing mesh files.
    """
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
    """Set each inertia in a URDF to 0 if all of its moments are below `MIN_LINK_INERTIA`.

    `robot` is the root element of the URDF, which is changed.
    """
    for inertia in robot.iter("inertia"):
        if all(abs(float(moment)) < MIN_LINK_INERTIA for moment in inertia.attrib.values()):
            inertia.attrib.update(dict.fromkeys(inertia.attrib, "0"))


def _number_meshes(robot: ElementTree.Element, path: Path, folder: str) -> dict[str, Path]:
    """Replace the file names of the meshes in a URDF by unique numbers such as `3.stl`.

    The numbers are needed because MuJoCo considers two files with the same name in different folders as the same file.

    Args:
        robot: Root element of the URDF, which is changed.
        path: The URDF file.
        folder: Value of the compiler option `meshdir` in the URDF.

    Returns:
        New name of a mesh -> path of its file.
    """
    files: dict[str, Path] = {}
    for mesh in robot.iter("mesh"):
        file = _find_mesh(path, folder, mesh.get("filename", ""))
        number = next((number for number, known in files.items() if known == file), f"{len(files)}{file.suffix}")
        files[number] = file
        mesh.set("filename", number)
    return files


def _mesh_exists(path: Path, folder: str, name: str) -> bool:
    """Return True if a mesh file that a URDF names exists, see `_find_mesh`.

    Args:
        path: The URDF file.
        folder: Value of the compiler option `meshdir` in the URDF.
        name: Name of the mesh file in the URDF.

    Returns:
        False if the file is missing or MuJoCo cannot read its format.
    """
    try:
        _find_mesh(path, folder, name)
    except ModelError:
        return False
    return True


def _is_readable(name: str) -> bool:
    return Path(name).suffix.lower() in MESH_SUFFIXES


def _find_mesh(path: Path, folder: str, name: str) -> Path:
    """Find the file of a mesh, in the ROS package that the URDF names, or next to the URDF.

    Args:
        path: The URDF file.
        folder: Value of the compiler option `meshdir` in the URDF.
        name: Name of the mesh in the URDF, such as `package://robot/meshes/thigh.stl`.

    Returns:
        Path of the mesh file.

    Raises:
        ModelError: MuJoCo cannot read meshes of this type, or the file is missing.
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
