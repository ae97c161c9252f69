"""`python -m quad_env COMMAND`: the environment, robots and policies by name, and episodes to watch, film and record.

Commands that need policies belong to other packages of a clone of the project, which add them in its `pyproject.toml`.
"""

import sys

from quad_env.cli import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()
    if launcher.IS_CLONE:
        sys.path.insert(0, str(launcher.ROOT))  # so that no `evaluate.py` of the user's is imported
        launcher.check_packages("quad_env", "live")

import tomllib

from quad_env.cli.command_line import UsageError
from quad_env.cli.program import HELP, Command, Program

SUMMARIES = {
    "info": "robot, spaces, scenarios, actuators and sensors of the environment",
    "describe": "what a robot's model says of its legs, joints and servos, and whether the robot stands",
    "doctor": "what is wrong with the installation, a robot or a policy, and what to do about it",
    "scenarios": "every scenario: what happens in it, its severities, and how to write them",
    "policies": "the policies by name, what each is, what was trained on what",
    "view": "robots in the browser, to watch, steer and push",
    "film": "an episode as a film: policies side by side, a ghost of the command",
    "record": "an episode as an MCAP file or a ROS 2 bag",
    "ros": "the simulated robot as a ROS node, in real time",
}
"""Every command, in the order in which they are listed."""
MODULES = {
    "info": "quad_env.info",
    "describe": "quad_env.describe",
    "doctor": "quad_env.doctor.command",
    "scenarios": "quad_env.scenarios.listing",
    "view": "quad_env.view",
}
"""Modules of this package's own commands."""
MOVED = {"dataset": "python examples/clients/minari_dataset.py"}
CLONE = "in a clone of the project alone: git clone it, then pip install -e ."


def _added() -> dict[str, str]:
    """Modules of the commands that other packages of a clone add or extend; none without a clone.

    They are not entry points: a wheel's would name modules that it does not hold, and those of an editable install stay
    as they were at the last `pip install`.
    """
    if not launcher.IS_CLONE:
        return {}
    project = tomllib.loads((launcher.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return dict(project["tool"]["quad_env"]["commands"])


def _otherwise(words: list[str]) -> int:
    missing = [name for name in SUMMARIES if name not in COMMANDS]
    if not words or words[0] in HELP:
        print(f"{PROGRAM.name} COMMAND, each with its own --help:\n{PROGRAM.listing()}")
        if missing:
            print(f"  {', '.join(missing)}: {CLONE}")
        return 0
    if words[0] in missing:
        raise UsageError(f"{words[0]} is {CLONE}")
    raise UsageError(f"there is no command {words[0]}; there are {', '.join(SUMMARIES)}; see {PROGRAM.name} --help")


_MODULES = MODULES | _added()
COMMANDS = {name: Command(_MODULES[name], summary) for name, summary in SUMMARIES.items() if name in _MODULES}
PROGRAM = Program("python -m quad_env", COMMANDS, _otherwise, MOVED)
main = PROGRAM.main

if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
