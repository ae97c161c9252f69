"""Defines the physics settings that the benchmark `physics` compares, and compiles their MuJoCo models.

A physics setting is a change of solver, friction cone, collisions or time step in the shipped MuJoCo model.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco

from quad_env.physics.model import make_stepping_model
from quad_env.robots.simple_quad import SIMPLE_QUAD

SpecEdit = Callable[[mujoco.MjSpec], None]
"""Type of a function that changes the specification of a MuJoCo model in place."""

NEWTON = int(mujoco.mjtSolver.mjSOL_NEWTON)
CG = int(mujoco.mjtSolver.mjSOL_CG)
PGS = int(mujoco.mjtSolver.mjSOL_PGS)
PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)


def edit_options(**values: Any) -> SpecEdit:
    """Return a function that sets simulation options of a MuJoCo model.

    Args:
        **values: Name of a field of MuJoCo's `option` -> new value of the field.

    Returns:
        Function that changes the specification of a model in place.
    """

    def change(spec: mujoco.MjSpec) -> None:
        for name, value in values.items():
            setattr(spec.option, name, value)

    return change


def collide_with_ground_only(*suffixes: str) -> SpecEdit:
    """Return a function that changes a model so that geoms collide only with the ground.

    Args:
        *suffixes: Name suffixes of the geoms that collide with the ground; all other geoms collide with nothing.
            Without suffixes, all geoms collide with the ground.

    Returns:
        Function that changes the specification of a model in place.
    """

    def change(spec: mujoco.MjSpec) -> None:
        for geom in spec.geoms:
            if geom.contype and geom.name != "ground":
                collides = geom.name.endswith(suffixes) if suffixes else True
                geom.contype = 1 if collides else 0
                geom.conaffinity = 2 if collides else 0

    return change


def combine(*changes: SpecEdit) -> SpecEdit:
    """Return a function that applies all `changes` to the specification of a model, one after the other."""

    def change(spec: mujoco.MjSpec) -> None:
        for apply in changes:
            apply(spec)

    return change


FINE = edit_options(timestep=0.0005, solver=NEWTON, iterations=100, tolerance=1e-10)
"""Change of the shipped model for the reference simulation, with which the accuracy of a setting is measured.

The time step is four times finer, and the solver converges fully.
"""


@dataclass(frozen=True)
class PhysicsSetting:
    """Physics setting: a change of the shipped MuJoCo model, for the comparison of speed and accuracy.

    The shipped model is the model of SimpleQuad that the environment simulates.
    """

    change: SpecEdit
    """Function that changes the specification of the shipped MuJoCo model in place."""
    use_stepping_model: bool = True
    """True to simulate with `make_stepping_model`, as the environment does.

    If False, MuJoCo evaluates every sensor and searches for constraint islands in each physics step.
    """

    def model(self) -> mujoco.MjModel:
        """Compile the MuJoCo model of SimpleQuad with this physics setting."""
        model = compile_model(self.change)
        return make_stepping_model(model) if self.use_stepping_model else model


SHIPPED = "shipped"
"""Name of the physics setting that the environment uses."""
ORIGINAL_SETTINGS = "first settings"
"""Name of the first physics setting of the project, with which the speed of every setting is compared."""

SETTINGS: dict[str, PhysicsSetting] = {
    SHIPPED: PhysicsSetting(edit_options()),
    ORIGINAL_SETTINGS: PhysicsSetting(
        edit_options(solver=NEWTON, iterations=100, cone=ELLIPTIC, impratio=10, timestep=0.002),
        use_stepping_model=False,
    ),
    "all sensors, islands": PhysicsSetting(edit_options(), use_stepping_model=False),
    "Newton, 10": PhysicsSetting(edit_options(solver=NEWTON, iterations=10)),
    "Newton, 3": PhysicsSetting(edit_options(solver=NEWTON, iterations=3)),
    "CG, 30": PhysicsSetting(edit_options(solver=CG, iterations=30)),
    "CG, 10": PhysicsSetting(edit_options(solver=CG, iterations=10)),
    "PGS, 30": PhysicsSetting(edit_options(solver=PGS, iterations=30)),
    "PGS, 10": PhysicsSetting(edit_options(solver=PGS, iterations=10)),
    "PGS, 5": PhysicsSetting(edit_options(solver=PGS, iterations=5)),
    "PGS, 3": PhysicsSetting(edit_options(solver=PGS, iterations=3)),
    "pyramidal cone": PhysicsSetting(edit_options(cone=PYRAMIDAL, impratio=1)),
    "impratio 1": PhysicsSetting(edit_options(impratio=1)),
    "timestep 1 ms": PhysicsSetting(edit_options(timestep=0.001)),
    "no self-collision": PhysicsSetting(collide_with_ground_only()),
    "feet and trunk": PhysicsSetting(collide_with_ground_only("foot", "trunk")),
    "feet and trunk, PGS, 10": PhysicsSetting(
        combine(collide_with_ground_only("foot", "trunk"), edit_options(solver=PGS, iterations=10))
    ),
    "feet and trunk, PGS, 5": PhysicsSetting(
        combine(collide_with_ground_only("foot", "trunk"), edit_options(solver=PGS, iterations=5))
    ),
}
"""Name -> physics setting; a number after the name of a solver is the largest number of solver iterations."""


def compile_model(change: SpecEdit) -> mujoco.MjModel:
    """Compile the MuJoCo model of SimpleQuad after the function `change` has changed its specification."""
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    change(spec)
    return spec.compile()
