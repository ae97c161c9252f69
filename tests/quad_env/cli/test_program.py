"""A program with several commands: each command has its own words, and all report errors equally."""

import errno
import os
import subprocess
import sys
import types
from dataclasses import dataclass
from pathlib import Path

import pytest
from rich.console import Console

from policies.base import PolicyError
from quad_env.cli.command_line import UsageError, parse
from quad_env.cli.program import Command, Program


@dataclass(frozen=True)
class Options:
    """Options of the command."""

    count: int = 3
    """How many (count)."""
    share: float = 1.0
    """How much of it."""
    out: Path = Path("results")
    """Where."""


def otherwise(words: list[str]) -> int:
    raise UsageError(f"no policy {words[0]}")


COMMANDS = {"search": Command("made_up_command", "searches a trot"), "publish": Command("made_up_command", "ships")}
PROGRAM = Program("python -m thing", COMMANDS, otherwise, {"ablate": "now `python -m other ablate`"})


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch) -> types.ModuleType:
    """Return a module with the options above and a `main` chosen by the test."""
    module = types.ModuleType("made_up_command", "What it does.")
    module.Options = Options
    module.main = lambda options: print(options.count) or 0
    monkeypatch.setitem(sys.modules, "made_up_command", module)
    return module


@pytest.mark.usefixtures("command")
def test_a_command_is_called_by_its_word_and_gets_the_rest(capsys) -> None:
    assert PROGRAM.main(["search", "--count", "5"]) == 0
    assert capsys.readouterr().out == "5\n"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("publsh", "no policy publsh; did you mean the command publish?"),
        ("galloping", "no policy galloping"),
        ("publish --count ten", "--count: 'ten' is no whole number; see `python -m thing publish --help`"),
        ("publish --share 2,5", "--share: no number: '2,5'"),
        ("publish --out=", "empty"),
        ("publish --cuont", "--cuont; see `python -m thing publish --help`"),
        ("ablate --steps 3", "`python -m thing ablate` is now `python -m other ablate`"),
    ],
)
@pytest.mark.usefixtures("command")
def test_what_is_no_command_is_one_line(capsys, words, named) -> None:
    assert PROGRAM.main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    assert named in line


def test_a_program_of_commands_alone_lists_them(capsys) -> None:
    program = Program("python -m thing", COMMANDS)
    for words in ([], ["--help"]):
        assert program.main(words) == 0
        assert capsys.readouterr().out.endswith("  search   searches a trot\n  publish  ships\n")
    assert program.main(["gallop"]) == 2
    assert capsys.readouterr().err == "error: there is no command gallop; there are search, publish\n"


@pytest.mark.usefixtures("command")
def test_numbers_are_taken_as_they_are_written(command, capsys) -> None:
    command.main = lambda options: print(options) or 0
    assert PROGRAM.main(["publish", "--count", "-7", "--share", "1e-3"]) == 0
    assert "count=-7, share=0.001" in capsys.readouterr().out


def test_a_terminal_of_no_width_is_printed_on(command, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "000")
    command.main = lambda _: Console().print("what it found") or 0
    assert PROGRAM.main(["publish"]) == 0
    assert capsys.readouterr().out == "what it found\n"


@dataclass(frozen=True)
class OfSeveral:
    """Options of a command that takes several policies and one scenario."""

    policies: tuple[str, ...] = ()
    """Policies."""
    scenario: str = "flat"
    """Scenario."""


@dataclass(frozen=True)
class OfBoth(OfSeveral):
    """Options of a command that has both."""

    policy: str = "trot"
    """Policy."""


def test_policies_and_scenarios_are_named_alike_whether_a_command_takes_one_or_several() -> None:
    for words in (["--policy", "trot", "stand", "--scenarios", "push"], ["--scenarios=push", "--policy=trot", "stand"]):
        assert parse(OfSeveral, words, program="thing", description="") == OfSeveral(("trot", "stand"), "push")
    found = parse(OfBoth, ["--policy", "stand", "--policies", "trot"], program="thing", description="")
    assert (found.policy, found.policies) == ("stand", ("trot",))


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (UsageError("\x1b]0;title\x07\n\x1b[31mred\x9b0m"), 2, "error: ]0;title [31mred 0m"),
        (PolicyError("no such policy"), 2, "error: no such policy"),
        (PermissionError(errno.EACCES, "Permission denied", "a/b"), 2, "error: cannot use a/b (Permission denied)"),
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), 2, f"error: cannot go on ({os.strerror(errno.ENOSPC)})"),
        (KeyboardInterrupt(), 130, "interrupted: no further file was written"),
        (KeyboardInterrupt("kept 3 parts"), 130, "interrupted: kept 3 parts"),
    ],
)
def test_every_command_ends_alike(command, capsys, error, code, said) -> None:
    def fail(_: Options) -> int:
        raise error

    command.main = fail
    assert PROGRAM.main(["publish"]) == code
    assert capsys.readouterr().err == f"{said}\n"


@pytest.mark.parametrize("error", [ValueError("a bug"), BrokenPipeError(errno.EPIPE, "Broken")])
def test_what_is_no_mistake_of_the_users_is_not_hidden(command, error) -> None:
    def fail(_: Options) -> int:
        raise error

    command.main = fail
    with pytest.raises(type(error)):
        PROGRAM.main(["publish"])


def test_a_backend_that_mujoco_does_not_know_is_one_line(tmp_path: Path) -> None:
    chosen = {**os.environ, "MUJOCO_GL": "nonsense"}
    command = [sys.executable, "-m", "evaluate", "--quick"]
    run = subprocess.run(command, cwd=tmp_path, env=chosen, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr.startswith("error: MuJoCo cannot be loaded with MUJOCO_GL=nonsense")
    assert run.stderr.count("\n") == 1
