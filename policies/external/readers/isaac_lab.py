"""Reader of Isaac Lab's `params/env.yaml`, which `dump_yaml` writes for a manager-based environment.

Sources: `isaaclab/envs/mdp/actions/joint_actions.py` (target = raw action * scale + offset, then clipped),
`isaaclab/managers/manager_term_cfg.py`, `isaaclab/sensors/ray_caster/patterns/patterns.py` (order of a height scan),
`isaaclab/utils/string.py` (regular expressions over whole joint names).
"""

import re
from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.io_descriptor import joint_order
from policies.external.readers.isaac_terms import history_length, incomplete_remarks, make_term, observed_order
from policies.external.readers.joint_orders import FAMILIES, JointNames, names_by_kind
from policies.external.readers.settings import WRITE_TOML, FileSettings, joint_name_matches, load_settings
from policies.external.spec import HeightGrid, Numbers, PolicySpec, Range, SpecTerm

_ACTUATOR_JOINTS = "joint_names_expr"
"""Key of an actuator's settings that holds regular expressions for joint names."""


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse an `env.yaml`. Raises PolicyError for a missing, wrong or unsupported setting."""
    robot = settings.section("scene", "robot")
    action = _find_action(settings)
    asset_joints = joint_order(settings.file)
    if asset_joints is None and settings.section("sim").find("newton_cfg") is None:
        asset_joints = _known_robot_joints(robot)
    joints = _select_joints(action, asset_joints)
    group = settings.section("observations", "policy")
    terms = {name: _parse_term(settings, group, term) for name, term in group.sections()}
    clip = action.optional_section("clip")
    return PolicySpec(
        network=settings.network(),
        control_rate=1 / (settings.number("decimation") * settings.section("sim").number("dt")),
        joints=joints,
        default_position=robot.section("init_state").joint_values("joint_pos", joints, 0.0),
        action_scale=action.joint_values("scale", joints, 1.0),
        action_offset=_parse_offset(action, joints),
        action_clip=_parse_action_clip(settings),
        target_clip=tuple(clip.range(clip.matching_pattern(joint)) for joint in joints) if clip.values else None,
        stiffness=tuple(_parse_gain(robot, joint, "stiffness") for joint in joints),
        damping=tuple(_parse_gain(robot, joint, "damping") for joint in joints),
        terms=tuple(terms.values()),
        observed_joints=_parse_observed_joints(group, terms, joints, asset_joints),
        remarks=incomplete_remarks((_function_name(term), term) for _, term in group.sections()),
    )


def _find_action(settings: FileSettings) -> FileSettings:
    """Return the settings of the only action. Raises PolicyError unless it is a JointPositionAction."""
    actions = dict(settings.section("actions").sections())
    kinds = {action.text("class_type").rpartition(":")[2] for action in actions.values()}
    if len(actions) != 1 or kinds != {"JointPositionAction"}:
        given = ", ".join(f"{name} ({action.text('class_type')})" for name, action in actions.items())
        raise PolicyError(f"the actions are {given or 'none'}; supported: one JointPositionAction", WRITE_TOML)
    return next(iter(actions.values()))


def _known_robot_joints(robot: FileSettings) -> JointNames | None:
    """Return the joint names of a robot of a known family, in Isaac Lab's order.

    Returns None if the family is unknown.

    The joint names of the family must match all expressions in the settings. The path of the robot's model must contain
    a word of the family.
    """
    spawn = robot.section("spawn").values
    path = " ".join(f"{key} {value}" for key, value in spawn.items() if isinstance(value, str)).lower()
    patterns = [str(key) for key in robot.section("init_state", "joint_pos").values]
    for _, actuator in robot.section("actuators").sections():
        patterns += actuator.texts(_ACTUATOR_JOINTS)
    orders = {words: names_by_kind(*family) for words, family in FAMILIES.items()}
    fitting = [words for words, names in orders.items() if _has_matches(patterns, names)]
    named = [words for words in fitting if re.search(rf"(?<![a-z0-9])({words.replace(' ', '|')})", path)]
    return orders[named[0]] if named else None


def _has_matches(patterns: list[str], names: JointNames) -> bool:
    """Return True if each pattern matches at least one of the names."""
    return all(any(joint_name_matches(pattern, name) for name in names) for pattern in patterns)


def _select_joints(settings: FileSettings, asset_joints: JointNames | None) -> JointNames:
    """Return the joint names that the patterns in `joint_names` select.

    Their order is the order of `asset_joints`, or of the patterns if `preserve_order` is True. Raises PolicyError if
    the order of the asset's joints is needed but unknown.
    """
    if settings.find("joint_names") is None and settings.find("joint_ids") is not None:
        settings.raise_invalid("joint_ids", "absent, with the joints in `joint_names`")
    patterns = settings.texts("joint_names") if settings.find("joint_names") is not None else (".*",)
    keeps_order = settings.find("preserve_order") is True
    if keeps_order and len(patterns) == 12 and all(pattern.isidentifier() for pattern in patterns):
        return patterns
    if asset_joints is None:
        known = ", ".join(word for words in FAMILIES for word in words.split())
        fault = f"unknown order of the joints; known: {known}, in PhysX"
        raise PolicyError(fault, f"add the run's IO descriptor (io_descriptors/*.yaml), or {WRITE_TOML}")
    if keeps_order:
        return tuple(
            dict.fromkeys(name for pattern in patterns for name in asset_joints if joint_name_matches(pattern, name))
        )
    return tuple(name for name in asset_joints if any(joint_name_matches(pattern, name) for pattern in patterns))


def _parse_offset(action: FileSettings, joints: JointNames) -> Numbers | None:
    """Return the joint targets if all actions are zero, rad; None if they are the default position."""
    if action.find("use_default_offset") is True:
        return None
    return action.joint_values("offset", joints, 0.0)


def _parse_observed_joints(
    group: FileSettings, terms: dict[str, SpecTerm], joints: JointNames, asset_joints: JointNames | None
) -> JointNames | None:
    """Return the joint names in the order of the observation; None if it is the order of `joints`."""

    def order(name: str) -> JointNames:
        return _select_joints(group.section(name).optional_section("params", "asset_cfg"), asset_joints)

    observed = observed_order(terms, order)
    return observed if observed != joints else None


def _parse_term(settings: FileSettings, group: FileSettings, term: FileSettings) -> SpecTerm:
    """Parse an observation term; a history length of its group replaces the term's own.

    Raises PolicyError if the term is unsupported.
    """
    function = _function_name(term)
    if function == "generated_commands":
        name = term.section("params").text("command_name")
        kind = settings.section("commands", name).text("class_type").rpartition(":")[2]
        if "VelocityCommand" not in kind:
            raise PolicyError(f"the command {name} is a {kind}; supported: velocity commands", WRITE_TOML)
    grid = _parse_grid(settings, term.section("params")) if function == "height_scan" else None
    parsed = make_term(function, term, grid)
    return parsed if group.find("history_length") is None else replace(parsed, history=history_length(group))


def _function_name(term: FileSettings) -> str:
    return term.text("func").rpartition(":")[2]


def _parse_grid(settings: FileSettings, params: FileSettings) -> HeightGrid:
    """Parse the points of a height scan: a grid around the sensor that turns with the trunk's yaw.

    Raises PolicyError if the grid does not turn with the yaw, or has too few or too many points.
    """
    sensor = settings.section("scene", params.section("sensor_cfg").text("name"))
    if sensor.find("ray_alignment") != "yaw" and sensor.find("attach_yaw_only") is not True:
        sensor.raise_invalid("ray_alignment", "yaw")
    grid = sensor.section("pattern_cfg")
    step = grid.number("resolution")
    size = grid.numbers("size", 2)
    offset = sensor.optional_section("offset").numbers("pos", 3, 0.0)
    if not 0 < step <= min(size) or max(size) > 100 * step:
        grid.raise_invalid("resolution", "a step that gives 2 to 100 points along each side")
    x, y = (
        tuple(round(middle - side / 2 + step * index, 9) for index in range(int((side + 1e-9) / step) + 1))
        for side, middle in zip(size, offset, strict=False)
    )
    return HeightGrid(x, y, x_first=grid.find("ordering") != "yx", offset=params.number("offset", 0.5))


def _parse_gain(robot: FileSettings, joint: str, kind: str) -> float:
    """Return the stiffness or damping, named by `kind`, of a joint's actuator.

    Raises PolicyError if no actuator has the joint.
    """
    for _, actuator in robot.section("actuators").sections():
        if any(joint_name_matches(pattern, joint) for pattern in actuator.texts(_ACTUATOR_JOINTS)):
            return actuator.joint_values(kind, (joint,))[0]
    raise PolicyError(f"no actuator in {robot.file.name} has the joint {joint}")


def _parse_action_clip(settings: FileSettings) -> Range | None:
    """Return the range to which rsl_rl's wrapper clips raw actions; None if there are no limits.

    The range is in the file `agent.yaml` next to the settings.
    """
    file = settings.file.with_name("agent.yaml")
    if not file.is_file():
        return None
    agent = load_settings(file)
    if agent.find("clip_actions") is None:
        return None
    limit = agent.number("clip_actions")
    return -limit, limit
