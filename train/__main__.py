"""Entry point of `python -m train`; the commands are in `train.commands.run`."""

import sys
from pathlib import Path

if __name__ == "__main__":  # because a file `evaluate.py` of the user must not hide the package `evaluate`
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from quad_env.cli import launcher

if __name__ == "__main__":  # here because Ctrl-C must also work during the slow imports below
    launcher.leave_on_interrupt()

from train.commands.run import COMMANDS, PROGRAM

__all__ = ["COMMANDS", "PROGRAM", "main"]
main = PROGRAM.main

if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
