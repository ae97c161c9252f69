"""Descriptions of policies from the files of other projects, and a short TOML of our own."""

from pathlib import Path

from policies.base import PolicyError
from policies.external.network_kind import is_onnx
from policies.external.readers import (
    flat_yaml,
    io_descriptor,
    isaac_lab,
    legged_gym,
    mjlab_onnx,
    rl_sar,
    toml_file,
    unitree_deploy,
)
from policies.external.readers.drafts import IncompleteSpecError, write_draft
from policies.external.readers.settings import WRITE_TOML, FileSettings, load_settings
from policies.external.readers.toml_file import write_toml
from policies.external.spec import PolicySpec
from quad_env.files.text import one_line


def read(path: Path) -> PolicySpec | None:
    """The description that a file holds, or that it and the files next to it do; None for an ONNX file without one and
    for other kinds of file.

    Raises PolicyError, one line that names the file. No code of any file runs.
    """
    try:
        match path.suffix.lower():
            case ".onnx":
                return mjlab_onnx.parse_spec(path)
            case ".toml":
                return check_network_matches(toml_file.parse_spec(load_settings(path)), corrected=True)
            case ".yaml" | ".yml" | ".json":
                return check_network_matches(_settings(load_settings(path)))
    except IncompleteSpecError as error:
        raise error.at(path) from None
    except PolicyError as error:
        raise PolicyError(one_line(f"{path}: {error}")) from None
    except ZeroDivisionError:
        raise PolicyError(f"{path}: a time step, a period or a scale is zero") from None
    return None


def check_network_matches(found: PolicySpec, corrected: bool = False) -> PolicySpec:
    """Return the description if its network is in one file and has the same joints.

    Args:
        found: The description.
        corrected: Whether a user wrote it, so that other joints than the network's are no fault.

    Raises:
        PolicyError: The network's weights lie in another file, or its joints are others.
    """
    if is_onnx(found.network):
        names = mjlab_onnx.read_metadata(found.network).get("joint_names")
        if names is not None and not corrected and names != ",".join(found.joints):
            raise PolicyError(f"`joint_names` in {found.network.name} disagree, {names}", WRITE_TOML)
    return found


def _settings(found: FileSettings) -> PolicySpec:
    """The description by the project whose keys these are."""
    keys = set(found.values)
    if "joint_ids_map" in keys:
        return unitree_deploy.parse_spec(found)
    if io_descriptor.is_descriptor(found):
        return io_descriptor.parse_spec(found)
    if {"scene", "observations", "actions"} <= keys:
        return isaac_lab.parse_spec(found)
    if {"init_state", "control"} <= keys:
        return legged_gym.parse_spec(found)
    if len(keys) == 1 and any("model_name" in each.values for _, each in found.sections()):
        ((_, own),) = found.sections()
        if own.find("observations") is None:
            known = flat_yaml.known_fields(own)
            raise IncompleteSpecError("a config.yaml of rl_sar v2.1 or older", known, flat_yaml.advice_lines(own))
        return rl_sar.parse_spec(found)
    if flat_yaml.is_flat(found):
        return flat_yaml.parse_spec(found)
    raise PolicyError(
        "it is no deployment file that is read: a deploy.yaml of Unitree, Isaac Lab's params/env.yaml or IO "
        "descriptor, rl_sar's config.yaml, a configuration of deploy_mujoco, settings of legged_gym",
        WRITE_TOML,
    )


__all__ = ["IncompleteSpecError", "check_network_matches", "read", "write_draft", "write_toml"]
