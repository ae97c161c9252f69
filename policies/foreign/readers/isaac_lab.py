"""Isaac Lab's `params/env.yaml`: an environment of managers, as `dump_yaml` writes it next to a run's networks.

Sources: `isaaclab/envs/mdp/actions/joint_actions.py` (target = raw action * scale + offset, then clipped),
`isaaclab/managers/manager_term_cfg.py`, `isaaclab/sensors/ray_caster/patterns/patterns.py` (order of a height scan),
`isaaclab/utils/string.py` (regular expressions over whole joint names).
"""

from policies.base import PolicyError
from policies.foreign.description import HeightGrid, PolicyDescription, Range, Term
from policies.foreign.readers.isaac_terms import OF_JOINTS, history_of, term
from policies.foreign.readers.joint_orders import FAMILIES, Joints, by_kind
from policies.foreign.readers.networks import exported
from policies.foreign.readers.settings import BY_HAND, Settings, load, matches


def describe(settings: Settings) -> PolicyDescription:
    """The policy of an `env.yaml`. Raises PolicyError."""
    robot = settings.inside("scene", "robot")
    action = _action(settings)
    asset = _asset(robot)
    joints = _chosen(action, asset, "the actions")
    observed, terms = _terms(settings, asset)
    stiffness, damping = ({joint: _gain(robot, joint, kind) for joint in joints} for kind in ("stiffness", "damping"))
    default = robot.inside("init_state").by_pattern("joint_pos", joints, 0.0)
    at_default = action.find("use_default_offset") is True
    return PolicyDescription(
        network=exported(settings.file),
        control_rate=1 / (settings.number("decimation") * settings.inside("sim").number("dt")),
        joints=joints,
        default_position=default,
        action_scale=action.by_pattern("scale", joints, 1.0),
        action_offset=None if at_default else action.by_pattern("offset", joints, 0.0),
        action_clip=_action_clip(settings),
        target_clip=_target_clip(action, joints),
        stiffness=tuple(stiffness.values()),
        damping=tuple(damping.values()),
        terms=terms,
        observed_joints=observed if observed not in (None, joints) else None,
    )


def _action(settings: Settings) -> Settings:
    """The only action, joint positions."""
    actions = dict(settings.inside("actions").groups())
    kinds = {str(action.find("class_type")).rpartition(":")[2] for action in actions.values()}
    if len(actions) != 1 or not kinds <= {"JointPositionAction", "None"}:
        raise PolicyError(f"the actions are {', '.join(actions) or 'none'}: one JointPositionAction is read", BY_HAND)
    return next(iter(actions.values()))


def _asset(robot: Settings) -> Joints | None:
    """Names and order of the robot's joints, by the expressions that must match them and the path of its model."""
    spawn = robot.inside("spawn")
    path = str(spawn.find("usd_path") or spawn.find("asset_path")).lower()
    patterns = [str(key) for key in robot.inside("init_state").inside("joint_pos").values]
    for _, actuator in robot.inside("actuators").groups():
        patterns += actuator.texts("joint_names_expr")
    orders = {words: by_kind(*family) for words, family in FAMILIES.items()}
    fit = [words for words, names in orders.items() if all(any(matches(p, n) for n in names) for p in patterns)]
    named = [words for words in fit if any(word in path for word in words.split())]
    return orders[named[0]] if len(named) == 1 else orders[fit[0]] if len(fit) == 1 else None


def _chosen(settings: Settings, asset: Joints | None, what: str) -> Joints:
    """The joints that `joint_names` choose, in the asset's order unless `preserve_order`."""
    if settings.find("joint_names") is None and settings.find("joint_ids") is not None:
        raise settings.wrong("joint_ids", "absent, and the joints named by `joint_names`")
    patterns = settings.texts("joint_names") if settings.find("joint_names") is not None else (".*",)
    kept = settings.find("preserve_order") is True
    if kept and len(patterns) == 12 and all(each.isidentifier() for each in patterns):
        return patterns
    if asset is None:
        raise PolicyError(
            f"the order of the joints in {what} cannot be known: the robot is none of {_known()}", BY_HAND
        )
    if kept:
        return tuple(dict.fromkeys(name for each in patterns for name in asset if matches(each, name)))
    return tuple(name for name in asset if any(matches(each, name) for each in patterns))


