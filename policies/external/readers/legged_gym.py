"""legged_gym's settings, its config class as a dictionary in YAML or JSON, and those of HIMLoco.

Sources: leggedrobotics/legged_gym `envs/base/legged_robot.py` (`compute_observations`, `_compute_torques`, `step`;
`_init_buffers`: of the keys of `stiffness` that are part of a joint's name the last one gives both gains),
`envs/anymal_c/anymal.py` (`use_actuator_network`: torques of a network, without stiffness and damping);
OpenRobotLab/HIMLoco, the first of these files: `env.num_one_step_observations`, newest step first, zeros at the start.
"""

from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.joint_orders import isaac_gym_order
from policies.external.readers.settings import WRITE_TOML, FileSettings
from policies.external.spec import HeightGrid, ObservationTerm, PolicySpec


def parse_spec(settings: FileSettings) -> PolicySpec:
    """The policy of such settings. Raises PolicyError."""
    control, normalization = settings.section("control"), settings.section("normalization")
    if control.find("control_type") not in (None, "P"):
        raise control.invalid_value("control_type", "P, of joint positions")
    if control.find("use_actuator_network") not in (None, False):
        raise PolicyError(
            f"`control.use_actuator_network` in {settings.file.name}: the joints were trained with a network of their "
            "actuators, of which no stiffness and damping are known",
            f"{WRITE_TOML} with the gains of the robot's own controller",
        )
    angles = settings.section("init_state", "default_joint_angles")
    if (joints := isaac_gym_order(str(key) for key in angles.values)) is None:
        raise PolicyError(f"the order of the joints {', '.join(map(str, angles.values))} cannot be known", WRITE_TOML)
    scale, clip = control.number("action_scale"), normalization.number("clip_actions")
    hip = scale * control.number("hip_reduction", 1.0) * control.number("hip_scale_reduction", 1.0)
    gains_of = [_gains(control, joint) for joint in joints]
    return PolicySpec(
        network=settings.network(),
        control_rate=1 / (control.number("decimation") * settings.section("sim").number("dt")),
        joints=joints,
        default_position=tuple(angles.number(joint) for joint in joints),
        action_scale=(hip, scale, scale) * 4,
        action_clip=(-clip, clip),
        stiffness=tuple(gains[0] for gains in gains_of),
        damping=tuple(gains[1] for gains in gains_of),
        terms=_terms(settings, normalization.section("obs_scales")),
        observation_clip=normalization.number("clip_observations"),
        history_layout="time",
        history_newest="first",
        history_start="zero",
    )


def _gains(control: FileSettings, joint: str) -> tuple[float, float]:
    """Return stiffness and damping of a joint, by the last key of the stiffness that is part of the joint's name.

    The damping has its own key in the joint's name where it lacks the stiffness's key; legged_gym itself then fails.
    """
    stiffness = control.section("stiffness")
    damping = control.section("damping")
    if not (keys := [key for key in stiffness.values if str(key) in joint]):
        raise PolicyError(f"`control.stiffness` in {control.file.name} has nothing for {joint}")
    key = keys[-1]
    if damping.find(key) is None and len(others := [each for each in damping.values if str(each) in joint]) == 1:
        return stiffness.number(key), damping.number(others[0])
    return stiffness.number(key), damping.number(key)


def _terms(settings: FileSettings, scales: FileSettings) -> tuple[ObservationTerm, ...]:
    env = settings.section("env")
    total = env.number("num_observations")
    speed, turn = scales.number("lin_vel"), scales.number("ang_vel")
    first = [ObservationTerm("angular_velocity", (turn,)), ObservationTerm("projected_gravity")]
    command = ObservationTerm("command", (speed, speed, turn))
    last = [
        ObservationTerm("joint_position", (scales.number("dof_pos"),)),
        ObservationTerm("joint_velocity", (scales.number("dof_vel"),)),
        ObservationTerm("previous_action"),
    ]
    if env.find("num_one_step_observations") is not None:
        terms, one_step = [command, *first, *last], env.number("num_one_step_observations")
    else:
        terms, one_step = (
            [ObservationTerm("linear_velocity", (speed,)), *first, command, *last, *_heights(settings, scales)],
            total,
        )
    if one_step != (width := sum(term.width for term in terms)) or total % one_step:
        raise PolicyError(
            f"the observation is {total:g} numbers, and legged_gym's terms are {width}: which terms they are is not "
            f"in {env.file.name}",
            WRITE_TOML,
        )
    return tuple(replace(each, history=int(total / one_step)) for each in terms)


def _heights(settings: FileSettings, scales: FileSettings) -> list[ObservationTerm]:
    terrain = settings.section("terrain")
    if terrain.find("measure_heights") is not True:
        return []
    x, y = terrain.numbers("measured_points_x", None), terrain.numbers("measured_points_y", None)
    grid = HeightGrid(x, y, x_first=False, offset=0.5)
    return [ObservationTerm("height_scan", (scales.number("height_measurements"),), (-1.0, 1.0), grid=grid)]
