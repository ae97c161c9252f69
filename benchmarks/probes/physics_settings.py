"""Physics settings to compare: changes of the shipped model, by name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import mujoco

from quad_env.physics.model import stepped_model
from quad_env.robots.simple_quad import SIMPLE_QUAD

Change = Callable[[mujoco.MjSpec], None]

NEWTON = int(mujoco.mjtSolver.mjSOL_NEWTON)
CG = int(mujoco.mjtSolver.mjSOL_CG)
PGS = int(mujoco.mjtSolver.mjSOL_PGS)
PYRAMIDAL = int(mujoco.mjtCone.mjCONE_PYRAMIDAL)
ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)


def options(**values: Any) -> Change:
    """A change of simulation options."""

    def change(spec: mujoco.MjSpec) -> None:
        for name, value in values.items():
            setattr(spec.option, name, value)

    return change


def gains(stiffness: float, damping: float) -> Change:
    """Other joint servos, N·m/rad and N·m·s/rad."""

    def change(spec: mujoco.MjSpec) -> None:
        for actuator in spec.actuators:
            actuator.gainprm[0], actuator.biasprm[1], actuator.biasprm[2] = stiffness, -stiffness, -damping

    return change


def ground_only(*suffixes: str) -> Change:
    """Geoms of these names collide with the ground alone, the others with nothing; none named: all with the ground."""

    def change(spec: mujoco.MjSpec) -> None:
        for geom in spec.geoms:
            if geom.contype and geom.name != "ground":
                kept = geom.name.endswith(suffixes) if suffixes else True
                geom.contype, geom.conaffinity = (1, 2) if kept else (0, 0)

    return change


def together(*changes: Change) -> Change:
    """One change after the other."""

    def change(spec: mujoco.MjSpec) -> None:
        for each in changes:
            each(spec)

    return change


FINE = options(timestep=0.0005, solver=NEWTON, iterations=100, tolerance=1e-10)
"""Four times finer, with a fully converged solver: what the accuracy of a setting is measured against."""


@dataclass(frozen=True)
class Setting:
    """A change of the shipped model, and the change that its reference is made with."""

    change: Change
    reference: Change
    lean: bool = True
    """Stepped as the environment steps it; False: every sensor evaluated, islands of constraints searched."""

    def model(self) -> mujoco.MjModel:
        """What is stepped."""
        model = compiled(self.change)
        return stepped_model(model) if self.lean else model


def _physics(change: Change) -> Setting:
    """The reference is the shipped robot, however the setting models its contacts."""
    return Setting(change, FINE)


def _robot(change: Change) -> Setting:
    """Another robot: its reference has the change too."""
    return Setting(change, together(change, FINE))


SHIPPED = "shipped"
FIRST = "first settings"
"""Name of the foundation's settings: what a faster setting is measured from."""

SERVO = "servo"
"""How the names of other joint servos begin."""

SETTINGS: dict[str, Setting] = {
    SHIPPED: _physics(options()),
    FIRST: replace(
        _physics(options(solver=NEWTON, iterations=100, cone=ELLIPTIC, impratio=10, timestep=0.002)), lean=False
    ),
    "all sensors, islands": replace(_physics(options()), lean=False),
    "Newton, 10": _physics(options(solver=NEWTON, iterations=10)),
    "Newton, 3": _physics(options(solver=NEWTON, iterations=3)),
    "CG, 30": _physics(options(solver=CG, iterations=30)),
    "CG, 10": _physics(options(solver=CG, iterations=10)),
    "PGS, 30": _physics(options(solver=PGS, iterations=30)),
    "PGS, 10": _physics(options(solver=PGS, iterations=10)),
    "PGS, 5": _physics(options(solver=PGS, iterations=5)),
    "PGS, 3": _physics(options(solver=PGS, iterations=3)),
    "pyramidal cone": _physics(options(cone=PYRAMIDAL, impratio=1)),
    "impratio 1": _physics(options(impratio=1)),
    "timestep 1 ms": _physics(options(timestep=0.001)),
    "no self-collision": _physics(ground_only()),
    "feet and trunk": _physics(ground_only("foot", "trunk")),
    "feet and trunk, PGS, 10": _physics(together(ground_only("foot", "trunk"), options(solver=PGS, iterations=10))),
    "feet and trunk, PGS, 5": _physics(together(ground_only("foot", "trunk"), options(solver=PGS, iterations=5))),
    f"{SERVO} kp 100, kv 4": _robot(gains(100, 4)),
    f"{SERVO} kp 200, kv 8": _robot(gains(200, 8)),
    f"{SERVO} kp 400, kv 12": _robot(gains(400, 12)),
}

"""What follows a solver's name is its number of iterations."""


def compiled(change: Change) -> mujoco.MjModel:
    """The robot with that change."""
    spec = mujoco.MjSpec.from_file(str(SIMPLE_QUAD.mjcf))
    change(spec)
    return spec.compile()
