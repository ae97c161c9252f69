"""The Python that has ROS, and the environment in which it listens on this machine alone."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from quad_env.cli.command_line import UsageError

MODULES = "rclpy", "geometry_msgs", "rosgraph_msgs", "sensor_msgs", "std_msgs"
"""What must be importable."""
ROOT = Path(__file__).parents[2]
ON_THIS_MACHINE = {
    # ROS 2 looks for others on this machine alone by one of these, and yet Fast DDS would hear from everywhere.
    "ROS_LOCALHOST_ONLY": "1",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(Path(__file__).with_name("loopback.xml")),
    "FASTDDS_DEFAULT_PROFILES_FILE": str(Path(__file__).with_name("loopback.xml")),
}
"""Variables that keep a node to the loopback interface."""


def find() -> str:
    """Path of a Python that imports ROS 2. Raises UsageError."""
    on_path = (os.path.join(folder, "python3") for folder in os.get_exec_path())
    pythons = dict.fromkeys(each for each in ("/usr/bin/python3", *on_path, sys.executable) if os.access(each, os.X_OK))
    for python in pythons:
        if _has_ros(python):
            return python
    gone = "ROS 1 is gone, revision 02bbde28 has it"
    raise UsageError(f"no Python here has ROS 2 (asked: {', '.join(pythons)}): source its setup.bash; {gone}")


def _has_ros(python: str) -> bool:
    probe = f"import importlib.util as u, sys; sys.exit(None in map(u.find_spec, {MODULES!r}))"
    return subprocess.run([python, "-c", probe], capture_output=True, check=False).returncode == 0


def environment(base: Mapping[str, str], network: bool) -> dict[str, str]:
    """That of the process that speaks ROS: to listen on the loopback interface, unless `network` leaves it to the
    variables of ROS."""
    # Our folder last, so that none of the project's names hides one of ROS's.
    path = os.pathsep.join(filter(None, (base.get("PYTHONPATH"), str(ROOT))))
    return {**base, "PYTHONPATH": path} | ({} if network else ON_THIS_MACHINE)
