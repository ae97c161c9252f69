"""Removal of visual meshes and textures with missing files from a model, with a report."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

RECORD_NAME = "quad_env: files that are not there"
"""Name of the custom text in a specification that lists the missing files."""


def remove_missing_files(spec: Any) -> None:
    """Delete textures and meshes with missing files from a specification, with the geoms of these meshes.

    A mesh is not deleted if one of its geoms collides or gives its body a mass. MuJoCo then refuses the model and names
    the file.
    """
    missing = [*_remove_meshes(spec), *_remove_textures(spec)]
    record_missing_files(spec, missing)


def record_missing_files(spec: Any, files: list[str]) -> None:
    """Record the names of missing files, `files`, in a custom text of the specification `spec`."""
    if files:
        spec.add_text(name=RECORD_NAME, data=", ".join(files))


def recorded_missing_files(spec: Any) -> str | None:
    """Return the recorded names of missing files, joined by commas; None if no file is missing."""
    return next((str(text.data) for text in spec.texts if text.name == RECORD_NAME), None)


def _remove_meshes(spec: Any) -> Iterator[str]:
    """Delete meshes with missing files and the geoms of these meshes; yield the names of the files.

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
    """Return True if a geom collides or gives its body a mass.

    `paired` are the names of the geoms in explicit pairs.
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
    """Delete textures with missing files, also from materials; yield the names of the files."""
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
