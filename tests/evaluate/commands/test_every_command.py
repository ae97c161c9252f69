"""What every command of `python -m evaluate` does alike: --help, a mistake, Ctrl-C."""

import re
from importlib import import_module

import pytest

from evaluate.__main__ import COMMANDS, main

NEEDED = {
    "replay": ["folder", "0"],
    "compare": ["folder", "folder"],
    "rescore": ["folder"],
}
"""What a command cannot be called without."""
EVERY = pytest.mark.parametrize("name", COMMANDS)


@EVERY
def test_help_explains_every_option_with_its_default(capsys, name) -> None:
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert not end.value.code
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: python -m evaluate {name} ")
    plain = re.sub("[│╭╮╰╯─]", " ", printed)
    for option in re.split(r"\n +(?=--[a-z])", plain)[1:]:
        words = " ".join(option.split())
        assert re.search(r"^--[a-z, -]+ .+ [a-z].+\(default: ", words), words


@EVERY
def test_an_unknown_option_is_one_line(capsys, name) -> None:
    assert main([name, *NEEDED.get(name, []), "--nonsense"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == f"error: Unrecognized options: --nonsense; see `python -m evaluate {name} --help`\n"


@EVERY
def test_ctrl_c_is_one_line(capsys, monkeypatch, name) -> None:
    def interrupted(_options) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(import_module(COMMANDS[name].module), "main", interrupted)
    assert main([name, *NEEDED.get(name, [])]) == 130
    assert capsys.readouterr().err == "interrupted: no further file was written\n"


def test_the_programs_help_lists_every_command(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    printed = capsys.readouterr().out
    for name, command in COMMANDS.items():
        assert re.search(rf"^  {name} +{re.escape(command.summary)}$", printed, re.MULTILINE)
        assert len(command.summary) <= 64  # a line of 80 columns holds it
