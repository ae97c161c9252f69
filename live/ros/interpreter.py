"""Finds a Python executable that has ROS, and sets the environment variables of the ROS process.

The ROS process connects the simulated robot to ROS. The environment variables limit ROS to this machine, unless the
user allows the network.
"""

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
"""Version of ROS, `1` or `2` -> names of the modules that the Python executable of the ROS process must import."""
ROOT = Path(__file__).parents[2]
"""Root folder of the project, which contains the package `live`."""
DEFAULT_MASTER = "http://localhost:11311"
_PROFILE = str(Path(__file__).with_name("loopback.xml"))
LOOPBACK_ENVIRONMENT = {
    # Without this address, ROS 1 would listen on all network interfaces.
    "ROS_IP": "127.0.0.1",
    # Each version of ROS 2 reads one of the next two variables, which limit the discovery of nodes to this machine.
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    # Without this profile, the middleware Fast DDS of ROS 2 would still receive packets from other machines.
    "FASTRTPS_DEFAULT_PROFILES_FILE": _PROFILE,
    "FASTDDS_DEFAULT_PROFILES_FILE": _PROFILE,
}
"""Environment variables with which a ROS node uses only the loopback network interface: name -> value."""
INSTALL_HINT = (
    "on Debian: apt-get install python3-rospy python3-rosmaster python3-std-msgs python3-sensor-msgs "
    "python3-geometry-msgs python3-rosgraph-msgs; or source the setup.bash of your ROS"
)


def find(version: str | None) -> tuple[str, str]:
    """Find a Python executable on this machine that can import ROS.

    Args:
        version: Version of ROS, `1` or `2`. None for the version in the environment variable ROS_VERSION, which ROS
            sets when its setup file is sourced; any version if the variable is not set.

    Returns:
        version: Version of ROS that the executable can import, `1` or `2`.
        python: Path of the Python executable.

    Raises:
        UsageError: No Python executable on this machine can import ROS.
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
    """Return True if the Python executable at the path `python` can import all `modules`."""
    probe = f"import importlib.util as u, sys; sys.exit(None in map(u.find_spec, {tuple(modules)!r}))"
    return subprocess.run([python, "-c", probe], capture_output=True, check=False).returncode == 0


def environment(base: Mapping[str, str], network: bool) -> dict[str, str]:
    """Build the environment variables of the ROS process.

    Args:
        base: Environment variables of this process: name -> value.
        network: True to use the network that the environment variables of ROS define. False to use only the loopback
            interface.

    Returns:
        Environment variables of the ROS process: name -> value.

    Raises:
        UsageError: The ROS master is on another machine, and `network` is False.
    """
    variables = {"ROS_MASTER_URI": DEFAULT_MASTER, **base}
    # The root folder of the project comes last, so that no module of the project hides a module of ROS.
    variables["PYTHONPATH"] = os.pathsep.join(filter(None, (base.get("PYTHONPATH"), str(ROOT))))
    if network:
        return variables
    if not _is_local(variables["ROS_MASTER_URI"]):
        raise UsageError(f"ROS_MASTER_URI is {variables['ROS_MASTER_URI']}, another machine: --network lets it in")
    for name in ("ROS_HOSTNAME", "ROS_IPV6"):
        variables.pop(name, None)
    return variables | LOOPBACK_ENVIRONMENT


def _is_local(uri: str) -> bool:
    """Return True if the host of a URI is `localhost` or a loopback address."""
    host = urlsplit(uri).hostname
    try:
        return host == "localhost" or ip_address(host or "").is_loopback
    except ValueError:  # The host is a name, possibly of another machine.
        return False
