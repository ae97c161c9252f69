"""Reader of legged_gym's and HIMLoco's training configuration, saved as a dictionary in YAML or JSON.

Sources:
- leggedrobotics/legged_gym `envs/base/legged_robot.py`: `compute_observations`, `_compute_torques`, `step`, and
  `_init_buffers`. The keys of `stiffness` are parts of joint names. The last key that is part of a joint's name
  determines stiffness and damping of the joint.
- leggedrobotics/legged_gym `envs/anymal_c/anymal.py`: with `use_actuator_network`, a network computes the torques, and
  there is no stiffness or damping.
- OpenRobotLab/HIMLoco `envs/base/legged_robot.py`: `env.num_one_step_observations`. The observation is a history with
  the newest control step first. The history is filled with zeros at the start of an episode.
"""

from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.joint_orders import isaac_gym_order
from policies.external.readers.settings import WRITE_TOML, FileSettings
from policies.external.spec import HeightGrid, PolicySpec, SpecTerm


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from the configuration of legged_gym or HIMLoco.

    Args:
        settings: Settings of the configuration file.

    Returns:
        Specification of the policy.

    Raises:
        PolicyError: A setting is missing, wrong or unsupported, or the joint names belong to no known robot.
    """
    control = settings.section("control")
    normalization = settings.section("normalization")
    _check_control(control)
    angles = settings.section("init_state", "default_joint_angles")
    joints = isaac_gym_order(str(key) for key in angles.values)
    if joints is None:
        raise PolicyError(f"unknown order of the joints {', '.join(map(str, angles.values))}", WRITE_TOML)
    scale = control.number("action_scale")
    clip = normalization.number("clip_actions")
    hip_scale = scale * control.number("hip_reduction", 1.0) * control.number("hip_scale_reduction", 1.0)
    gains = [_parse_gains(control, joint) for joint in joints]
    return PolicySpec(
        network=settings.network(),
        control_rate=1 / (control.number("decimation") * settings.section("sim").number("dt")),
        joints=joints,
        default_position=tuple(angles.number(joint) for joint in joints),
        action_scale=(hip_scale, scale, scale) * 4,
        action_clip=(-clip, clip),
        stiffness=tuple(stiffness for stiffness, _ in gains),
        damping=tuple(damping for _, damping in gains),
        terms=_parse_terms(settings, normalization.section("obs_scales")),
        observation_clip=normalization.number("clip_observations"),
        history_layout="time",
        history_newest="first",
        history_start="zero",
    )


def _check_control(control: FileSettings) -> None:
    """Raise PolicyError if the actions are no joint positions, or if a network models the actuators.

    `control` is the section `control` of the configuration.
    """
    if control.find("control_type") not in (None, "P"):
        control.raise_invalid("control_type", "P, of joint positions")
    if control.find("use_actuator_network") not in (None, False):
        raise PolicyError(
            f"`control.use_actuator_network` in {control.file.name}: the joints were trained with a network of their "
            "actuators; their stiffness and damping are unknown",
            f"{WRITE_TOML} with the gains of the robot's own controller",
        )


def _parse_gains(control: FileSettings, joint: str) -> tuple[float, float]:
    """Return stiffness, N·m/rad, and damping, N·m·s/rad, of the joint with the name `joint`.

    The keys of the sections `stiffness` and `damping` are parts of joint names, for example `hip`. The stiffness of a
    joint is the value of the last key in `stiffness` that occurs in the joint's name. The damping is the value of the
    same key in `damping`. If `damping` lacks this key, and exactly one other key of `damping` occurs in the joint's
    name, the damping is the value of that key. legged_gym itself fails without the same key.
    """
    stiffness = control.section("stiffness")
    damping = control.section("damping")
    keys = [key for key in stiffness.values if str(key) in joint]
    if not keys:
        raise PolicyError(f"`control.stiffness` in {control.file.name} has nothing for {joint}")
    key = keys[-1]
    damping_keys = [each for each in damping.values if str(each) in joint]
    if damping.find(key) is None and len(damping_keys) == 1:
        return stiffness.number(key), damping.number(damping_keys[0])
    return stiffness.number(key), damping.number(key)


def _parse_terms(settings: FileSettings, scales: FileSettings) -> tuple[SpecTerm, ...]:
    """Return the observation terms that legged_gym or HIMLoco computes, with the configured scales.

    Raises PolicyError if the number of values of these terms differs from the number in the configuration.
    """
    env = settings.section("env")
    width = env.number("num_observations")
    velocity_scale = scales.number("lin_vel")
    turn_scale = scales.number("ang_vel")
    attitude = [SpecTerm("angular_velocity", (turn_scale,)), SpecTerm("projected_gravity")]
    command = SpecTerm("command", (velocity_scale, velocity_scale, turn_scale))
    joints = [
        SpecTerm("joint_position", (scales.number("dof_pos"),)),
        SpecTerm("joint_velocity", (scales.number("dof_vel"),)),
        SpecTerm("previous_action"),
    ]
    if env.find("num_one_step_observations") is not None:
        terms = [command, *attitude, *joints]
        step_width = env.number("num_one_step_observations")
    else:
        velocity = SpecTerm("linear_velocity", (velocity_scale,))
        terms = [velocity, *attitude, command, *joints, *_parse_heights(settings, scales)]
        step_width = width
    terms_width = sum(term.width for term in terms)
    if step_width != terms_width or width % step_width:
        raise PolicyError(
            f"the observation is {width:g} numbers, and legged_gym's terms are {terms_width}: "
            f"{env.file.name} does not name the terms",
            WRITE_TOML,
        )
    return tuple(replace(term, history=int(width / step_width)) for term in terms)


def _parse_heights(settings: FileSettings, scales: FileSettings) -> list[SpecTerm]:
    """Return a list with the observation term of the height scan, or an empty list.

    The list is empty if the setting `terrain.measure_heights` is not True. `scales` has the scale of the heights.
    """
    terrain = settings.section("terrain")
    if terrain.find("measure_heights") is not True:
        return []
    x = terrain.numbers("measured_points_x", None)
    y = terrain.numbers("measured_points_y", None)
    grid = HeightGrid(x, y, x_first=False, offset=0.5)
    return [SpecTerm("height_scan", (scales.number("height_measurements"),), (-1.0, 1.0), grid=grid)]
