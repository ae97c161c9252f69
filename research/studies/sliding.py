"""Sliding feet with several settings of MuJoCo's contact model: `python -m research sliding`.

The results are written to docs/results/sliding.csv. MuJoCo's friction model is a convex relaxation of Coulomb friction
with the friction coefficient µ. It has a side effect: a body that slides at the velocity v also rises, at up to µ v.
In a time step h, the upward velocity grows by up to µ b v h. The rate b = 2 / (dmax timeconst), 1/s, follows from the
contact parameters `solimp` (dmax) and `solref` (timeconst). A landing foot stops slipping at the same rate b. One of
the settings is exact Coulomb friction, with which a sliding ball does not rise. This setting reduces the reference
acceleration of each contact along the normal by µ times the tangential residual (G. de Saxcé and Z.-Q. Feng, The
bipotential method, Math. Comput. Modelling 28, 1998).
"""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import mujoco
import numpy as np
from mujoco.batch import Batch

import policies
from evaluate.cells import LabelledPolicy
from evaluate.rollouts.run import RunSettings, run_cells
from quad_env.cli.command_line import UsageError, check_numbers, make_folder_of
from quad_env.config import GRAVITY
from quad_env.files.writing import write_atomically
from quad_env.robots.robot import Robot
from quad_env.robots.scene import build_spec
from quad_env.robots.simple_quad import SIMPLE_QUAD
from quad_env.scenarios.registry import scenario
from quad_env.seeding import episode_seeds
from research.pages.csv_text import to_csv

SPEEDS = (1.0, 4.6)
"""Initial speeds of the sliding bodies, m/s.

A push of 65 N·s changes the speed of SimpleQuad by the second value.
"""
BRIEF = 0.05
"""Time from the start of sliding over which the initial deceleration is averaged, s."""


@dataclass(frozen=True)
class ContactSetting:
    """Changes of the project's default contact parameters, and of the duration of pushes."""

    options: Mapping[str, float] = field(default_factory=dict)
    """Changed simulation options: field of MuJoCo's `mjOption` -> value."""
    solref: tuple[float, float] | None = None
    """MuJoCo's contact parameter `solref` of all geoms; None if it is unchanged.

    Two positive numbers are the time constant, s, and the damping ratio. Two negative numbers are the stiffness, 1/s²,
    and the damping, 1/s, with the sign reversed."""
    friction: float | None = None
    """Coefficient of sliding friction of all geoms; None if it is unchanged."""
    push: float = 0.1
    """Duration of the pushes, s; the impulse of a push is the same for all durations."""
    exact: bool = False
    """True for exact Coulomb friction; False for the friction model of MuJoCo, a convex relaxation."""

    def apply(self, spec: Any) -> Any:
        """Apply the changes to the specification of a MuJoCo model in place, and return the specification."""
        for name, value in self.options.items():
            setattr(spec.option, name, value)
        for geom in spec.geoms:
            if self.solref:
                geom.solref = self.solref
            if self.friction:
                geom.friction[0] = self.friction
        return spec


_NEWTON = {"solver": mujoco.mjtSolver.mjSOL_NEWTON, "iterations": 100}
"""Simulation options of the Newton solver: field of MuJoCo's `mjOption` -> value."""
SETTINGS = {
    "today": ContactSetting(),
    "time step 1 ms": ContactSetting({"timestep": 0.001}),
    "time step 0.5 ms": ContactSetting({"timestep": 0.0005}),
    "Newton": ContactSetting(_NEWTON),
    "Newton, pyramids, impratio 1": ContactSetting(_NEWTON | {"cone": mujoco.mjtCone.mjCONE_PYRAMIDAL, "impratio": 1}),
    "impratio 1": ContactSetting({"impratio": 1}),
    "noslip 20": ContactSetting({"noslip_iterations": 20}),
    "time constant 0.02 s": ContactSetting(solref=(0.02, 1.0)),
    "damping ratio 0.5": ContactSetting(solref=(0.01, 0.5)),
    # The stiffness in the next setting, 11080 1/s², is the stiffness of the default contact parameters.
    "damping 50 1/s, impratio 40": ContactSetting({"impratio": 40}, solref=(-11080.0, -50.0)),
    "exact Coulomb friction": ContactSetting(_NEWTON, exact=True),
    "friction 0.6": ContactSetting(friction=0.6),
    "friction 0.5": ContactSetting(friction=0.5),
    "push over 0.2 s": ContactSetting(push=0.2),
    "push over 0.3 s": ContactSetting(push=0.3),
    "push over 0.5 s": ContactSetting(push=0.5),
}
"""Compared contact settings: name of the setting -> changes of the default contact parameters.

The setting `today` changes nothing.
"""


