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


READERS = pytest.mark.parametrize(
    "arguments", [["report"], ["replay", "0"], ["compare", "{}"], ["rescore"]], ids=" ".join
)


@READERS
@pytest.mark.parametrize(
    ("folder", "said"),
    [
        ("nowhere", "there is no folder {}; name one that `python -m evaluate` wrote, such as results/evaluation"),
        ("empty", "{} holds no results of `python -m evaluate`: it has no manifest.json"),
        ("thesis.tex", "{} is a file; name the folder of an evaluation"),
    ],
)
def test_a_folder_without_results_is_one_line_that_says_what_to_name(capsys, tmp_path, arguments, folder, said) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "thesis.tex").write_text("", encoding="utf-8")
    name, *more = (word.format(tmp_path / folder) for word in arguments)
    assert main([name, str(tmp_path / folder), *more]) == 2
    assert capsys.readouterr() == ("", f"error: {said.format(tmp_path / folder)}\n")


def test_a_readme_table_of_no_results_says_how_to_make_them(capsys, tmp_path) -> None:
    files = ["--readme", str(tmp_path / "README.md"), "--page", str(tmp_path / "README.md")]
    (tmp_path / "README.md").write_text("", encoding="utf-8")
    assert main(["readme", str(tmp_path / "results.json"), *files]) == 2
    assert capsys.readouterr().err == (
        f"error: there is no {tmp_path / 'results.json'}; `python -m evaluate --out {tmp_path}` makes it\n"
    )


@pytest.mark.parametrize("words", [["trot", "stand", "--scenarios", "flat", "--out", "{}"], ["report", "{}"]])
def test_a_baseline_that_takes_no_part_is_refused(capsys, tmp_path, run, words) -> None:
    folder = run.folder if words[0] == "report" else tmp_path
    assert main([*(word.format(folder) for word in words), "--baseline", "gallop"]) == 2
    assert "--baseline: gallop is not among the policies" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["jump", "--robots", "100000000000"], "--robots must be from 1 to 65536, not 100000000000"),
        (["jump", "--seed", "-1"], "--seed must be from 0 to"),
        (["recovery", "--robots", "100000000000"], "--robots must be from 1 to 1000000"),
        (["safety", "--episodes", "0"], "--episodes must be from 1 to"),
        (["safety", "--hours", "nan"], "--hours must be from 0.001 to 1000.0, not nan"),
        (["safety", "--policy", "gallop"], "no policy 'gallop': name one of"),
        (["calibration", "--seed", "-1"], "--seed must be from 0 to"),
        (["calibration", "--sets", "100000000000"], "--sets must be from 2 to"),
        (["calibration", "--episodes"], "--episodes and --fall-probabilities must each have at least one value"),
        (["calibration", "--fall-probabilities", "0.5", "nan"], "--fall-probabilities must be from 0.001 to 0.999"),
        (["gait-diagram", "--command", "nan", "0", "0"], "--command must be from -10.0 to 10.0, not (nan, 0.0, 0.0)"),
        (["trot@", "--out", "out"], "--policies: name scenarios after the @ of trot@, as in document@flat"),
        (["compare", "a", "b", "--json", "."], "--json: . is a folder; name a file"),
        (["gait-diagram", "--out", "file/gait.png"], "--out: cannot write to the folder file ("),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_values_that_nothing_can_be_done_with_are_one_line(capsys, tmp_path, monkeypatch, words, said) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert main(words) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    assert printed.err.startswith(f"error: {said}")
