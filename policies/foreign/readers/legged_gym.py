"""legged_gym's settings, its config class as a dictionary in YAML or JSON, and those of HIMLoco.

Sources: leggedrobotics/legged_gym `envs/base/legged_robot.py` (`compute_observations`, `_compute_torques`, `step`);
OpenRobotLab/HIMLoco, the same file: `env.num_one_step_observations`, newest step first, zeros at the start.
"""

from dataclasses import replace

from policies.base import PolicyError
from policies.foreign.description import HeightGrid, PolicyDescription, Term
from policies.foreign.readers.joint_orders import isaac_gym
from policies.foreign.readers.settings import BY_HAND, Settings


def describe(settings: Settings) -> PolicyDescription:
    """The policy of such settings. Raises PolicyError."""
    control, normalization = settings.inside("control"), settings.inside("normalization")
    if control.find("control_type") not in (None, "P"):
        raise control.wrong("control_type", "P, of joint positions")
    angles = settings.inside("init_state", "default_joint_angles")
    if (joints := isaac_gym(str(key) for key in angles.values)) is None:
        raise PolicyError(f"the order of the joints {', '.join(map(str, angles.values))} cannot be known", BY_HAND)
    scale, clip = control.number("action_scale"), normalization.number("clip_actions")
    hip = scale * control.number("hip_reduction", 1.0) * control.number("hip_scale_reduction", 1.0)
    return PolicyDescription(
        network=settings.network(),
        control_rate=1 / (control.number("decimation") * settings.inside("sim").number("dt")),
        joints=joints,
        default_position=tuple(angles.number(joint) for joint in joints),
        action_scale=(hip, scale, scale) * 4,
        action_clip=(-clip, clip),
        stiffness=tuple(_gain(control.inside("stiffness"), joint) for joint in joints),
        damping=tuple(_gain(control.inside("damping"), joint) for joint in joints),
        terms=_terms(settings, normalization.inside("obs_scales")),
        observation_clip=normalization.number("clip_observations"),
        history_layout="time",
        history_newest="first",
        history_start="zero",
    )


def _gain(gains: Settings, joint: str) -> float:
    """Of the first key that is part of the joint's name."""
    for part in gains.values:
        if str(part) in joint:
            return gains.number(part)
    raise PolicyError(f"`{gains.above[:-1]}` in {gains.file.name} has nothing for {joint}")


def _terms(settings: Settings, scales: Settings) -> tuple[Term, ...]:
    env = settings.inside("env")
    total = env.number("num_observations")
    speed, turn = scales.number("lin_vel"), scales.number("ang_vel")
    first = [Term("angular_velocity", (turn,)), Term("projected_gravity")]
    command = Term("command", (speed, speed, turn))
    last = [
        Term("joint_position", (scales.number("dof_pos"),)),
        Term("joint_velocity", (scales.number("dof_vel"),)),
        Term("previous_action"),
    ]
    if env.find("num_one_step_observations") is not None:
        terms, one_step = [command, *first, *last], env.number("num_one_step_observations")
    else:
        terms, one_step = (
            [Term("linear_velocity", (speed,)), *first, command, *last, *_heights(settings, scales)],
            total,
        )
    if one_step != (width := sum(term.width for term in terms)) or total % one_step:
        raise PolicyError(
            f"the observation is {total:g} numbers, and legged_gym's terms are {width}: which terms they are is not "
            f"in {env.file.name}",
            BY_HAND,
        )
    return tuple(replace(each, history=int(total / one_step)) for each in terms)


def _heights(settings: Settings, scales: Settings) -> list[Term]:
    terrain = settings.inside("terrain")
    if terrain.find("measure_heights") is not True:
        return []
    x, y = terrain.numbers("measured_points_x", None), terrain.numbers("measured_points_y", None)
    grid = HeightGrid(x, y, x_first=False, offset=0.5)
    return [Term("height_scan", (scales.number("height_measurements"),), (-1.0, 1.0), grid=grid)]
