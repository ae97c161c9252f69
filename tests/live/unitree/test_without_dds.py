"""Without Cyclone DDS, the commands say in one line how to install it, and nothing else needs it."""

import subprocess
import sys
from collections.abc import Callable

import pytest

from quad_env.__main__ import main
from quad_env.cli.extras import install_command


@pytest.mark.parametrize("command", ["unitree", "drive"])
def test_a_missing_package_is_one_line(
    command: str, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    monkeypatch.setitem(sys.modules, "cyclonedds", None)
    monkeypatch.delitem(sys.modules, "live.unitree.dds", raising=False)
    # Submodules that an earlier test has imported would still be found.
    for module in [name for name in sys.modules if name.startswith("cyclonedds.")]:
        monkeypatch.setitem(sys.modules, module, None)
    said = refused(main, command, "--robot", "simple_quad")
    assert said == f"error: this needs cyclonedds, which is not installed: {install_command('unitree')}\n"


def test_the_modules_of_the_commands_do_not_import_the_package() -> None:
    code = "import sys, live.commands.unitree, live.commands.drive; print('cyclonedds' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
