"""Correction of impossible and missing inertias of a user's model; the changed bodies are reported.

An impossible inertia is replaced by three equal moments, as MuJoCo's option `balanceinertia` does.
"""

from typing import Any

import numpy as np

from quad_env.robots.shapes import Floats
from quad_env.robots.structure import ModelError

UNBALANCED_MESSAGE = "A + B >= C"
NOT_POSITIVE_MESSAGE = "positive eigenvalues"
TOO_SMALL_MESSAGE = "must be larger than mjMINVAL"
"""Part of the error message of MuJoCo's compiler about a too small mass or inertia.

The two constants above are parts of the messages about other invalid inertias.
"""
MIN_INERTIA = 1e-15
"""Smallest valid mass, kg, and moment of inertia, kg·m², of a moving body: mjMINVAL of MuJoCo."""
INERTIA_FROM_GEOMS = 1
"""Value of `inertiafromgeom` with which MuJoCo ignores the inertias of the file: mjINERTIAFROMGEOM_TRUE."""
MIN_LINK_MASS = 1e-9
"""Mass that a moving link without a mass gets, kg."""
MIN_LINK_RADIUS = 0.01
"""Radius of gyration that a moving link without a mass gets, m."""


def compile_balanced(mujoco: Any, spec: Any) -> tuple[Any, tuple[str, ...]]:
    """Compile a specification; replace inertias that MuJoCo refuses by three equal moments.

    Args:
        mujoco: The package `mujoco`.
        spec: The `mujoco.MjSpec`; it is changed only if MuJoCo refuses an inertia.

    Returns:
        model: Compiled `mujoco.MjModel`.
        balanced: Names of the bodies with a changed inertia.

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
    """Return the names of bodies with an impossible inertia, for which the model has equal moments.

    Args:
        spec: Specification of the model.
        model: Compiled model.
        moments: Explicit inertias of bodies: the body, and its principal moments in the file, (3,), kg·m².

    Returns:
        Names of the bodies.
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
    """Find the links of a URDF without a mass, and give `MIN_LINK_MASS` to those that MuJoCo would refuse.

    MuJoCo would refuse a moving link without a mass. It gets `MIN_LINK_MASS` if links below it have a mass. Masses are
    not inferred from shapes.

    Args:
        spec: The `mujoco.MjSpec` of the URDF, which is changed in place.

    Returns:
        Names of the links that have colliding shapes but no mass.
    """
    if int(spec.compiler.inertiafromgeom):  # The file itself requests that masses are inferred from shapes.
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
    """Return the mass of a body and all bodies below it, kg.

    Only bodies that are welded to the body are included if `welded_only` is True.
    """
    below = [each for each in body.bodies if not (welded_only and each.joints)]
    mass = float(body.mass) if body.explicitinertial else 0.0
    return mass + sum(_mass(each, welded_only) for each in below)


def _moments(body: Any) -> Floats:
    """Return the principal moments of a body's inertia in the file, in ascending order, (3,), kg·m²."""
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
    """Return the message that the body in MuJoCo's error has no mass or no inertia."""
    name = next((body.name for body in spec.bodies if body.name and f"'{body.name}'" in str(error)), "")
    return _refusal(name)


def _refusal(name: str) -> str:
    subject = repr(name) if name else "a body without a name"
    return f"{subject}: mass and moments of inertia must be larger than 0 where a joint moves a body"
