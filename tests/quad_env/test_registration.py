"""The environment is in Gymnasium's registry in any order of imports; no other environment loads the package."""

import subprocess
import sys

import pytest

SLOW = "gymnasium", "mujoco", "numpy"
INTERRUPTED = """
import runpy, signal, sys

class Interrupt:
    def find_spec(self, name, path=None, target=None):
        if name in ("gymnasium", "mujoco", "numpy", "tyro"):
            print("loads", name, file=sys.stderr)
            signal.raise_signal(signal.SIGINT)

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # the tests may be a background job, which ignores it
    sys.meta_path.insert(0, Interrupt())
    sys.argv = sys.argv[1:]
    runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
"""


def python(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize(
    "code",
    [
        "import quad_env, gymnasium; gymnasium.make('SimpleQuad-v0')",
        "import gymnasium; gymnasium.make('quad_env:SimpleQuad-v0')",
        "import quad_env.envs.env, gymnasium, quad_env; gymnasium.make_vec('SimpleQuad-v0', num_envs=2)",
    ],
)
def test_it_is_registered_in_any_order_of_imports(code: str) -> None:
    assert python(code).stderr == ""


def test_its_import_loads_neither_gymnasium_nor_the_simulator() -> None:
    assert python(f"import sys, quad_env; print(set(sys.modules) & {set(SLOW)})").stdout == "set()\n"


@pytest.mark.parametrize("program", ["evaluate", "train"])
def test_help_waits_for_neither(program: str) -> None:
    command = [sys.executable, "-X", "importtime", "-m", program, "--help"]
    run = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    loaded = {line.rpartition("|")[2].strip() for line in run.stderr.splitlines()}
    assert "quad_env" in loaded
    assert not loaded & {"gymnasium", "mujoco", "torch"}


@pytest.mark.skipif(sys.platform == "win32", reason="sends a POSIX signal")
@pytest.mark.parametrize("words", ["evaluate trot", "quad_env view"])
def test_ctrl_c_while_a_command_loads_is_one_line(words: str) -> None:
    ended = python(INTERRUPTED, *words.split())
    loads, *lines = ended.stderr.splitlines()
    assert loads.startswith("loads ")
    assert (ended.returncode, lines) == (130, ["interrupted: no further file was written"])
