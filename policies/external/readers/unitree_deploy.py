"""Reader of Unitree's `deploy.yaml`, the settings of a policy for deployment on a robot.

unitree_rl_lab and unitree_rl_mjlab export this file together with a network. Joint i of the policy is motor
`joint_ids_map[i]` of Unitree's SDK. The servo gains are in the order of the motors. All other values per joint are in
the order of the policy. Observation terms are clipped and then scaled, or scaled first if `scale_first` is set. With
`use_gym_history`, all terms of a control step are together in the history, and the oldest control step is first.

Sources: unitree_rl_lab `utils/export_deploy_cfg.py` and `deploy/include/isaaclab`.
"""

from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.isaac_terms import incomplete_remarks, make_term, observed_order
from policies.external.readers.joint_orders import UNITREE_MOTORS, JointNames
from policies.external.readers.settings import FileSettings
from policies.external.spec import Numbers, PolicySpec, Range, SpecTerm


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from Unitree's `deploy.yaml`.

    Raises PolicyError if a setting is missing, wrong or unsupported.
    """
    motors = settings.permutation("joint_ids_map")
    action = _find_action(settings)
    order = action.permutation("joint_ids", optional=True)
    asset_joints = tuple(UNITREE_MOTORS[motor] for motor in motors)
    joints = _select_joints(asset_joints, action)
    stiffness = settings.numbers("stiffness")
    damping = settings.numbers("damping")
    default_position = _in_order(settings.numbers("default_joint_pos"), order)
    offset = action.numbers("offset", default=0.0)
    group = _observation_group(settings)
    terms = {name: _parse_term(name, term, bool(group.find("scale_first"))) for name, term in group.sections()}
    observed = _parse_observed_joints(group, terms, asset_joints)
    return PolicySpec(
        network=settings.network(),
        control_rate=1 / settings.number("step_dt"),
        joints=joints,
        default_position=default_position,
        action_scale=action.numbers("scale", default=1.0),
        action_offset=offset if offset != default_position else None,
        target_clip=_parse_target_clip(action),
        stiffness=_in_order(_in_order(stiffness, motors), order),
        damping=_in_order(_in_order(damping, motors), order),
        terms=tuple(terms.values()),
        observed_joints=observed if observed != joints else None,
        history_layout="time" if group.find("use_gym_history") else "term",
        remarks=incomplete_remarks(group.sections()),
    )


def _in_order(values: Numbers, indices: tuple[int, ...]) -> Numbers:
    return tuple(values[index] for index in indices)


def _find_action(settings: FileSettings) -> FileSettings:
    """Return the settings of the only action term in a `deploy.yaml`.

    Raises PolicyError if there are several action terms, or if the term is not a JointPositionAction.
    """
    actions = settings.section("actions")
    if list(actions.values) != ["JointPositionAction"]:
        settings.raise_invalid("actions", "JointPositionAction alone")
    return actions.section("JointPositionAction")


def _observation_group(settings: FileSettings) -> FileSettings:
    """Return the settings of all observation terms in a `deploy.yaml`, one section per term.

    The sections are at the top level of `observations`, or in its only group. Raises PolicyError if there are several
    groups, because the network then has several inputs.
    """
    observations = settings.section("observations")
    groups = [group for _, group in observations.sections()]
    if not groups or "params" in groups[0].values:
        return observations
    if len(groups) > 1:
        settings.raise_invalid("observations", "those of one input")
    return groups[0]


def _parse_observed_joints(
    group: FileSettings, terms: dict[str, SpecTerm], asset_joints: JointNames
) -> JointNames | None:
    """Return the joint names in the order of the observation; None if no term contains joint quantities.

    `asset_joints` has all joint names in the order of the key `joint_ids_map`.
    """

    def order(name: str) -> JointNames:
        return _select_joints(asset_joints, group.section(name).optional_section("params", "asset_cfg"))

    return observed_order(terms, order)


def _parse_term(name: str, settings: FileSettings, scale_first: bool) -> SpecTerm:
    """Parse the observation term `name` from its settings.

    If `scale_first` is True, the term is scaled before it is clipped. A `PolicySpec` clips first. The clip is therefore
    divided by the scale. Raises PolicyError if the term has several scales, or a scale that is not positive.
    """
    term = make_term(name, settings)
    if not scale_first or term.clip is None:
        return term
    if len(term.scale) > 1 or term.scale[0] <= 0:
        raise PolicyError(f"`scale_first` with a clip needs one positive scale for all numbers of {name}")
    return replace(term, clip=(term.clip[0] / term.scale[0], term.clip[1] / term.scale[0]))


def _select_joints(asset_joints: JointNames, settings: FileSettings) -> JointNames:
    return tuple(asset_joints[index] for index in settings.permutation("joint_ids", optional=True))


def _parse_target_clip(action: FileSettings) -> tuple[Range, ...] | None:
    """Return minimum and maximum of each joint target, in the order of the actions, rad; None: no limits.

    Raises PolicyError if the setting `clip` of the action is not a list of ranges.
    """
    clip = action.find("clip")
    if clip is None:
        return None
    if not isinstance(clip, list):
        action.raise_invalid("clip", "12 ranges")
    ranges = FileSettings(dict(enumerate(clip)), action.file, f"{action.key_prefix}clip.")
    return tuple(map(ranges.range, ranges.values))
