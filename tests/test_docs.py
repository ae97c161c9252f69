"""README and docs run and render: Python blocks unchanged, options of commands, and tables equal to the code.

A block that trains for minutes runs with fewer steps, see `shortened`.

The commands of the tutorial run in `test_tutorial.py`. Other blocks of commands take minutes to hours or install
packages, so that only their commands and options are checked. Blocks that are files of one folder, with a name in a
comment on their first line, run in that folder.
"""

import contextlib
import importlib
import io
import re
import shlex
import textwrap
from functools import cache
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from markdown_it import MarkdownIt

import policies
from live.commands import doctor
from quad_env import AXES, ENV_ID, SCENARIOS, SIMPLE_QUAD, DomainRandomisation
from quad_env.doctor.command import CHECKS
from quad_env.task.observations import observation_table

ROOT = Path(__file__).parents[1]
PATHS = sorted((ROOT / "docs").glob("*.md"))
PAGES = {
    str(path.relative_to(ROOT)): path.read_text(encoding="utf-8")
    for path in (*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "examples/README.md")), *PATHS)
}
LANGUAGES = {"bash", "python", "toml", "mermaid", "bibtex"}
EVERY_PAGE = pytest.mark.parametrize("page", PAGES)


def blocks(language: str, text: str) -> list[str]:
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```$", text, re.DOTALL | re.MULTILINE)
    return [textwrap.dedent(block) for _, block in found]


def file_name(block: str) -> str | None:
    """Return the file name of a block, from a comment on its first line."""
    named = re.match(r"# (\w+\.py)\n", block)
    return named[1] if named else None


def commands() -> list[str]:
    """Return every `python -m …` in a bash block or between back quotes; … stands for `python -m evaluate`."""
    lines = [line for text in PAGES.values() for block in blocks("bash", text) for line in block.splitlines()]
    inline = [code for text in PAGES.values() for code in re.findall(r"`((?:python -m|… (?=--|axes)) ?[^`]+)`", text)]
    parts = [part.partition(" #")[0].strip() for line in lines for part in line.split(" && ")] + inline
    found = [part.replace("…", "python -m evaluate") for part in parts]
    others = ("python -m venv", "python -m sphinx")  # the site is built in its own test
    return sorted({each for each in found if each.startswith("python -m ") and not each.startswith(others)})


def table(header: str, page: str) -> list[list[str]]:
    """Return the cells of the table under a header line, without back quotes, shape (rows, columns)."""
    lines = PAGES[page].split(f"{header}\n", 1)[1].split("\n\n")[0].splitlines()[1:]
    return [[cell.strip().strip("`") for cell in line.strip("|").split("|")] for line in lines]


@EVERY_PAGE
def test_every_fence_is_closed_and_swallows_no_heading_and_no_table(page: str) -> None:
    tokens = MarkdownIt("commonmark").enable("table").parse(PAGES[page])
    fences = [token for token in tokens if token.type == "fence"]
    assert {token.info for token in fences} <= LANGUAGES
    assert len(re.findall(r"^ *```", PAGES[page], re.MULTILINE)) == 2 * len(fences)
    inside = "\n".join(token.content for token in fences)
    assert not re.search(r"^(##+ |\|[-: |]+\|$)", inside, re.MULTILINE)
    headings = len(re.findall(r"^#+ ", PAGES[page], re.MULTILINE)) - len(re.findall(r"^#+ ", inside, re.MULTILINE))
    assert sum(token.type == "heading_open" for token in tokens) == headings
    rules = len(re.findall(r"^\|[-:|]+\|$", PAGES[page], re.MULTILINE))
    assert sum(token.type == "table_open" for token in tokens) == rules


@pytest.mark.parametrize(
    "block",
    [block for text in PAGES.values() for block in blocks("python", text) if not file_name(block)],
    ids=lambda block: block.strip().splitlines()[-1][:40],
)
def test_python_block_runs_as_it_stands(block: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if "stable_baselines3" in block:
        importlib.import_module("torch").set_num_threads(1)  # more threads make networks of this size slower
    exec(compile(shortened(block), "block", "exec"), {"__name__": "__main__"})


def shortened(block: str) -> str:
    """Return the block; a training of 100,000 steps or more ends after its first rollout and update.

    `python -m research sb3-block` runs this block in full; tests/research/test_sb3_block.py compares its record.
    """
    return re.sub(r"\.learn\([\d_]{6,}\)", ".learn(1)", block)


def named_by(package: str) -> list[str]:
    """Return the names of a package's commands."""
    return list(getattr(importlib.import_module(f"{package}.__main__"), "COMMANDS", {}))


@cache
def help_of(package: str, *rest: str) -> str:
    """Return the help of the command with the given words, without options."""
    main = importlib.import_module(package if "." in package else f"{package}.__main__").main
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
        assert main([*rest, "--help-all" if (package, *rest) == ("train",) else "--help"]) == 0
    return printed.getvalue()


@pytest.mark.parametrize("command", commands())
def test_command_and_its_options_exist(command: str) -> None:
    words = shlex.split(command)[2:]
    package = words[0]
    named = named_by(package.split(".")[0])
    called = next((name.split() for name in named if words[1 : 1 + len(name.split())] == name.split()), [])
    assert called or len(words) == 1 or words[1].startswith("-") or "/" in words[1], f"no command {words[1]}"
    options = {word.partition("=")[0] for word in words if word.startswith("--")}
    assert options <= set(re.findall(r"--[\w.-]+", help_of(package, *called)))


def test_every_subcommand_is_on_the_page_of_commands() -> None:
    text = PAGES["docs/commands.md"]
    for package in ("quad_env", "evaluate", "train"):
        for name in named_by(package):
            last = name.split()[-1]
            assert re.search(rf"`(python -m {package} )?({name}|{last})\b[^`]*`", text), f"{package} {name}"


def test_observation_table_is_the_observation() -> None:
    rows = table("| term | width | unit |", "docs/environment.md")
    assert rows == [[term.name, str(term.width), term.unit] for term in observation_table(SIMPLE_QUAD).terms]


def test_every_reading_of_a_batch_has_its_row_with_its_shape() -> None:
    rows = table("| reading | shape | what it is |", "docs/environment.md")
    shown = {name.strip(" `"): shape for names, shape, _ in rows for name in names.split(",")}
    plain, full = (gym.make_vec(ENV_ID, num_envs=5, readings=readings) for readings in (False, True))
    _, without = plain.reset(seed=0)
    _, infos = full.reset(seed=0)
    added = {name: np.shape(value) for name, value in infos.items() if name not in without and name[0] != "_"}
    assert shown == {name: str(shape).replace("5", "n") for name, shape in added.items()}


def test_every_policy_has_its_row_and_every_card_its_link() -> None:
    rows = table("| name | what it is |", "docs/policies.md")
    assert sorted(row[0] for row in rows) == sorted({*policies.names(), *policies.TRAINED})
    cards = {card.relative_to(ROOT).as_posix() for card in (ROOT / "models").rglob("MODEL.md")}
    linked = re.findall(r"\]\(\.\./(models/[^)]+)\)", PAGES["docs/policies.md"])
    assert cards <= set(linked)


def test_every_axis_has_its_row_with_its_levels_and_its_nominal_one_bold() -> None:
    rows = table("| axis | severity | levels, the nominal one bold |", "docs/environment.md")
    assert [row[0] for row in rows] == list(AXES)
    assert list(SCENARIOS) == [*AXES, "steady"]
    for (name, _, levels), axis in zip(rows, AXES.values(), strict=True):
        assert [float(level.strip("* ")) for level in levels.split(",")] == list(axis.levels), name
        (bold,) = re.findall(r"\*\*(.+?)\*\*", levels)
        assert float(bold) == axis.nominal


def test_every_figure_of_domain_randomisation_has_its_row_with_its_default() -> None:
    rows = table("| field of `quad_env.DomainRandomisation` | default | what is drawn |", "docs/environment.md")
    shown = {name.strip("`"): float(re.findall(r"[\d.]+", default)[-1]) for name, default, _ in rows}
    percent = {name.strip("`"): 0.01 if "%" in default else 1.0 for name, default, _ in rows}
    usual = {name: np.ravel(value)[-1] for name, value in vars(DomainRandomisation()).items()}
    assert {name: value * percent[name] for name, value in shown.items()} == pytest.approx(usual)


def test_checks_named_for_a_symptom_exist() -> None:
    rows = table("| symptom | possible cause | checks of `doctor` |", "docs/doctor.md")
    named = {name.strip(" `") for row in rows for name in row[2].split(",")}
    assert named <= {check.name for check in (*CHECKS, *doctor.CHECKS, *doctor.DESCRIPTION_CHECKS)}


@EVERY_PAGE
def test_named_modules_exist(page: str) -> None:
    named = re.findall(r"`((?:quad_env|policies|evaluate|train|live|tests|examples)/[\w/]*\.\w+)`", PAGES[page])
    assert [name for name in named if not (ROOT / name).exists()] == []


@EVERY_PAGE
def test_linked_files_exist(page: str) -> None:
    links = [target for target in re.findall(r"\]\(([^)#]+)\)", PAGES[page]) if "://" not in target]
    assert [target for target in links if not (ROOT / page).parent.joinpath(target).exists()] == []


def test_every_page_is_reached_from_the_readme() -> None:
    linked = {target for text in PAGES.values() for target in re.findall(r"\]\((?:docs/)?([\w-]+\.md)\)", text)}
    assert {Path(page).name for page in PAGES if page.startswith("docs/")} <= linked
