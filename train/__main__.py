"""`python -m train`: see `train.commands.run`."""

import sys
from pathlib import Path

if __name__ == "__main__":  # so that no `evaluate.py` of the user's is imported
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from quad_env.cli import launcher

if __name__ == "__main__":  # before the imports that take time
    launcher.leave_on_interrupt()

from train.commands.run import COMMANDS, PROGRAM

__all__ = ["COMMANDS", "PROGRAM", "main"]
main = PROGRAM.main

if __name__ == "__main__":
    raise SystemExit(launcher.launch(main))
