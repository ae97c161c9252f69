"""`python -m evaluate [POLICY ...]`: compare policies on the same episodes of every scenario.

Other commands, each with its own --help, as in `python -m evaluate axes --help`:
"""

import sys
from pathlib import Path

from evaluate.terminal import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    launcher.check_packages("evaluate")

from functools import partial
from typing import TYPE_CHECKING

from evaluate.commands.options import PROGRAM as NAME
from evaluate.commands.options import Options
from evaluate.terminal.command_line import parse
from evaluate.terminal.program import Command, Program

if TYPE_CHECKING:
    from evaluate.commands.plan import Plan

COMMANDS = {
    "report": Command("evaluate.commands.report", "table and files of a results folder again, nothing simulated"),
    "replay": Command("evaluate.commands.replay", "one episode of a results folder again, to the bit, or as a film"),
    "compare": Command("evaluate.commands.compare", "two results folders, such as those of two commits"),
    "axes": Command("evaluate.commands.axes", "falls of policies along the axes of disturbance, as curves"),
    "rescore": Command("evaluate.commands.rescore", "falls of a traced run under the rules of other projects"),
    "gaits": Command("evaluate.studies.gaits", "what the gaits, and changes between them, do on flat ground"),
    "gait-diagram": Command("evaluate.studies.gait_diagram", "when the feet stand, commanded and measured"),
    "recovery": Command("evaluate.studies.recovery", "getting up from any pose"),
    "jump": Command("evaluate.studies.jump", "how high standing robots jump, and how many land standing"),
    "safety": Command("evaluate.studies.safety", "falls that the safety layer averts, and its false alarms"),
    "ground": Command("evaluate.studies.ground", "whether success hangs on the very surfaces of random ground"),
    "estimation": Command("evaluate.studies.estimation", "errors of attitude and velocity as sensors tell them"),
    "straight-walking": Command("evaluate.studies.straight_walking", "speed, pushes, uneven ground and cost of a walk"),
    "prediction": Command("evaluate.studies.prediction", "what the predictive controllers foresee, and what happens"),
    "pictures": Command("evaluate.studies.pictures", "strips of frames and moving pictures of policies walking"),
    "calibration": Command("evaluate.statistics.calibration", "whether intervals and tests err as often as they say"),
    "readme": Command("evaluate.commands.readme", "the README's results table"),
}


def compare(words: list[str]) -> int:
    """Compare policies, which may stand at the beginning of the words; the exit code."""
    bare = bool(words) and not words[0].startswith("-")
    plan = _plan(["--policies", *words] if bare else words)
    from evaluate.commands.execution import execute  # only now, so that a mistake is answered at once

    return execute(plan)


def _plan(words: list[str]) -> "Plan":
    """What the words ask for; the defaults of --resume are the options of the run."""
    read = partial(parse, Options, words, program=NAME, description=f"{__doc__}{PROGRAM.listing()}")
    options = read()
    from evaluate.commands.plan import begun_with, check  # after --help, which is to be quick

    return check(read(default=begun_with(options.out)) if options.resume else options)


PROGRAM = Program(NAME, COMMANDS, compare)
main = PROGRAM.main

if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
