"""Models of n robots that domain randomisation makes differ from robot to robot."""

from collections.abc import Callable, Sequence
from typing import Any

from quad_env.columns import Array, EnvIndices
from quad_env.physics.model import PAYLOAD, servo_fields
from quad_env.robots.shapes import welded_bodies
from quad_env.scenarios.randomisation import RandomizationSample


class RandomisedModels:
    """Writes what an episode has drawn into the robot's own model; `set_const` has to follow.

    `expand` gives a field's values of each robot; `limits`, (n, 12, 2), N·m, are the motors' where these are not what
    MuJoCo has. The trunk is the heaviest of the bodies welded to the one with the free joint, but for the payload.
    """

    def __init__(self, model: Any, expand: Callable[[str], Array], limits: Array | None = None) -> None:
        limits = expand("actuator_forcerange") if limits is None else limits
        stiffness, damping = servo_fields(model, expand)
        bodies = [body for body in welded_bodies(model, model.body("base_link").id) if model.body(body).name != PAYLOAD]
        trunk, ground = max(bodies, key=lambda body: float(model.body_mass[body])), slice(model.body_geomnum[0])
        of_factors = {
            "friction": (expand("geom_friction")[:, ground, 0],),
            "trunk_mass": (expand("body_mass")[:, trunk], expand("body_inertia")[:, trunk]),
            "stiffness": stiffness,
            "damping": damping,
            "motor_strength": (limits[..., 0], limits[..., 1]),
        }
        self._scaled = [(name, field, field.copy()) for name, fields in of_factors.items() for field in fields]
        """What each factor scales, and its usual values."""
        self._centre = expand("body_ipos")[:, trunk]
        self._usual_centre = self._centre.copy()

    def reset(self, rows: EnvIndices, randomization: Sequence[RandomizationSample]) -> None:
        """Give those robots these figures."""
        for row, figures in zip(rows, randomization, strict=True):
            for name, field, usual in self._scaled:
                field[row] = usual[row] * getattr(figures, name)
            self._centre[row] = self._usual_centre[row] + figures.centre_of_mass
