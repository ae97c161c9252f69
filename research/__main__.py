"""Command line of the studies that measure the documentation's numbers: `python -m research COMMAND`.

`python -m research COMMAND --help` prints the description and the options of a command.
"""

import sys
from pathlib import Path

# The folder of the project comes first in `sys.path`. Otherwise a file `evaluate.py` in the working folder would hide
# the package `evaluate`.
if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from quad_env.cli import launcher

# The call is above the imports below, because Ctrl-C must also work during these slow imports.
if __name__ == "__main__":
    launcher.leave_on_interrupt()

from quad_env.cli.program import Command, Program

COMMANDS = {
    "recovery": Command("research.studies.recovery", "getting up from any pose"),
    "jump": Command("research.studies.jump", "how high standing robots jump, and how many land standing"),
    "sliding": Command("research.studies.sliding", "feet that slide, and falls under pushes, by settings of contact"),
    "estimation": Command("research.studies.estimation", "errors of estimated attitude and velocity"),
    "severities": Command("research.studies.severities", "the severity of each axis that separates policies most"),
    "time-step": Command("research.studies.time_step", "effort at physics steps of 2, 1 and 0.5 ms"),
    "straight-walking": Command("research.studies.straight_walking", "speed, pushes, uneven ground and cost of a walk"),
    "causes": Command("research.studies.causes", "rules of causes against episodes made to fail, and films of falls"),
    "gaits": Command("research.studies.gaits", "gait diagrams, strips of frames and films of every controller"),
    "calibration": Command("research.statistics.calibration", "error rates of the intervals and tests"),
    "results": Command("research.pages.results", "CSV files and figures of docs/results, and the pages that show them"),
    "simulators": Command("research.pages.simulators", "the same episodes in two simulators, as a table"),
    "leaderboard": Command("research.pages.leaderboard", "policies of a list evaluated, and the page of their results"),
    "training-speed": Command("research.pages.training_speed", "speed of training, in docs/training.md"),
    "readme": Command("research.pages.readme", "the README's scores and table of robots"),
    "search": Command("research.training.search", "parameters of policies with feedback, searched by CMA-ES"),
    "curves": Command("research.training.curves", "learning curves of runs as a picture, with a band over seeds"),
    "ablations": Command("research.training.ablations", "the effect of each choice of the training"),
    "fuzz": Command("research.fuzzing.run", "readers of other people's files, on mutated files"),
    "seal": Command("research.training.seal", "digests of the descriptions of older trained policies"),
    "sb3-block": Command(
        "research.training.sb3_block", "the README's block for SB3, run with several seeds and evaluated"
    ),
    "downloads": Command("research.pages.downloads", "deployment files of the shipped walks, and the table of them"),
    "publish": Command("research.training.publish", "finished runs evaluated, and that of seed 0 shipped"),
}
"""Name of a command -> module of the command, and its description in the list of commands."""
PROGRAM = Program("python -m research", COMMANDS)
main = PROGRAM.main

if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
