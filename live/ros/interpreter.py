"""The Python that has ROS, and the environment in which it listens on this machine alone."""

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
"""What must be importable for each version of ROS."""
ROOT = Path(__file__).parents[2]
DEFAULT_MASTER = "http://localhost:11311"
_PROFILE = str(Path(__file__).with_name("loopback.xml"))
LOOPBACK_ENVIRONMENT = {
    # ROS 1 listens on all interfaces unless its own address is a loopback one.
    "ROS_IP": "127.0.0.1",
    # ROS 2 looks for others on this machine alone by one of these, and yet Fast DDS would hear from everywhere.
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "FASTRTPS_DEFAULT_PROFILES_FILE": _PROFILE,
    "FASTDDS_DEFAULT_PROFILES_FILE": _PROFILE,
}
"""Variables that keep a node to the loopback interface."""
INSTALL_HINT = (
    "on Debian: apt-get install python3-rospy python3-rosmaster python3-std-msgs python3-sensor-msgs "
    "python3-geometry-msgs python3-rosgraph-msgs; or source the setup.bash of your ROS"
)


def find(version: str | None) -> tuple[str, str]:
    """Version of ROS and path of a Python that imports it: of the version asked for, else of the one that is sourced,
    else of any. Raises UsageError."""
    wanted = version or os.environ.get("ROS_VERSION")
    versions = [wanted] if wanted in REQUIRED_MODULES else list(REQUIRED_MODULES)
    on_path = (os.path.join(folder, "python3") for folder in os.get_exec_path())
    pythons = dict.fromkeys(each for each in ("/usr/bin/python3", *on_path, sys.executable) if os.access(each, os.X_OK))
    for each in versions:
        for python in pythons:
            if _imports(python, REQUIRED_MODULES[each]):
                return each, python
    wanted = " or ".join(f"ROS {each}" for each in versions)
    raise UsageError(f"no Python here has {wanted} (asked: {', '.join(pythons)}): {INSTALL_HINT}")


def _imports(python: str, modules: Sequence[str]) -> bool:
    probe = f"import importlib.util as u, sys; sys.exit(None in map(u.find_spec, {tuple(modules)!r}))"
    return subprocess.run([python, "-c", probe], capture_output=True, check=False).returncode == 0


def environment(base: Mapping[str, str], network: bool) -> dict[str, str]:
    """That of the process that speaks ROS: to listen on the loopback interface, unless `network` leaves it to the
    variables of ROS. Raises UsageError for a master on another machine."""
    found = {"ROS_MASTER_URI": DEFAULT_MASTER, **base}
    # Last, so that none of the project's names hides one of ROS's.
    found["PYTHONPATH"] = os.pathsep.join(filter(None, (base.get("PYTHONPATH"), str(ROOT))))
    if network:
        return found
    if not _is_here(found["ROS_MASTER_URI"]):
        raise UsageError(f"ROS_MASTER_URI is {found['ROS_MASTER_URI']}, another machine: --network lets it in")
    for name in ("ROS_HOSTNAME", "ROS_IPV6"):
        found.pop(name, None)
    return found | LOOPBACK_ENVIRONMENT


def _is_here(uri: str) -> bool:
    host = urlsplit(uri).hostname
    try:
        return host == "localhost" or ip_address(host or "").is_loopback
    except ValueError:  # a name, whose address may change
        return False