@dataclass(frozen=True)
class SlidingOptions:
    """Options of the command `sliding`: contact settings, policy, scenarios and episodes."""

    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of the contact settings to compare."""
    policy: str = "trot"
    """Name of the policy that walks."""
    scenarios: tuple[str, ...] = ("flat", "push=65")
    """Names of the scenarios on which the policy walks."""
    episodes: int = 24
    """Number of episodes of 10 s on each scenario; their seeds have the purpose "search"."""
    seed: int = 38
    """Seed from which the seeds of the episodes are drawn, >= 0."""
    table: Path = Path("docs/results/sliding.csv")
    """CSV file for the results."""


def main(options: SlidingOptions) -> int:
    """Run the command `sliding`: measure all contact settings, and print and write the results.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: A setting is unknown.
    """
    check_numbers(options, {"episodes": (1, 4096), "seed": (0, 2**31)})
    if unknown := set(options.settings) - set(SETTINGS):
        raise UsageError(f"--settings: there is no {', '.join(sorted(unknown))}; valid: {'; '.join(SETTINGS)}")
    make_folder_of(options.table, "--table")
    rows = []
    for name in options.settings:
        figures = measure_sliding(SETTINGS[name]) | evaluate_walks(SETTINGS[name], options)
        rows.append({"setting": name} | figures)
        print(name, *(f"{key} {value:.3g}" for key, value in figures.items()), sep="\n  ", flush=True)
    write_atomically(options.table, to_csv(rows))
    return 0


def measure_sliding(setting: ContactSetting) -> dict[str, float]:
    """Measure the lift and the deceleration of two sliding bodies: a ball, and the robot in its home pose.

    The lift is the largest height above the ground. The ball has the radius of a foot and a quarter of the mass of the
    robot.

    Args:
        setting: Contact setting.

    Returns:
        Name of the column, with body, quantity, unit and initial speed -> value.
    """
    ball = setting.apply(ball_spec(SIMPLE_QUAD)).compile()
    robot = setting.apply(build_spec(SIMPLE_QUAD)).compile()
    figures: dict[str, float] = {}
    for model, name, seconds in ((ball, "ball", 1.0), (robot, "robot", BRIEF)):
        for speed in SPEEDS:
            lift, initial_braking, total_braking = simulate_slide(model, speed, seconds, setting.exact)
            figures[f"{name} lift, mm, {speed:g} m/s"] = lift
            figures[f"{name} braking, µg, {speed:g} m/s"] = initial_braking
            if name == "ball":
                figures[f"{name} braking to rest, µg, {speed:g} m/s"] = total_braking
    return figures


def simulate_slide(model: Any, speed: float, seconds: float, exact: bool) -> tuple[float, float, float]:
    """Simulate a body (ball or robot) that slides on the ground, and measure its lift and deceleration.

    Args:
        model: Compiled MuJoCo model of the body.
        speed: Initial speed, m/s.
        seconds: Duration of the simulation, s.
        exact: True for exact Coulomb friction, False for the friction model of MuJoCo.

    Returns:
        lift: Largest height of the lowest foot above the ground, mm.
        initial_braking: Mean deceleration of the centre of mass over the first 50 ms. The unit of both decelerations is
            µg, friction coefficient times gravity, which is the deceleration by Coulomb friction.
        total_braking: Mean deceleration of the centre of mass until the speed is a twentieth of the initial speed, or
            until the end of the simulation.
    """
    data = mujoco.MjData(model)
    timestep = model.opt.timestep
    feet = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    # Only the robot has a keyframe, the home pose; the ball starts at rest on the ground.
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    # The body is simulated for 0.5 s, so that it rests on the ground before it slides.
    _step(model, data, False, 0.5)
    data.qvel[0] += speed
    heights = []
    speeds = []
    for _ in range(round(seconds / timestep)):
        mujoco.mj_subtreeVel(model, _step(model, data, exact))
        heights.append((data.geom_xpos[feet, 2] - model.geom_size[feet, 0]).min())
        speeds.append(data.subtree_linvel[0, 0])
    slow_steps = np.flatnonzero(np.array(speeds) < 0.05 * speed)
    stop_step = slow_steps[0] + 1 if slow_steps.size else len(speeds)
    # A deceleration of µg reduces the speed by this value in a time step, m/s.
    speed_unit = model.geom("ground").friction[0] * GRAVITY * timestep
    braking = [float((speed - speeds[end - 1]) / (end * speed_unit)) for end in (round(BRIEF / timestep), stop_step)]
    return 1e3 * max(heights), braking[0], braking[1]


def ball_spec(robot: Robot) -> Any:
    """Create the MuJoCo model specification of a ball that slides without rotation, on the robot's ground.

    The ball has radius and contact parameters of a foot of the robot. Its mass is the mass of the robot divided by the
    number of legs.
    """
    robot_spec = build_spec(robot)
    ground = robot_spec.geom("ground")
    foot = robot_spec.geom(f"{robot.leg_names[0]}_foot")
    spec = mujoco.MjSpec()
    spec.option = robot_spec.option
    spec.worldbody.add_geom(name="ground", type=ground.type, size=ground.size, **_contact_parameters(ground))
    ball = spec.worldbody.add_body(name="ball", pos=(0.0, 0.0, robot.foot_radius))
    for axis in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        ball.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    mass = robot.mass / len(robot.leg_names)
    ball.add_geom(name="foot", type=foot.type, size=foot.size, mass=mass, **_contact_parameters(foot))
    return spec


def evaluate_walks(setting: ContactSetting, options: SlidingOptions) -> dict[str, float]:
    """Let a policy walk with a contact setting, and count successes and falls.

    Args:
        setting: Contact setting.
        options: Options of the command: policy, scenarios and episodes.

    Returns:
        Name of the column -> success rate, 0 to 1, or number of falls on a scenario.
    """
    seeds = episode_seeds("search", options.seed, options.episodes)
    figures: dict[str, float] = {}
    policy = LabelledPolicy(options.policy, policies.resolve(options.policy, servo="own"))
    with ExitStack() as patches:
        patches.enter_context(
            patch("quad_env.physics.model.build_spec", lambda robot, visuals: setting.apply(build_spec(robot, visuals)))
        )
        if setting.exact:
            patches.enter_context(patch.object(Batch, "step", _exact_step))
        for name in options.scenarios:
            nominal = scenario(name)
            pushes = nominal.pushes and replace(nominal.pushes, duration=setting.push)
            (cell,) = run_cells([policy], [replace(nominal, pushes=pushes)], seeds, RunSettings(1, lambda *_: None))
            figures[f"{name} success"] = cell.measures.succeeded.mean()
            figures[f"{name} falls"] = cell.measures.fell.sum()
    return figures


def _contact_parameters(geom: Any) -> dict[str, Any]:
    """Return contact parameters of a geom, to copy them to another geom: name of the attribute -> value."""
    return {"condim": 3, "friction": geom.friction, "solref": geom.solref}


def _step(model: Any, data: Any, exact: bool, seconds: float | None = None) -> Any:
    """Advance the simulation of a body with a given friction model.

    Args:
        model: Compiled MuJoCo model.
        data: `mujoco.MjData` of the model, which is changed.
        exact: True for exact Coulomb friction, False for the friction model of MuJoCo.
        seconds: Simulated time, s; None for one time step.

    Returns:
        The changed `data`.
    """
    mujoco.set_mjcb_control(_coulomb if exact else None)
    try:
        mujoco.mj_step(model, data, round((seconds or model.opt.timestep) / model.opt.timestep))
    finally:
        mujoco.set_mjcb_control(None)
    return data


def _exact_step(batch: Batch, ids: Any = None, nstep: int = 1, stage: int = 0) -> None:
    """Simulate the robots of a batch with exact Coulomb friction; this function replaces `Batch.step`.

    Args:
        batch: Batch of simulations, which is changed in place.
        ids: Indices of the robots to simulate; None for all robots.
        nstep: Number of time steps.
        stage: Not used; the argument exists because `Batch.step` has it.
    """
    data = mujoco.MjData(batch.model)
    state = mujoco.mjtState.mjSTATE_INTEGRATION
    for robot in range(batch.nsim) if ids is None else ids:
        mujoco.mj_setState(batch.model, data, batch.state[robot], state)
        _step(batch.model, data, True, nstep * batch.model.opt.timestep)
        mujoco.mj_getState(batch.model, data, batch.state[robot], state)
    batch.forward(ids)


def _coulomb(model: Any, data: Any) -> None:
    """Make the friction of all contacts exact Coulomb friction, by the correction of de Saxcé.

    This is a control callback: MuJoCo calls it between the velocity stage and the acceleration stage of a time step.
    MuJoCo's contact solver drives the acceleration of each contact towards a reference acceleration. The residual is
    the acceleration minus this reference; it is computed from the acceleration of the last time step. The reference
    along the normal is reduced by the friction coefficient times the magnitude of the tangential residual.

    Args:
        model: Compiled MuJoCo model.
        data: `mujoco.MjData` of the model, which is changed in place.
    """
    touching = data.contact.efc_address >= 0
    normal = data.contact.efc_address[touching]
    if normal.size:
        residual = data.efc_J.reshape(data.nefc, model.nv) @ data.qacc_warmstart - data.efc_aref
        slip = np.hypot(residual[normal + 1], residual[normal + 2])
        data.efc_aref[normal] -= data.contact.friction[touching, 0] * slip
