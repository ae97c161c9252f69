"""Reading of a policy's specification from a file of any supported format.

The format is detected by the suffix and the top-level keys of the file.
"""

from pathlib import Path

from policies.base import PolicyError
from policies.external.networks import is_onnx
from policies.external.onnx_network import read_metadata
from policies.external.readers import (
    flat_yaml,
    io_descriptor,
    isaac_lab,
    legged_gym,
    mjlab_onnx,
    toml_file,
    unitree_deploy,
)
from policies.external.readers.drafts import IncompleteSpecError
from policies.external.readers.settings import WRITE_TOML, FileSettings, load_settings
from policies.external.spec import PolicySpec
from quad_env.files.text import one_line


def read(path: Path) -> PolicySpec | None:
    """Read the specification of an external policy from a file and from the files next to it.

    The function never runs code that the files contain.

    Args:
        path: Path of the file, with any suffix.

    Returns:
        Specification of the policy; None if the file is an ONNX file that contains no specification, or if its suffix
        is not supported.

    Raises:
        IncompleteSpecError: The format of the file is known, but the file lacks fields of the specification.
        PolicyError: The file has another fault; the message is one line that names the file.
    """
    try:
        match path.suffix.lower():
            case ".onnx":
                return mjlab_onnx.parse_spec(path)
            case ".toml":
                return check_network_matches(toml_file.parse_spec(load_settings(path)), corrected=True)
            case ".yaml" | ".yml" | ".json":
                return check_network_matches(_parse_by_keys(load_settings(path)))
    except IncompleteSpecError as error:
        raise IncompleteSpecError(*error.arguments_at(path)) from None
    except PolicyError as error:
        raise PolicyError(one_line(f"{path}: {error}")) from None
    except ZeroDivisionError:
        raise PolicyError(f"{path}: a time step, a period or a scale is zero") from None
    return None


def check_network_matches(spec: PolicySpec, corrected: bool = False) -> PolicySpec:
    """Check that an ONNX network is complete, and that its joint names agree with the specification.

    The check does nothing for TorchScript networks.

    Args:
        spec: Specification of the policy.
        corrected: True if a user wrote the specification; then its joint names may differ from the names in the
            metadata of the network.

    Returns:
        The same specification.

    Raises:
        PolicyError: The weights of the network are in another file, or the joint names differ.
    """
    if is_onnx(spec.network):
        names = read_metadata(spec.network).get("joint_names")
        if names is not None and not corrected and names != ",".join(spec.joints):
            raise PolicyError(f"`joint_names` in {spec.network.name} disagree, {names}", WRITE_TOML)
    return spec


def _parse_by_keys(settings: FileSettings) -> PolicySpec:
    """Parse the settings of a YAML or JSON file with the reader of the project that uses the file's keys.

    Raises PolicyError if no project uses these top-level keys.
    """
    keys = set(settings.values)
    if "joint_ids_map" in keys:
        return unitree_deploy.parse_spec(settings)
    if io_descriptor.is_descriptor(settings):
        return io_descriptor.parse_spec(settings)
    if {"scene", "observations", "actions"} <= keys:
        return isaac_lab.parse_spec(settings)
    if {"init_state", "control"} <= keys:
        return legged_gym.parse_spec(settings)
    if len(keys) == 1 and any("model_name" in section.values for _, section in settings.sections()):
        return flat_yaml.parse_robot_section(settings)
    if flat_yaml.is_flat(settings):
        return flat_yaml.parse_spec(settings)
    raise PolicyError(
        "not a known deployment file; valid: a deploy.yaml of Unitree, Isaac Lab's params/env.yaml or IO "
        "descriptor, rl_sar's config.yaml, a configuration of deploy_mujoco, settings of legged_gym",
        WRITE_TOML,
    )
