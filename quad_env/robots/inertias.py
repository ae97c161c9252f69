"""Impossible inertias of a user's model: balanced as MuJoCo's `balanceinertia` does, and reported."""

from typing import Any

import numpy as np

from quad_env.robots.shapes import Floats
from quad_env.robots.structure import ModelError

UNBALANCED_MESSAGE = "A + B >= C"
NOT_POSITIVE_MESSAGE = "positive eigenvalues"
TOO_SMALL_MESSAGE = "must be larger than mjMINVAL"
"""Parts of error messages of MuJoCo's compiler about inertias."""
MIN_INERTIA = 1e-15
"""kg, kg·m². Least mass and moment of inertia of a moving body: mjMINVAL of MuJoCo."""
INERTIA_FROM_GEOMS = 1
"""Value of `inertiafromgeom` that ignores the inertias of the file: mjINERTIAFROMGEOM_TRUE of MuJoCo."""
MIN_LINK_MASS = 1e-9
"""kg. Mass that a moving link without a mass gets; a millionth of a gram."""
MIN_LINK_RADIUS = 0.01
"""m. Radius of gyration of this link."""


def compile_balanced(mujoco: Any, spec: Any) -> tuple[Any, tuple[str, ...]]:
    """Compile a specification; replace inertias that MuJoCo refuses by three equal moments.

    Args:
        mujoco: The package.
        spec: The `mujoco.MjSpec`, changed only where MuJoCo refuses an inertia.

    Returns:
        model: Compiled `mujoco.MjModel`.
        balanced: Names of the bodies with a changed inertia.

    Raises:
        ModelError: A body has no mass, or an inertia with a mean moment that is not above 0.
        ValueError: MuJoCo does not compile it for another reason.
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
    """Return the names of bodies with impossible moments that MuJoCo, or `compile_balanced`, has made equal."""
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
    """Give links of a URDF without `<inertial>` no mass, even if they have shapes.

    A moving link that carries others gets `MIN_LINK_MASS`; MuJoCo refuses a mass of zero there.

    Args:
        spec: The `mujoco.MjSpec` of the URDF, changed.

    Returns:
        Names of the links that collide and have no mass.
    """
    if int(spec.compiler.inertiafromgeom):  # the file asks for it
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
    """Return the mass of a body and of those below it, or of those that are welded to it, kg."""
    below = [each for each in body.bodies if not (welded_only and each.joints)]
    mass = float(body.mass) if body.explicitinertial else 0.0
    return mass + sum(_mass(each, welded_only) for each in below)


def _moments(body: Any) -> Floats:
    """Return the principal moments of a body's explicit inertia, ascending, (3,), kg·m²."""
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
    """Return a message on the body in MuJoCo's error: it has no mass or no inertia."""
    name = next((body.name for body in spec.bodies if body.name and f"'{body.name}'" in str(error)), "")
    return _refusal(name)


def _refusal(name: str) -> str:
    subject = repr(name) if name else "a body without a name"
    return f"{subject}: mass and moments of inertia must be larger than 0 where a joint moves a body"
