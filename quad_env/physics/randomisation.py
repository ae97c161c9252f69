"""Writer that puts the random parameters of domain randomisation into the MuJoCo models of n robots."""

from collections.abc import Callable, Sequence
from typing import Any

from quad_env.columns import Array, EnvIndices
from quad_env.physics.model import PAYLOAD, servo_fields
from quad_env.robots.shapes import welded_bodies
from quad_env.scenarios.randomisation import RandomizationSample


class RandomisedModels:
    """Writer of the randomised parameters of an episode into the model of each robot.

    The caller must call `Batch.set_const` after `reset`, because constants of the model depend on the parameters. The
    randomised trunk is the heaviest body that is welded to the body with the free joint, except the payload.

    Args:
        model: Compiled `mujoco.MjModel`.
        expand: Function that gives every robot its own values of a model field, and returns the values, (n, ...).
        limits: Lower and upper torque limits of each motor, which `reset` scales, (n, 12, 2), N·m; None to scale the
            model field `actuator_forcerange`.
    """

    def __init__(self, model: Any, expand: Callable[[str], Array], limits: Array | None = None) -> None:
        limits = expand("actuator_forcerange") if limits is None else limits
        stiffness, damping = servo_fields(model, expand)
        bodies = [body for body in welded_bodies(model, model.body("base_link").id) if model.body(body).name != PAYLOAD]
        trunk = max(bodies, key=lambda body: float(model.body_mass[body]))
        ground = slice(model.body_geomnum[0])
        fields_by_factor = {
            "friction": (expand("geom_friction")[:, ground, 0],),
            "trunk_mass": (expand("body_mass")[:, trunk], expand("body_inertia")[:, trunk]),
            "stiffness": stiffness,
            "damping": damping,
            "motor_strength": (limits[..., 0], limits[..., 1]),
        }
        self._scaled = [
            (factor, field, field.copy()) for factor, fields in fields_by_factor.items() for field in fields
        ]
        """Triples: name of a factor in `RandomizationSample`, array of the model field to scale, and nominal values.

        The nominal values are a copy of the array before any randomisation.
        """
        self._centre_of_mass = expand("body_ipos")[:, trunk]
        self._nominal_centre_of_mass = self._centre_of_mass.copy()

    def reset(self, env_ids: EnvIndices, randomization: Sequence[RandomizationSample]) -> None:
        """Write the randomised parameters of new episodes into the models of the robots `env_ids`.

        Args:
            env_ids: Indices of the robots, (k,).
            randomization: Randomised parameters of the k episodes.
        """
        for row, sample in zip(env_ids, randomization, strict=True):
            for factor, field, nominal in self._scaled:
                field[row] = nominal[row] * getattr(sample, factor)
            self._centre_of_mass[row] = self._nominal_centre_of_mass[row] + sample.centre_of_mass
