"""Removal of visual meshes and textures with missing files from a user's model.

The names of the missing files are recorded, so that they can be reported to the user.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

RECORD_NAME = "quad_env: files that are not there"
"""Name of the custom text element in which a `mujoco.MjSpec` stores the names of its missing files."""


def remove_missing_files(spec: Any) -> None:
    """Delete visual meshes and textures with missing files from a `mujoco.MjSpec`; record the files.

    The geoms of a deleted mesh are deleted, too. A mesh is not deleted if one of its geoms collides or gives its body a
    mass, because the motion depends on this mesh: MuJoCo then refuses the model and names the file.
    """
    missing = [*_remove_meshes(spec), *_remove_textures(spec)]
    record_missing_files(spec, missing)


def record_missing_files(spec: Any, files: list[str]) -> None:
    """Store the names of missing files, `files`, in a custom text element of the `mujoco.MjSpec` `spec`.

    Args:
        spec: The `mujoco.MjSpec`, which is changed in place.
        files: Names of the missing files; if there are none, `spec` is not changed.
    """
    if files:
        spec.add_text(name=RECORD_NAME, data=", ".join(files))


def recorded_missing_files(spec: Any) -> str | None:
    """Return the names of missing files that `record_missing_files` has stored in a `mujoco.MjSpec`.

    The names are joined by commas. The result is None if no file is missing.
    """
    return next((str(text.data) for text in spec.texts if text.name == RECORD_NAME), None)


def _remove_meshes(spec: Any) -> Iterator[str]:
    """Delete meshes with missing files from a `mujoco.MjSpec`, with their geoms; yield the files' names.

    A mesh is kept if one of its geoms collides or gives its body a mass, or if no geom uses the mesh.
    """
    paired = {name for pair in spec.pairs for name in (pair.geomname1, pair.geomname2)}
    for mesh in list(spec.meshes):
        if not mesh.file or _exists(spec, mesh.file, mesh.compiler.meshdir):
            continue
        users = [geom for geom in spec.geoms if geom.meshname == mesh.name]
        if users and not any(_collides_or_weighs(geom, paired) for geom in users):
            for geom in users:
                spec.delete(geom)
            yield mesh.file
            spec.delete(mesh)


def _collides_or_weighs(geom: Any, paired: set[str]) -> bool:
    """Return True if a geom affects the motion, because it can collide or gives its body a mass.

    Args:
        geom: Geom of a `mujoco.MjSpec`.
        paired: Names of the geoms in explicit geom pairs, which can collide without a collision bit.

    Returns:
        False if the geom is only visual.
    """
    if geom.contype or geom.conaffinity or (geom.name and geom.name in paired):
        return True
    compiler = geom.parent.compiler
    first, last = compiler.inertiagrouprange
    if geom.parent.id == 0 or not first <= geom.group <= last:
        return False
    is_massless = geom.mass == 0.0 or geom.density == 0.0
    is_given = bool(geom.parent.explicitinertial) and int(compiler.inertiafromgeom) != 1
    return not (is_massless or is_given)


def _remove_textures(spec: Any) -> Iterator[str]:
    """Delete textures with missing files from a `mujoco.MjSpec` and its materials.

    The names of the missing files are yielded.
    """
    for texture in list(spec.textures):
        if not texture.file or _exists(spec, texture.file, spec.compiler.texturedir):
            continue
        for material in spec.materials:
            material.textures = ["" if name == texture.name else name for name in material.textures]
        yield texture.file
        spec.delete(texture)


def _exists(spec: Any, file: str, folder: str) -> bool:
    name = Path(file).name if spec.strippath else file
    places = (Path(spec.modelfiledir) / folder / name, Path(spec.modelfiledir) / name)
    return any(place.is_file() for place in places)
