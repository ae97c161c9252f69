"""Program `python -m quad_env`: lists robots and policies, and shows, films and records episodes.

Some commands need policies. The policies are in packages that the distribution `simple-quad` does not contain.
"""

import sys

from quad_env.cli import launcher

# Ctrl-C is handled from here on, because the user may press it during the next imports.
if __name__ == "__main__":
    launcher.leave_on_interrupt()
    if launcher.HAS_BENCH:
        # The project comes first in the import path, because the user's folder may contain a file `evaluate.py`.
        sys.path.insert(0, str(launcher.ROOT))

from quad_env.cli.program import Command, Program

_ALL_COMMANDS = {
    "info": Command("quad_env.info", "robot, spaces, actuators and sensors of the environment"),
    "describe": Command(
        "quad_env.describe", "legs, joints and servos of a robot's model, and a test that the robot stands"
    ),
    "doctor": Command(
        "live.commands.doctor" if launcher.HAS_BENCH else "quad_env.doctor.command",
        "faults of the installation, a robot or a policy, with their remedies",
    ),
    "scenarios": Command("quad_env.scenarios.listing", "all scenarios: their events, severities and notation"),
    "policies": Command(
        "live.commands.policies", "the policies by name, their kinds, and the training of the trained ones"
    ),
    "view": Command("live.commands.view", "robots in the browser, to watch, steer and push"),
    "film": Command("live.commands.film", "an episode as a film, policies side by side"),
    "record": Command("live.commands.record", "an episode as an MCAP file"),
    "ros": Command("live.commands.ros", "the simulated robot as a ROS node, in real time"),
    "unitree": Command("live.commands.unitree", "the simulated robot on the network, as Unitree's SDK2 sees it"),
    "drive": Command("live.commands.drive", "a policy that drives a robot over Unitree's SDK2 interface"),
}
COMMANDS = {
    name: each for name, each in _ALL_COMMANDS.items() if launcher.HAS_BENCH or each.module.startswith("quad_env.")
}
MISSING = [name for name in _ALL_COMMANDS if name not in COMMANDS]
BENCH = "part of simple-quad-bench: pip install simple-quad-bench, or pip install -e . in a clone"
ELSEWHERE = {"dataset": "now `python examples/clients/minari_dataset.py`"} | dict.fromkeys(MISSING, BENCH)
NOTE = f"  {', '.join(MISSING)}: {BENCH}" if MISSING else ""
PROGRAM = Program("python -m quad_env", COMMANDS, moved_commands=ELSEWHERE, note=NOTE)
main = PROGRAM.main

if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
