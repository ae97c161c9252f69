"""The launcher before the imports that take time."""

import subprocess
import sys

CODE = """
import signal
from quad_env.cli import launcher
signal.signal(signal.SIGINT, signal.default_int_handler)  # deaf where the tests are a background job
launcher.leave_on_interrupt()
{}
try:
    signal.raise_signal(signal.SIGINT)
    for _ in range(1000):
        pass
except KeyboardInterrupt:
    print("caught")
"""


def test_it_leaves_at_once_until_the_program_can_be_interrupted() -> None:
    for then, code, said in (("", 130, ""), ("launcher.raise_on_interrupt()", 0, "caught\n")):
        command = [sys.executable, "-c", CODE.format(then)]
        finished = subprocess.run(command, capture_output=True, text=True, check=False)
        assert (finished.returncode, finished.stdout) == (code, said)
