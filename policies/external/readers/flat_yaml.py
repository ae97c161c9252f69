"""Flat settings of deployment scripts: gains, default position and scales by key, without a robot's name above.

Sources: unitreerobotics/unitree_rl_gym `deploy/deploy_mujoco/configs/*.yaml` (`policy_path`, `kps`, `kds`,
`default_angles`, `simulation_dt`, `control_decimation`); its joints are in the order of its model file and its
observation is in `deploy_mujoco.py`. Runners after fan-ziqi/rl_sar have the keys of its `config.yaml`.
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
"""Keys of the specification's fields with a value per joint."""
_NETWORK_KEYS = "policy_path", "model_name", "policy_name", "model_path", "onnx_path", "policy"
_PERIOD_KEYS = ("simulation_dt", "control_decimation"), ("dt", "decimation"), ("sim_dt", "decimation")
"""Keys of the time step and of the time steps per control step."""
_SCALE_KEYS = "lin_vel_scale", "ang_vel_scale", "cmd_scale", "commands_scale", "dof_pos_scale", "dof_vel_scale"
_BLIND = "angular_velocity, projected_gravity, command, joint_position, joint_velocity, previous_action"
_TERMS_BY_WIDTH = {45: _BLIND, 47: f"{_BLIND}, gait_clock", 48: f"linear_velocity, {_BLIND}"}
"""Terms of unitree_rl_gym's scripts by the width of their observation, for twelve joints."""


def is_flat(settings: FileSettings) -> bool:
    """Return True if the settings have gains and a default position at the top."""
    required = KEYS["stiffness"], KEYS["damping"], KEYS["default_position"]
    return all(any(settings.find(key) is not None for key in keys) for keys in required)


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Return the policy of flat settings with rl_sar's keys.

    Args:
        settings: Flat settings.

    Returns:
        Specification of the policy.

    Raises:
        IncompleteSpecError: The settings lack fields, as all flat settings without rl_sar's keys do.
        PolicyError: A setting is wrong.
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
    """Return the policy of rl_sar's `config.yaml`.

    Args:
        settings: Settings with one section, under the name of the robot.

    Returns:
        Specification of the policy.

    Raises:
        IncompleteSpecError: The file is of v2.1 or older and does not name the observation.
    """
    ((_, robot_section),) = settings.sections()
    if robot_section.find("observations") is not None:
        return rl_sar.parse_spec(settings)
    known = known_fields(robot_section)
    raise IncompleteSpecError("a config.yaml of rl_sar v2.1 or older", known, advice_lines(robot_section))


def _is_missing_field(error: PolicyError) -> bool:
    return " has no `" in error.fault or "neither " in error.fault or "there is no network" in error.fault


def known_fields(settings: FileSettings) -> dict[str, Any]:
    """Return the fields of a specification that flat settings give. Raises PolicyError for values of another kind."""
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
    """Return the file of a path like `{ROOT}/pre_train/go2/motion.pt`, relative to the settings or next to them."""
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
    """Return the settings that concern the observation, a line each."""
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
