"""The results in README and docs: `python -m research readme RESULTS_JSON` writes them in their places.

The README gets a short table, `docs/results.md` every figure.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from evaluate.analysis.results import with_nan
from evaluate.analysis.score import Score
from evaluate.commands.options import command
from evaluate.commands.plan import limited
from evaluate.measures.outcomes import SUCCESS_1, SUCCESS_RULE
from evaluate.report.places import insert
from evaluate.report.plots import drawing, success
from evaluate.report.results_page import every_figure, legend, newcomers_table, robots_table, scenarios_of
from evaluate.rollouts.battery import BATTERIES, resolve
from quad_env.cli.command_line import UsageError
from quad_env.files.reading import parse_json, read_bytes
from quad_env.files.writing import write_atomically

MORE, ROBOTS = "more", "robots"
"""Names of the page's second place, and of the README's."""
ALT = "Share of the episodes that succeed, of each policy on each axis at its severities, in per cent"
"""Words for the picture."""


@dataclass(frozen=True)
class Options:
    """Write the results into the README and its page of results."""

    results: Annotated[Path, tyro.conf.Positional] = Path("results/evaluation/results.json")
    """results.json of an evaluation."""
    readme: Path | None = Path("README.md")
    """File with the lines `<!-- results -->` and `<!-- /results -->`, between which the short table goes; None for a
    page alone, such as docs/mpc_or_learning.md."""
    page: Path = Path("docs/results.md")
    """File with the same lines, between which every figure goes."""
    picture: Path | None = None
    """PNG of the success of every policy on every axis, which the README shows; success.png beside the page."""
    more: Path | None = None
    """results.json of an evaluation of further policies, for the page's place `<!-- more -->` … `<!-- /more -->`."""
    robots: tuple[Path, ...] = ()
    """results.json of evaluations of other robots, a row each, for the README's place `<!-- robots -->`."""


def main(options: Options) -> int:
    """Write the tables; the exit code."""
    if options.robots and options.readme is None:
        raise UsageError("--robots are for the README: name it with --readme")
    texts = {path: _text(path) for path in (options.readme, options.page) if path is not None}
    found = _read(options.results)
    shown, every = _lines(options.results, found)
    texts[options.page] = insert(texts[options.page], every)
    if options.more is not None:
        texts[options.page] = insert(texts[options.page], _lines(options.more, _read(options.more))[1], MORE)
    if options.readme is not None:
        about = [legend(found), ""] if legend(found) else []
        lines = [*about, *_pictured(shown, found, options, options.readme)]
        texts[options.readme] = insert(texts[options.readme], lines)
        if options.robots:
            others = [_complete(path) for path in options.robots]
            made_by = " ".join(map(_made_by, others))
            texts[options.readme] = insert(texts[options.readme], [*robots_table(others), "", made_by], ROBOTS)
    for path, text in texts.items():
        write_atomically(path, text.encode())
    return 0


def _text(path: Path) -> str:
    try:
        return read_bytes(path).decode()
    except UnicodeError as error:
        raise UsageError(f"{path} is no text ({error})") from error


def _pictured(shown: list[str], found: dict[str, Any], options: Options, readme: Path) -> list[str]:
    """The short table's lines with the picture, which is made, as far as there are scores to draw."""
    scores = [Score(**each) for each in found.get("scores", ())]
    if not scores:
        return shown
    picture = options.picture or options.page.with_name("success.png")
    where = Path(os.path.relpath(picture, readme.parent)).as_posix()
    with drawing.settings():
        write_atomically(picture, success.png(success.heat_map(scores)))
    return [shown[0], "", f"![{ALT}]({where})", *shown[1:]]


def _read(path: Path) -> dict[str, Any]:
    """A results.json with NaN for null; UsageError where there is none."""
    if not path.exists():
        raise UsageError(f"there is no {path}; `python -m evaluate --out {path.parent}` makes it")
    try:
        return dict(with_nan(parse_json(read_bytes(path))))
    except (AttributeError, TypeError, ValueError) as error:
        raise UsageError(f"{path} is not a results.json of `python -m evaluate` ({error!r})") from error


def _complete(path: Path) -> dict[str, Any]:
    """A results.json of a run that was not interrupted, with its scores; UsageError for another."""
    found = _read(path)
    _check_complete(path, found)
    if not found.get("scores"):
        raise UsageError(f"the evaluation of {path} has no scores: they need several axes of disturbance")
    return found


def _check_complete(path: Path, found: dict[str, Any]) -> None:
    if not found["complete"]:
        raise UsageError(f"the evaluation of {path} was interrupted: carry it on with --resume")


def _lines(path: Path, found: dict[str, Any]) -> tuple[list[str], list[str]]:
    """The short table and every figure of a results.json; UsageError where it is none, or of an interrupted run."""
    try:
        _check_complete(path, found)
        made_by = ["", _made_by(found)]
        return [*newcomers_table(found), *made_by], [*every_figure(found), *made_by]
    except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
        raise UsageError(f"{path} is not a results.json of `python -m evaluate` ({error!r})") from error


def _made_by(found: dict[str, Any]) -> str:
    """The command that makes these figures, without what is as usual, and with which versions."""
    provenance, versions, scenarios = found.get("provenance", {}), found["versions"], scenarios_of(found)
    battery = next((name for name in BATTERIES if [one.name for one in resolve((name,))] == scenarios), None)
    chosen = {
        "policies": list(limited(found["policies"], provenance.get("only_on", {}))),
        "scenarios": [battery] if battery else scenarios,
        "episodes": found["episodes"],
        "seed": found["seed"],
    }
    words = command(chosen | provenance.get("hardware", {}))
    rule = versions.get("success_rule") or SUCCESS_1
    older = "" if rule == SUCCESS_RULE else f"; success by the older rule {rule}"
    return f"`{words}`; MuJoCo {versions['mujoco']}, Python {versions['python']}{older}."
