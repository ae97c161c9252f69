"""Entry point of `python -m train`; the commands are in `train.commands.run`."""

import sys
from pathlib import Path

# The folder of the project must come first in the import path.
# Otherwise a file `evaluate.py` in the user's folder would hide the package `evaluate` of the project.
if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from quad_env.cli import launcher

# This call precedes the slow imports below, so that Ctrl-C ends the process cleanly during the imports too.
if __name__ == "__main__":
    launcher.leave_on_interrupt()

from train.commands.run import COMMANDS, PROGRAM

__all__ = ["COMMANDS", "PROGRAM", "main"]
main = PROGRAM.main

if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
