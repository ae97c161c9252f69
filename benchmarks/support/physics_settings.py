"""Physics settings to compare: changes of the shipped model, by name."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco

from quad_env.physics.model import make_stepping_model
from quad_env.robots.simple_quad import SIMPLE_QUAD

SpecEdit = Callable[[mujoco.MjSpec], None]
"""Changes a model's specification."""

NEWTON = int(mujoco.mjtSolver.mjSOL_NEWTON)
CG = int(mujoco.mjtSolver.mjSOL_CG)
PGS = int(mujoco.mjtSolver.mjSOL_PGS)
PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)


def edit_options(**values: Any) -> SpecEdit:
    """Return a change of simulation options."""

    def change(spec: mujoco.MjSpec) -> None:
        for name, value in values.items():
            setattr(spec.option, name, value)

    return change


def collide_with_ground_only(*suffixes: str) -> SpecEdit:
    """Return a change after which geoms collide with the ground alone.

    Args:
        *suffixes: Ends of the names of these geoms; all others collide with nothing. None: all geoms.

    Returns:
        The change.
    """

    def change(spec: mujoco.MjSpec) -> None:
        for geom in spec.geoms:
            if geom.contype and geom.name != "ground":
                collides = geom.name.endswith(suffixes) if suffixes else True
                geom.contype = 1 if collides else 0
                geom.conaffinity = 2 if collides else 0

    return change


def combine(*changes: SpecEdit) -> SpecEdit:
    """Return a change that applies some changes one after the other."""

    def change(spec: mujoco.MjSpec) -> None:
        for apply in changes:
            apply(spec)

    return change


FINE = edit_options(timestep=0.0005, solver=NEWTON, iterations=100, tolerance=1e-10)
"""Four times finer time step with a fully converged solver: the reference for the accuracy of a setting."""


@dataclass(frozen=True)
class PhysicsSetting:
    """A change of the shipped model."""

    change: SpecEdit
    """Change of the specification."""
    use_stepping_model: bool = True
    """True: stepped as in the environment. False: with every sensor evaluated, and islands of constraints searched."""

    def model(self) -> mujoco.MjModel:
        """Compile the model."""
        model = compile_model(self.change)
        return make_stepping_model(model) if self.use_stepping_model else model


SHIPPED = "shipped"
"""Name of the shipped settings."""
ORIGINAL_SETTINGS = "first settings"
"""Name of the first settings of the project, which the speed of others is compared with."""

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
"""Name -> setting; a number after a solver is its number of iterations."""


def compile_model(change: SpecEdit) -> mujoco.MjModel:
    """Compile the robot's model with a change."""
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    change(spec)
    return spec.compile()
