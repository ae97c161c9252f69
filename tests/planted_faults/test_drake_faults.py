"""Faults of Drake's plant, planted into the real code: each must make a named check fail."""

from typing import Any

import mujoco
import numpy as np
import pytest

pytest.importorskip("pydrake")

from quad_env.physics.drake import plant
from quad_env.physics.drake.batch import DrakeBatch
from quad_env.physics.model import compile_model
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario
from tests.planted_faults.harness import Faults, checks_of, fault_tests

GRAVITY = 9.81
SPHERE = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="0 0 1" friction="{ground}" priority="{priority}" solref="0.01 1"/>
    <body name="ball" pos="0 0 0.1">
      <freejoint/>
      <inertial pos="0 0 0" mass="3" diaginertia="1000 1000 1000"/>
      <geom type="sphere" size="0.1" friction="0.8"/>
    </body>
  </worldbody>
</mujoco>
"""
"""Sphere with too much inertia to roll."""


def slide(speed: float, ground: float, priority: int, seconds: float = 0.05) -> tuple[float, float]:
    """Return the deceleration of a sphere that slides at a speed, m/s², and its lift, m."""
    model = mujoco.MjModel.from_xml_string(SPHERE.format(ground=ground, priority=priority))
    sphere, ids = DrakeBatch(model, 1), np.arange(1)
    sphere.reset(ids)
    sphere.step(ids, 500)  # the sphere comes to rest on the ground
    start, velocity = sphere.bind("qpos")[0, 2], sphere.bind("qvel")[0]
    velocity[0], heights = speed, []
    for _ in range(round(seconds / model.opt.timestep)):
        sphere.step(ids, 1)
        heights.append(sphere.bind("qpos")[0, 2])
    return (speed - velocity[0]) / seconds, max(heights) - start


def check_friction_is_mujocos() -> None:
    """The friction is the ground's if it has priority, else the larger of both; sliding objects are not lifted."""
    for speed in (1.0, 4.6):
        for ground, priority, coefficient in ((0.8, 0, 0.8), (0.2, 1, 0.2), (0.2, 0, 0.8)):
            deceleration, lift = slide(speed, ground, priority)
            assert 0.9 < deceleration / (coefficient * GRAVITY) < 1.1
            assert lift < 1e-4


def flight() -> tuple[mujoco.MjModel, DrakeBatch]:
    """Return the robot without servos and joint damping, thrown with a spin, with moving joints."""
    model = compile_model(SIMPLE_QUAD, scenario("flat"))
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = model.dof_damping[:] = 0.0
    model.opt.timestep = 1e-4
    flying, rng = DrakeBatch(model, 1), np.random.default_rng(0)
    flying.reset(np.arange(1), keyframe=0)
    flying.bind("qpos")[0, 2] = 3.0
    flying.bind("qvel")[:] = rng.uniform(-1.0, 1.0, 18)
    return model, flying


def check_energy_is_kept_in_flight() -> None:
    """Kinetic and potential energy, by MuJoCo from Drake's states, are constant within 0.1 % of the kinetic energy.

    The error halves with the time step.
    """
    model, flying = flight()
    energies = []
    for _ in range(2):
        data = flying.get_data(0)
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energies.append((data.energy.sum(), data.energy[1]))
        flying.step(np.arange(1), 1000)
    assert energies[1][0] - energies[0][0] == pytest.approx(0.0, abs=1e-3 * energies[0][1])


def unmatched_friction(patch: pytest.MonkeyPatch) -> None:
    """Plant a fault: geoms have their own coefficients, which Drake combines by the harmonic mean."""
    patch.setattr(plant, "_drake_frictions", lambda model, geoms, _: model.geom_friction[geoms, 0])


def lifting_contact(patch: pytest.MonkeyPatch) -> None:
    true = plant.multibody.MultibodyPlantConfig
    sap = {"discrete_contact_approximation": "sap"}
    patch.setattr(plant.multibody, "MultibodyPlantConfig", lambda **settings: true(**settings | sap))


def gravity_of_the_moon(patch: pytest.MonkeyPatch) -> None:
    true = plant.multibody.AddMultibodyPlant

    def add(*args: Any) -> Any:
        made, scene = true(*args)

        class Moon:
            def __getattr__(self, name: str) -> Any:
                return getattr(made, name)

            def mutable_gravity_field(self) -> Any:
                return Moon()

            def set_gravity_vector(self, _: Any) -> None:
                made.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -1.62])

        return Moon(), scene

    patch.setattr(plant.multibody, "AddMultibodyPlant", add)


FAULTS: Faults = {
    "friction not matched": (unmatched_friction, check_friction_is_mujocos),
    "contact that lifts": (lifting_contact, check_friction_is_mujocos),
    "another gravity": (gravity_of_the_moon, check_energy_is_kept_in_flight),
}
test_the_code_passes, test_a_planted_fault_is_found, test_every_check_finds_one = fault_tests(
    checks_of(globals()), FAULTS
)
