"""Reader of flat settings of deployment scripts.

Gains, default position and scales are top-level keys of a YAML file.

Sources: unitreerobotics/unitree_rl_gym `deploy/deploy_mujoco/configs/*.yaml` (`policy_path`, `kps`, `kds`,
`default_angles`, `simulation_dt`, `control_decimation`). In unitree_rl_gym, the joints are in the order of the model
file, and `deploy_mujoco.py` computes the observation. Scripts derived from fan-ziqi/rl_sar use the keys of rl_sar's
`config.yaml`.
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
"""Field of the specification with one value per joint -> keys of this field in flat settings."""
_NETWORK_KEYS = "policy_path", "model_name", "policy_name", "model_path", "onnx_path", "policy"
_PERIOD_KEYS = ("simulation_dt", "control_decimation"), ("dt", "decimation"), ("sim_dt", "decimation")
"""Pairs of keys: the simulation time step, s, and the number of time steps per control step."""
_SCALE_KEYS = "lin_vel_scale", "ang_vel_scale", "cmd_scale", "commands_scale", "dof_pos_scale", "dof_vel_scale"
_BLIND = "angular_velocity, projected_gravity, command, joint_position, joint_velocity, previous_action"
_TERMS_BY_WIDTH = {45: _BLIND, 47: f"{_BLIND}, gait_clock", 48: f"linear_velocity, {_BLIND}"}
"""Width of the observation in unitree_rl_gym's scripts -> likely terms, for twelve joints."""


def is_flat(settings: FileSettings) -> bool:
    """Return True if gains and default position are top-level keys of the settings."""
    required = KEYS["stiffness"], KEYS["damping"], KEYS["default_position"]
    return all(any(settings.find(key) is not None for key in keys) for keys in required)


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Parse flat settings with rl_sar's keys; settings with other keys are always incomplete.

    Args:
        settings: Flat settings.

    Returns:
        Specification of the policy.

    Raises:
        IncompleteSpecError: The settings lack fields.
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
    """Parse rl_sar's `config.yaml`.

    Args:
        settings: Settings with one section; its key is the name of the robot.

    Returns:
        Specification of the policy.

    Raises:
        IncompleteSpecError: The file does not name the observation terms, because it is from v2.1 or older.
    """
    ((_, robot_section),) = settings.sections()
    if robot_section.find("observations") is not None:
        return rl_sar.parse_spec(settings)
    known = known_fields(robot_section)
    raise IncompleteSpecError("a config.yaml of rl_sar v2.1 or older", known, advice_lines(robot_section))


def _is_missing_field(error: PolicyError) -> bool:
    return " has no `" in error.fault or "neither " in error.fault or "there is no network" in error.fault


def known_fields(settings: FileSettings) -> dict[str, Any]:
    """Return the known fields of the specification, name -> value.

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
    """Return the absolute path of the network; None if the file does not exist.

    The given path may begin with a placeholder, as in `{ROOT}/pre_train/go2/motion.pt`. The path is tried relative to
    the folder of the settings. Then a file with the last part of the path is searched in this folder.
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
    """Return the settings that help a user to write the observation terms, one line each."""
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
