"""Search for a Python that has ROS, and environment variables that limit ROS to this machine."""

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
"""Version of ROS -> modules that the Python must be able to import."""
ROOT = Path(__file__).parents[2]
"""Folder that contains the package `live`."""
DEFAULT_MASTER = "http://localhost:11311"
_PROFILE = str(Path(__file__).with_name("loopback.xml"))
LOOPBACK_ENVIRONMENT = {
    # ROS 1 listens on all interfaces unless its own address is a loopback one.
    "ROS_IP": "127.0.0.1",
    # Each of the next two variables limits the discovery of ROS 2 to this machine, depending on the version of ROS 2.
    # The profile is also needed, because Fast DDS would still receive packets from other machines.
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "FASTRTPS_DEFAULT_PROFILES_FILE": _PROFILE,
    "FASTDDS_DEFAULT_PROFILES_FILE": _PROFILE,
}
"""Environment variables that limit a node to the loopback interface: name -> value."""
INSTALL_HINT = (
    "on Debian: apt-get install python3-rospy python3-rosmaster python3-std-msgs python3-sensor-msgs "
    "python3-geometry-msgs python3-rosgraph-msgs; or source the setup.bash of your ROS"
)


def find(version: str | None) -> tuple[str, str]:
    """Find a Python that can import ROS.

    Args:
        version: Version of ROS, `1` or `2`. None for the version that is sourced, or for any version if none is.

    Returns:
        version: Version of ROS that the Python has.
        python: Path of the Python executable.

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
    """Return True if the Python at the path `python` finds all `modules`."""
    probe = f"import importlib.util as u, sys; sys.exit(None in map(u.find_spec, {tuple(modules)!r}))"
    return subprocess.run([python, "-c", probe], capture_output=True, check=False).returncode == 0


def environment(base: Mapping[str, str], network: bool) -> dict[str, str]:
    """Build the environment variables of the ROS process.

    Args:
        base: Environment variables of this process.
        network: True to listen as the variables of ROS say; False to listen only on the loopback interface.

    Returns:
        Environment variables: name -> value.

    Raises:
        UsageError: The ROS master is on another machine, and `network` is False.
    """
    variables = {"ROS_MASTER_URI": DEFAULT_MASTER, **base}
    # The folder of the project is last, so that no module of the project hides a module of ROS.
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, (base.get("PYTHONPATH"), str(ROOT))))
    if network:
        return variables
    if not _is_local(variables["ROS_MASTER_URI"]):
        raise UsageError(f"ROS_MASTER_URI is {variables['ROS_MASTER_URI']}, another machine: --network lets it in")
    for name in ("ROS_HOSTNAME", "ROS_IPV6"):
        variables.pop(name, None)
    return variables | LOOPBACK_ENVIRONMENT


def _is_local(uri: str) -> bool:
    """Return True if the URI has the host `localhost` or a loopback address."""
    host = urlsplit(uri).hostname
    try:
        return host == "localhost" or ip_address(host or "").is_loopback
    except ValueError:  # False for a host name, because its address may change
        return False
