"""Choice of a Python that has ROS, and of an environment in which it listens on this machine alone."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

from quad_env.cli.command_line import UsageError

_MESSAGES = ("geometry_msgs", "rosgraph_msgs", "sensor_msgs", "std_msgs")
REQUIRED_MODULES = {"1": ("rospy", "rosmaster", *_MESSAGES), "2": ("rclpy", *_MESSAGES)}
"""Version of ROS -> the modules that must be importable."""
ROOT = Path(__file__).parents[2]
"""Folder that contains the package `live`."""
DEFAULT_MASTER = "http://localhost:11311"
_PROFILE = str(Path(__file__).with_name("loopback.xml"))
LOOPBACK_ENVIRONMENT = {
    # ROS 1 listens on all interfaces unless its own address is a loopback one.
    "ROS_IP": "127.0.0.1",
    # Either of these limits the discovery of ROS 2 to this machine, but Fast DDS would still receive from everywhere.
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "FASTRTPS_DEFAULT_PROFILES_FILE": _PROFILE,
    "FASTDDS_DEFAULT_PROFILES_FILE": _PROFILE,
}
"""Variables that limit a node to the loopback interface."""
INSTALL_HINT = (
    "on Debian: apt-get install python3-rospy python3-rosmaster python3-std-msgs python3-sensor-msgs "
    "python3-geometry-msgs python3-rosgraph-msgs; or source the setup.bash of your ROS"
)


def find(version: str | None) -> tuple[str, str]:
    """Find a Python that can import ROS.

    Args:
        version: Version of ROS; None for the sourced one, else for any.

    Returns:
        version: Version of ROS.
        python: Path of the Python.

    Raises:
        UsageError: No Python here has ROS.
    """
    requested = version or os.environ.get("ROS_VERSION")
    versions = [requested] if requested in REQUIRED_MODULES else list(REQUIRED_MODULES)
    on_path = (os.path.join(folder, "python3") for folder in os.get_exec_path())
    pythons = dict.fromkeys(path for path in ("/usr/bin/python3", *on_path, sys.executable) if os.access(path, os.X_OK))
    for candidate in versions:
        for python in pythons:
            if _can_import(python, REQUIRED_MODULES[candidate]):
                return candidate, python
    wanted = " or ".join(f"ROS {candidate}" for candidate in versions)
    raise UsageError(f"no Python here has {wanted} (asked: {', '.join(pythons)}): {INSTALL_HINT}")


def _can_import(python: str, modules: Sequence[str]) -> bool:
    """Return True if a Python finds all the modules."""
    probe = f"import importlib.util as u, sys; sys.exit(None in map(u.find_spec, {tuple(modules)!r}))"
    return subprocess.run([python, "-c", probe], capture_output=True, check=False).returncode == 0


def environment(base: Mapping[str, str], network: bool) -> dict[str, str]:
    """Build the environment of the ROS process.

    Args:
        base: Environment of this process.
        network: True to listen as the variables of ROS say; False for the loopback interface alone.

    Returns:
        The environment.

    Raises:
        UsageError: The ROS master is on another machine, and `network` is False.
    """
    variables = {"ROS_MASTER_URI": DEFAULT_MASTER, **base}
    # The project's folder is last, so that none of its names hides one of ROS.
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, (base.get("PYTHONPATH"), str(ROOT))))
    if network:
        return variables
    if not _is_local(variables["ROS_MASTER_URI"]):
        raise UsageError(f"ROS_MASTER_URI is {variables['ROS_MASTER_URI']}, another machine: --network lets it in")
    for name in ("ROS_HOSTNAME", "ROS_IPV6"):
        variables.pop(name, None)
    return variables | LOOPBACK_ENVIRONMENT


def _is_local(uri: str) -> bool:
    """Return True for an address on the loopback interface."""
    host = urlsplit(uri).hostname
    try:
        return host == "localhost" or ip_address(host or "").is_loopback
    except ValueError:  # a name, and its address may change
        return False
