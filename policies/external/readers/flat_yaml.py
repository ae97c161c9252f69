"""Flat settings of deployment scripts: gains, default position and scales by key, without a robot's name above.

Sources: unitreerobotics/unitree_rl_gym `deploy/deploy_mujoco/configs/*.yaml` (`policy_path`, `kps`, `kds`,
`default_angles`, `simulation_dt`, `control_decimation`), whose joints are those of its model file and whose observation
is in `deploy_mujoco.py`; runners after fan-ziqi/rl_sar, whose keys are those of its `config.yaml`.
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
"""Keys of a description's fields with a value per joint."""
_NETWORKS = "policy_path", "model_name", "policy_name", "model_path", "onnx_path", "policy"
_PERIODS = ("simulation_dt", "control_decimation"), ("dt", "decimation"), ("sim_dt", "decimation")
"""Keys of the time step and of the time steps per control step."""
_SCALES = "lin_vel_scale", "ang_vel_scale", "cmd_scale", "commands_scale", "dof_pos_scale", "dof_vel_scale"
_BLIND = "angular_velocity, projected_gravity, command, joint_position, joint_velocity, previous_action"
_WIDTHS = {45: _BLIND, 47: f"{_BLIND}, gait_clock", 48: f"linear_velocity, {_BLIND}"}
"""Terms of unitree_rl_gym's scripts by the width of their observation, for twelve joints."""


def is_flat(settings: FileSettings) -> bool:
    """Return whether the settings have gains and a default position at the top."""
    wanted = KEYS["stiffness"], KEYS["damping"], KEYS["default_position"]
    return all(any(settings.find(key) is not None for key in keys) for keys in wanted)


def parse_spec(settings: FileSettings) -> PolicySpec:
    """Return the policy of flat settings with rl_sar's keys. Raises PolicyError, Incomplete for other flat settings."""
    if settings.find("observations") is not None and settings.find("model_name") is not None:
        named = FileSettings({settings.file.stem: settings.values}, settings.file)
        try:
            return rl_sar.parse_spec(named)
        except PolicyError as error:
            if not _is_missing(error):
                raise
            raise IncompleteSpecError(
                "flat settings with rl_sar's keys", known_fields(settings), advice_lines(settings)
            ) from None
    kind = "a configuration of unitree_rl_gym's deploy_mujoco" if settings.find("kps") is not None else "flat settings"
    raise IncompleteSpecError(kind, known_fields(settings), advice_lines(settings))


def _is_missing(error: PolicyError) -> bool:
    return " has no `" in error.fault or "neither " in error.fault or "there is no network" in error.fault


def known_fields(settings: FileSettings) -> dict[str, Any]:
    """Return the fields of a description that flat settings give. Raises PolicyError for values of another kind."""
    known: dict[str, Any] = {}
    network = next((found for key in _NETWORKS if (found := _network(settings, settings.find(key))) is not None), None)
    if network is not None:
        known["network"] = network
    for step, decimation in _PERIODS:
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


def _network(settings: FileSettings, given: object) -> Path | None:
    """Return the network of a path such as `{ROOT}/pre_train/go2/motion.pt`, from the file or next to it."""
    if not isinstance(given, str) or not given:
        return None
    name = given.replace("\\", "/").rpartition("/")[2]
    for place in (given, name):
        try:
            if name and (file := settings.file.parent / place).is_file():
                return Path(os.path.abspath(file))
        except (OSError, ValueError):
            continue
    return None


def advice_lines(settings: FileSettings) -> tuple[str, ...]:
    """Return the settings on their observation, a line each."""
    lines = []
    for key in ("num_obs", "num_observations"):
        if settings.find(key) is not None:
            width = int(settings.number(key))
            lines.append(f"{key} = {width}" + (f"; perhaps {_WIDTHS[width]}" if width in _WIDTHS else ""))
    lines += [f"{key} = {brief(settings.find(key))}" for key in _SCALES if settings.find(key) is not None]
    if settings.find("xml_path") is not None:
        lines.append("the joints are in the order of its model file (xml_path)")
    return tuple(lines)
