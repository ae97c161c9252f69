"""`python -m quad_env COMMAND` for the commands that need more than the environment; `python -m live` is the same."""

import sys
from pathlib import Path

if __name__ == "__main__":  # so that no `evaluate.py` of the user's is imported
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from quad_env.cli import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()
    launcher.check_packages("quad_env", "live")

from quad_env.cli.command_line import UsageError
from quad_env.cli.program import Command, Program

COMMANDS = {
    "dataset": Command("live.commands.dataset", "episodes of a policy as a Minari dataset"),
    "view": Command("live.commands.view", "robots in the browser, to watch, steer and push"),
    "film": Command("live.commands.film", "an episode as a film: policies side by side, a ghost of the command"),
    "policies": Command("live.commands.policies", "the policies by name, what each is, what was trained on what"),
    "record": Command("live.commands.record", "an episode as an MCAP file or a ROS 2 bag"),
    "ros": Command("live.commands.ros", "the simulated robot as a ROS node, in real time"),
}


def _unknown(words: list[str]) -> int:
    if not words or words[0] in ("-h", "--help"):
        print(f"python -m quad_env COMMAND, each with its own --help:\n{PROGRAM.listing()}")
        return 0
    raise UsageError(f"there is no command {words[0]}; there are {', '.join(COMMANDS)}")


PROGRAM = Program("python -m quad_env", COMMANDS, _unknown)

if __name__ == "__main__":
    raise SystemExit(launcher.launch(PROGRAM.main))
