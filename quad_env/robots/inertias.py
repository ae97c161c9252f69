"""Correction of impossible and missing inertias of a user's model; the functions return the changed bodies.

An inertia is impossible if a principal moment is not above 0 or exceeds the sum of the other two. The impossible
inertia is replaced by three equal moments with the same mean, as MuJoCo's option `balanceinertia` does.
"""

from typing import Any

import numpy as np

from quad_env.robots.shapes import Floats
from quad_env.robots.structure import ModelError

UNBALANCED_MESSAGE = "A + B >= C"
"""Part of the error message of MuJoCo's compiler about a moment of inertia above the sum of the other two."""
NOT_POSITIVE_MESSAGE = "positive eigenvalues"
"""Part of the error message of MuJoCo's compiler about a principal moment of inertia that is not above 0."""
TOO_SMALL_MESSAGE = "must be larger than mjMINVAL"
"""Part of the error message of MuJoCo's compiler about a mass or inertia below `MIN_INERTIA`."""
MIN_INERTIA = 1e-15
"""Smallest mass, kg, and moment of inertia, kg·m², that MuJoCo accepts for a moving body: its constant mjMINVAL."""
INERTIA_FROM_GEOMS = 1
"""Value of the compiler option `inertiafromgeom` with which MuJoCo ignores the inertias in the file.

The value is MuJoCo's constant mjINERTIAFROMGEOM_TRUE: MuJoCo then computes all inertias from the shapes.
"""
MIN_LINK_MASS = 1e-9
"""Mass that replaces the missing mass of a moving link, kg; it is too small to affect the motion."""
MIN_LINK_RADIUS = 0.01
"""Radius of gyration from which the inertia of a moving link without a mass is computed, m."""


def compile_balanced(mujoco: Any, spec: Any) -> tuple[Any, tuple[str, ...]]:
    """Compile a user's model; replace an inertia that MuJoCo refuses by three equal moments with the same mean.

    Args:
        mujoco: The package `mujoco`.
        spec: The `mujoco.MjSpec` of the user's file; it is changed only if MuJoCo refuses an inertia.

    Returns:
        model: Compiled `mujoco.MjModel`.
        balanced: Names of the bodies with a replaced inertia.

    Raises:
        ModelError: A body has no mass, or the mean of its moments of inertia is not above 0.
        ValueError: MuJoCo refuses the model for another reason.
    """
    moments = [(body, _moments(body)) for body in spec.bodies[1:] if body.explicitinertial]
    for body, own in moments:
        if own[0] < 0.0 and own.mean() < MIN_INERTIA:
            raise ModelError(_refusal(body.name))
    try:
        model = spec.compile()
        return model, _balanced_bodies(spec, model, moments)
    except ValueError as error:
        if not any(text in str(error) for text in (UNBALANCED_MESSAGE, NOT_POSITIVE_MESSAGE, TOO_SMALL_MESSAGE)):
            raise
    for body, own in moments:
        if own.min() < MIN_INERTIA <= own.mean():
            body.fullinertia = np.full(6, np.nan)
            body.inertia = np.full(3, own.mean())
    for part in (spec, *spec.bodies):
        part.compiler.balanceinertia = 1
    try:
        model = spec.compile()
    except ValueError as error:
        if TOO_SMALL_MESSAGE in str(error) or NOT_POSITIVE_MESSAGE in str(error):
            raise ModelError(_without_inertia(spec, error)) from error
        raise
    return model, _balanced_bodies(spec, model, moments)


def _balanced_bodies(spec: Any, model: Any, moments: list[tuple[Any, Floats]]) -> tuple[str, ...]:
    """Return the names of the bodies with an impossible inertia that MuJoCo has replaced.

    Args:
        spec: The `mujoco.MjSpec` of the model.
        model: Compiled `mujoco.MjModel`.
        moments: Bodies with an inertia in the file: the body, and its principal moments, ascending, (3,), kg·m².

    Returns:
        Names of the bodies; "number 3" for a body without a name.
    """
    if int(spec.compiler.inertiafromgeom) == INERTIA_FROM_GEOMS:
        return ()
    names = []
    for body, own_moments in moments:
        is_impossible = own_moments[0] < MIN_INERTIA or own_moments[0] + own_moments[1] < own_moments[2]
        is_balanced = np.ptp(own_moments) > np.ptp(model.body_inertia[body.id]) == 0.0
        if is_impossible and is_balanced:
            names.append(body.name or f"number {body.id}")
    return tuple(names)


def remove_inferred_masses(spec: Any) -> tuple[str, ...]:
    """Give a negligible mass to massless moving links of a URDF; return the names of massless links.

    By default, masses are not inferred from the shapes of a URDF, and MuJoCo would refuse a moving link without a mass.
    The link therefore gets the mass `MIN_LINK_MASS` if a link below it has a mass. If the file requests that MuJoCo
    computes masses from shapes, the function changes nothing.

    Args:
        spec: The `mujoco.MjSpec` of the URDF, which is changed in place.

    Returns:
        Names of the links that have colliding shapes but no mass, for the report to the user.
    """
    if int(spec.compiler.inertiafromgeom):  # The file requests that MuJoCo computes masses from shapes.
        return ()
    massless = []
    for body in spec.bodies[1:]:
        if body.explicitinertial and body.mass > 0.0:
            continue
        if any(geom.contype or geom.conaffinity for geom in body.geoms):
            massless.append(body.name)
        if body.joints and not _mass(body, welded_only=True) and _mass(body):
            body.explicitinertial = True
            body.mass = MIN_LINK_MASS
            body.fullinertia = np.full(6, np.nan)
            body.inertia = np.full(3, MIN_LINK_MASS * MIN_LINK_RADIUS**2)
    return tuple(massless)


def _mass(body: Any, welded_only: bool = False) -> float:
    """Return the total mass of a body and all bodies below it in the kinematic tree, kg.

    Args:
        body: Body of a `mujoco.MjSpec`.
        welded_only: True to include only bodies that cannot move relative to `body`.

    Returns:
        The mass, kg; bodies without an explicit mass count as 0.
    """
    below = [each for each in body.bodies if not (welded_only and each.joints)]
    mass = float(body.mass) if body.explicitinertial else 0.0
    return mass + sum(_mass(each, welded_only) for each in below)


def _moments(body: Any) -> Floats:
    """Return the principal moments of inertia that the file gives for `body`, in ascending order, (3,), kg·m²."""
    full = np.array(body.fullinertia)
    if np.isnan(full[0]):
        return np.sort(body.inertia)
    matrix = np.diag(full[:3])
    matrix[0, 1] = matrix[1, 0] = full[3]
    matrix[0, 2] = matrix[2, 0] = full[4]
    matrix[1, 2] = matrix[2, 1] = full[5]
    moments: Floats = np.linalg.eigvalsh(matrix)
    return moments


def _without_inertia(spec: Any, error: ValueError) -> str:
    """Return an error message about the body that MuJoCo refuses because it has no mass or no inertia.

    Args:
        spec: The `mujoco.MjSpec` of the model.
        error: Error of MuJoCo's compiler; its text contains the name of the body.

    Returns:
        The message.
    """
    name = next((body.name for body in spec.bodies if body.name and f"'{body.name}'" in str(error)), "")
    return _refusal(name)


def _refusal(name: str) -> str:
    subject = repr(name) if name else "a body without a name"
    return f"{subject}: mass and moments of inertia must be larger than 0 where a joint moves a body"
