"""Unitree's `deploy.yaml`, which unitree_rl_lab and unitree_rl_mjlab export next to a network.

Sources: unitree_rl_lab `utils/export_deploy_cfg.py` and `deploy/include/isaaclab`. Joint i of the policy is motor
`joint_ids_map[i]` of Unitree's SDK. Gains are in the order of the motors, all else in the policy's order. Terms are
clipped, then scaled, unless `scale_first`; `use_gym_history` puts a history by time, oldest first.
"""

from dataclasses import replace

from policies.base import PolicyError
from policies.external.readers.isaac_terms import incomplete_remarks, make_term, observed_order
from policies.external.readers.joint_orders import UNITREE_MOTORS, JointNames
from policies.external.readers.settings import FileSettings
from policies.external.spec import Numbers, PolicySpec, Range, SpecTerm


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Return the policy of a `deploy.yaml`. A fault raises PolicyError."""
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
    """Return the only action, joint positions. Raises PolicyError."""
    actions = settings.section("actions")
    if list(actions.values) != ["JointPositionAction"]:
        settings.raise_invalid("actions", "JointPositionAction alone")
    return actions.section("JointPositionAction")


def _observation_group(settings: FileSettings) -> FileSettings:
    """Return the observations of the only input. Raises PolicyError."""
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
    """Return the order of the observed joints; None if no term observes joints."""

    def order(name: str) -> JointNames:
        return _select_joints(asset_joints, group.section(name).optional_section("params", "asset_cfg"))

    return observed_order(terms, order)


def _parse_term(name: str, settings: FileSettings, scale_first: bool) -> SpecTerm:
    """Return an observation term; the clip of a term that is scaled first applies to its unscaled values."""
    term = make_term(name, settings)
    if not scale_first or term.clip is None:
        return term
    if len(term.scale) > 1 or term.scale[0] <= 0:
        raise PolicyError(f"`scale_first` with a clip needs one positive scale for all numbers of {name}")
    return replace(term, clip=(term.clip[0] / term.scale[0], term.clip[1] / term.scale[0]))


def _select_joints(asset_joints: JointNames, settings: FileSettings) -> JointNames:
    return tuple(asset_joints[index] for index in settings.permutation("joint_ids", optional=True))


def _parse_target_clip(action: FileSettings) -> tuple[Range, ...] | None:
    """Return the ranges of the targets, rad; None without limits. Raises PolicyError."""
    clip = action.find("clip")
    if clip is None:
        return None
    if not isinstance(clip, list):
        action.raise_invalid("clip", "12 ranges")
    ranges = FileSettings(dict(enumerate(clip)), action.file, f"{action.key_prefix}clip.")
    return tuple(map(ranges.range, ranges.values))