def _known() -> str:
    return ", ".join(word for words in FAMILIES for word in words.split())


def _terms(settings: Settings, asset: Joints | None) -> tuple[Joints | None, tuple[Term, ...]]:
    """Order of the observed joints, None if none are observed, and the terms."""
    group = settings.inside("observations", "policy")
    history = history_of(group) if group.find("history_length") is not None else None
    terms, orders = [], set()
    for name, each in group.groups():
        function = str(each.get("func")).rpartition(":")[2]
        if function == "generated_commands":
            _check_command(settings, each)
        grid = _grid(settings, each.inside("params")) if function == "height_scan" else None
        found = term(function, each, history or history_of(each), grid)
        terms.append(found)
        if found.name in OF_JOINTS:
            params = each.inside("params")
            chosen = params.inside("asset_cfg") if params.find("asset_cfg") is not None else Settings({}, each.file)
            orders.add(_chosen(chosen, asset, name))
    if len(orders) > 1:
        raise PolicyError("the joints are observed in several orders (`asset_cfg.joint_names`): one is read", BY_HAND)
    return next(iter(orders), None), tuple(terms)


def _check_command(settings: Settings, term: Settings) -> None:
    """Raise PolicyError unless the command of a term is of velocities."""
    name = str(term.inside("params").get("command_name"))
    kind = str(settings.inside("commands", name).get("class_type")).rpartition(":")[2]
    if "VelocityCommand" not in kind:
        raise PolicyError(f"the command {name} is a {kind}: commands of velocity are read", BY_HAND)


def _grid(settings: Settings, params: Settings) -> HeightGrid:
    """Points of a height scan: a grid about the sensor, yawed with the trunk."""
    sensor = settings.inside("scene", str(params.inside("sensor_cfg").get("name")))
    if sensor.find("ray_alignment") != "yaw" and sensor.find("attach_yaw_only") is not True:
        raise sensor.wrong("ray_alignment", "yaw")
    grid = sensor.inside("pattern_cfg")
    step, size = grid.number("resolution"), grid.numbers("size", 2)
    shift = sensor.inside("offset").numbers("pos", 3) if sensor.find("offset") is not None else (0.0, 0.0, 0.0)
    if not 0 < step <= min(size) or size[0] * size[1] > 1e4 * step**2:
        raise grid.wrong("resolution", "a step that gives 2 to 10 000 points")
    x, y = (
        tuple(round(middle - side / 2 + step * each, 9) for each in range(int((side + 1e-9) / step) + 1))
        for side, middle in zip(size, shift, strict=False)
    )
    return HeightGrid(x, y, x_first=grid.find("ordering") != "yx", offset=params.number("offset", 0.5))


def _gain(robot: Settings, joint: str, kind: str) -> float:
    """Stiffness or damping of a joint's actuator."""
    for _, actuator in robot.inside("actuators").groups():
        if any(matches(each, joint) for each in actuator.texts("joint_names_expr")):
            return actuator.by_pattern(kind, (joint,))[0]
    raise PolicyError(f"no actuator in {robot.file.name} has the joint {joint}")


def _target_clip(action: Settings, joints: Joints) -> tuple[Range, ...] | None:
    if action.find("clip") is None:
        return None
    clip = action.inside("clip")
    found = [clip.range(clip.pattern(joint)) for joint in joints]
    return tuple(each for each in found if each is not None)


def _action_clip(settings: Settings) -> Range | None:
    """What rsl_rl's wrapper clips raw actions to, by the `agent.yaml` next to the file."""
    agent = settings.file.with_name("agent.yaml")
    if not agent.is_file() or (found := load(agent)).find("clip_actions") is None:
        return None
    limit = found.number("clip_actions")
    return -limit, limit
