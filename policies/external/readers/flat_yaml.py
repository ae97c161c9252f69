"""Reader of deployment scripts' flat settings: YAML files with a policy's settings as top-level keys.

The settings are for example servo gains, default position and scales. Most of these files lack the observation terms,
so that their specification is incomplete.

Sources: unitreerobotics/unitree_rl_gym `deploy/deploy_mujoco/configs/*.yaml` (`policy_path`, `kps`, `kds`,
`default_angles`, `simulation_dt`, `control_decimation`). In unitree_rl_gym, the joints are in the order of the model
file, and the observation is defined in the code of `deploy_mujoco.py`. Scripts derived from fan-ziqi/rl_sar use the
keys of rl_sar's `config.yaml`.
"""

import os
from pathlib import Path
from typing import Any

from policies.base import PolicyError
from policies.external.readers import rl_sar
from policies.external.readers.drafts import IncompleteSpecError
from policies.external.readers.settings import FileSettings
from policies.external.spec import PolicySpec
from quad_env.files.text import brief

KEYS = {
    "stiffness": ("rl_kp", "kps", "p_gains", "kp", "stiffness"),
    "damping": ("rl_kd", "kds", "d_gains", "kd", "damping"),
    "default_position": ("default_dof_pos", "default_angles", "default_joint_pos", "default_joint_angles"),
    "action_scale": ("action_scale",),
}
"""Name of a field of `PolicySpec` -> keys under which deployment scripts store this field.

The first key that a file contains is used.
"""
_NETWORK_KEYS = "policy_path", "model_name", "policy_name", "model_path", "onnx_path", "policy"
"""Keys under which deployment scripts store the path of the network file."""
_PERIOD_KEYS = ("simulation_dt", "control_decimation"), ("dt", "decimation"), ("sim_dt", "decimation")
"""Pairs of keys for the control period: simulation time step, s, and time steps per control step."""
_SCALE_KEYS = "lin_vel_scale", "ang_vel_scale", "cmd_scale", "commands_scale", "dof_pos_scale", "dof_vel_scale"
"""Keys under which deployment scripts store the scales of observation terms."""
_BLIND = "angular_velocity, projected_gravity, command, joint_position, joint_velocity, previous_action"
"""Names of the observation terms of a policy that observes neither linear velocity nor ground heights."""
_TERMS_BY_WIDTH = {45: _BLIND, 47: f"{_BLIND}, gait_clock", 48: f"linear_velocity, {_BLIND}"}
"""Number of observed values in the scripts of unitree_rl_gym -> likely observation terms.

The numbers are for robots with twelve joints.
"""


def is_flat(settings: FileSettings) -> bool:
    """Return True if a file has flat settings: servo gains and default position are top-level keys."""
    required = KEYS["stiffness"], KEYS["damping"], KEYS["default_position"]
    return all(any(settings.find(key) is not None for key in keys) for keys in required)


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from flat settings, if the settings have the keys of rl_sar.

    Settings with other keys never contain the observation terms. For them, IncompleteSpecError is always raised.

    Args:
        settings: Flat settings of a YAML file.

    Returns:
        Specification of the policy.

    Raises:
        IncompleteSpecError: The settings lack fields of the specification.
        PolicyError: The value of a setting is wrong.
    """
    if settings.find("observations") is not None and settings.find("model_name") is not None:
        robot_section = FileSettings({settings.file.stem: settings.values}, settings.file)
        try:
            return rl_sar.parse_spec(robot_section)
        except PolicyError as error:
            if not _is_missing_field(error):
                raise
            kind = "flat settings with rl_sar's keys"
            raise IncompleteSpecError(kind, known_fields(settings), advice_lines(settings)) from None
    kind = "a configuration of unitree_rl_gym's deploy_mujoco" if settings.find("kps") is not None else "flat settings"
    raise IncompleteSpecError(kind, known_fields(settings), advice_lines(settings))


def parse_robot_section(settings: FileSettings) -> PolicySpec:
    """Parse a policy's specification from the `config.yaml` of rl_sar, of any version.

    Args:
        settings: Settings of the file, with one section; the key of the section is the name of the robot.

    Returns:
        Specification of the policy.

    Raises:
        IncompleteSpecError: The file does not name the observation terms, because it is of rl_sar v2.1 or older.
    """
    ((_, robot_section),) = settings.sections()
    if robot_section.find("observations") is not None:
        return rl_sar.parse_spec(settings)
    known = known_fields(robot_section)
    raise IncompleteSpecError("a config.yaml of rl_sar v2.1 or older", known, advice_lines(robot_section))


def _is_missing_field(error: PolicyError) -> bool:
    return " has no `" in error.fault or "neither " in error.fault or "there is no network" in error.fault


def known_fields(settings: FileSettings) -> dict[str, Any]:
    """Return the fields of a specification that flat settings contain: field name -> value.

    Raises PolicyError if a value has a wrong type.
    """
    known: dict[str, Any] = {}
    networks = (_find_network(settings, settings.find(key)) for key in _NETWORK_KEYS)
    network = next((file for file in networks if file is not None), None)
    if network is not None:
        known["network"] = network
    for step, decimation in _PERIOD_KEYS:
        if settings.find(step) is not None and settings.find(decimation) is not None:
            known["control_rate"] = 1 / (settings.number(step) * settings.number(decimation))
            break
    if settings.find("joint_names") is not None:
        known["joints"] = settings.texts("joint_names")
    for name, keys in KEYS.items():
        key = next((each for each in keys if settings.find(each) is not None), None)
        if key is not None:
            known[name] = settings.numbers(key)
    return known


def _find_network(settings: FileSettings, path: object) -> Path | None:
    """Return the absolute path of the network that the settings give as `path`; None if there is no file.

    First, `path` is used relative to the folder of the settings file. If there is no file, the last part of `path` is
    used in this folder, because `path` may begin with a placeholder, as in `{ROOT}/pre_train/go2/motion.pt`.
    """
    if not isinstance(path, str) or not path:
        return None
    name = path.replace("\\", "/").rpartition("/")[2]
    for candidate in (path, name):
        try:
            file = settings.file.parent / candidate
            if name and file.is_file():
                return Path(os.path.abspath(file))
        except (OSError, ValueError):
            continue
    return None


def advice_lines(settings: FileSettings) -> tuple[str, ...]:
    """Return hints that help a user to write the missing observation terms, one line each.

    They quote the settings for the number of observed values, the scales, and the order of the joints.
    """
    lines = []
    for key in ("num_obs", "num_observations"):
        if settings.find(key) is not None:
            width = int(settings.number(key))
            terms = f"; perhaps {_TERMS_BY_WIDTH[width]}" if width in _TERMS_BY_WIDTH else ""
            lines.append(f"{key} = {width}{terms}")
    lines += [f"{key} = {brief(settings.find(key))}" for key in _SCALE_KEYS if settings.find(key) is not None]
    if settings.find("xml_path") is not None:
        lines.append("the joints are in the order of its model file (xml_path)")
    return tuple(lines)
