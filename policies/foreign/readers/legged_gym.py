"""legged_gym's settings, its config class as a dictionary in YAML or JSON, and those of HIMLoco.

Sources: leggedrobotics/legged_gym `envs/base/legged_robot.py` (`compute_observations`, `_compute_torques`, `step`);
OpenRobotLab/HIMLoco, the same file: `env.num_one_step_observations`, newest step first, zeros at the start.
"""

from policies.base import PolicyError
from policies.foreign.description import HeightGrid, PolicyDescription, Term
from policies.foreign.readers.joint_orders import Joints, isaac_gym
from policies.foreign.readers.networks import exported
from policies.foreign.readers.settings import BY_HAND, Settings

HEIGHTS = (-1.0, 1.0)
"""Clip of the height scan, whose numbers are the trunk's height over the ground minus 0.5 m."""


def describe(settings: Settings) -> PolicyDescription:
    """The policy of such settings. Raises PolicyError."""
    control, normalization = settings.inside("control"), settings.inside("normalization")
    if control.find("control_type") not in (None, "P"):
        raise control.wrong("control_type", "P, of joint positions")
    angles = settings.inside("init_state", "default_joint_angles")
    if (joints := isaac_gym(str(key) for key in angles.values)) is None:
        raise PolicyError(f"the order of the joints {', '.join(map(str, angles.values))} cannot be known", BY_HAND)
    clip = normalization.number("clip_actions")
    one_step = settings.inside("env").find("num_one_step_observations")
    return PolicyDescription(
        network=exported(settings.file),
        control_rate=1 / (control.number("decimation") * settings.inside("sim").number("dt")),
        joints=joints,
        default_position=tuple(angles.number(joint) for joint in joints),
        action_scale=_action_scale(control, joints),
        action_clip=(-clip, clip),
        stiffness=tuple(_gain(control, "stiffness", joint) for joint in joints),
        damping=tuple(_gain(control, "damping", joint) for joint in joints),
        terms=_terms(settings, normalization.inside("obs_scales"), one_step is not None),
        observation_clip=normalization.number("clip_observations"),
        history_layout="time",
        history_newest="first",
        history_start="zero",
    )


def _gain(control: Settings, key: str, joint: str) -> float:
    """Of the first key that is part of the joint's name."""
    gains = control.inside(key)
    for part in gains.values:
        if str(part) in joint:
            return gains.number(part)
    raise PolicyError(f"`{gains.above[:-1]}` in {control.file.name} has nothing for {joint}")


def _action_scale(control: Settings, joints: Joints) -> tuple[float, ...]:
    """Smaller for the first joint of each leg in HIMLoco and walk-these-ways."""
    scale = control.number("action_scale")
    hips = control.number("hip_reduction", 1.0) * control.number("hip_scale_reduction", 1.0)
    return tuple(scale * (hips if index % 3 == 0 else 1) for index in range(len(joints)))


def _terms(settings: Settings, scales: Settings, him: bool) -> tuple[Term, ...]:
    env = settings.inside("env")
    turn = Term("angular_velocity", (scales.number("ang_vel"),))
    speed = scales.number("lin_vel")
    command = Term("command", (speed, speed, turn.scale[0]))
    gravity = Term("projected_gravity")
    joints = [Term("joint_position", (scales.number("dof_pos"),)), Term("joint_velocity", (scales.number("dof_vel"),))]
    action = Term("previous_action")
    if him:
        terms = [command, turn, gravity, *joints, action]
        steps = env.number("num_observations") / (width := env.number("num_one_step_observations"))
    else:
        terms = [
            Term("linear_velocity", (speed,)),
            turn,
            gravity,
            command,
            *joints,
            action,
            *_heights(settings, scales),
        ]
        steps, width = 1, env.number("num_observations")
    known = sum(term.width for term in terms)
    if width != known or steps != int(steps):
        raise PolicyError(
            f"`env.num_observations` in {env.file.name} is {env.number('num_observations'):g}, and legged_gym's terms "
            f"are {known} numbers: which terms these are is not in the file",
            BY_HAND,
        )
    return tuple(Term(each.name, each.scale, each.clip, int(steps), grid=each.grid) for each in terms)


def _heights(settings: Settings, scales: Settings) -> list[Term]:
    terrain = settings.inside("terrain")
    if terrain.find("measure_heights") is not True:
        return []
    x, y = (terrain.numbers(key, None) for key in ("measured_points_x", "measured_points_y"))
    scale = scales.number("height_measurements")
    return [Term("height_scan", (scale,), HEIGHTS, grid=HeightGrid(x, y, x_first=False, offset=0.5))]
