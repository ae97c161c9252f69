"""Rules of causes against episodes made to fail, `python -m research causes`, and films of falls for a person to read.

With `--films FOLDER` strips of falls on validation seeds are drawn, and `readings.csv`, a form for what is seen; what
the rules say of them is written next to the folder, where a reader does not look.
"""

from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import policies
from evaluate.causes.record import THRESHOLDS, Record
from evaluate.causes.rules import CAUSES
from evaluate.causes.verdict import verdict
from evaluate.film.captions import Text
from evaluate.film.files import tiled
from evaluate.film.shooting import Filming
from evaluate.measures.episodes import Episodes
from evaluate.measures.metrics import measure
from evaluate.measures.outcomes import SUCCEEDED
from evaluate.rollouts import rollout
from quad_env.cli.command_line import check_numbers
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.seeding import episode_seeds
from research.pages.csv_text import csv_text
from research.pages.markdown import table
from research.pages.places import put
from research.studies.failures import CASES

POLICIES = "trot", "trot_feedback", "residual", "robust", "end_to_end"
SCENARIOS = (
    *("flat:5", "push:4", "push:6", "rough:4", "gravel:4", "stairs:3", "slope:5", "force:5", "slippery:5"),
    *("weak_motors:5", "payload:5", "latency:5", "noise:4", "dropout:6", "surprise:3"),
)
"""Whose falls, and where, are filmed."""
AROUND, EVERY, SIZE = (1.2, 0.3), 0.15, (320, 260)
"""s before and after a fall that are shown, s between frames, and pixels of a frame."""


@dataclass(frozen=True)
class Options:
    """Compare the rules of causes with episodes made to fail; or film falls for a person to read."""

    table: Path = Path("docs/results/causes.csv")
    """CSV file: episodes made for each cause, and the causes that the rules give them."""
    page: Path = Path("docs/causes.md")
    """Page with places for that table and the thresholds."""
    films: Path | None = None
    """Folder for strips of falls; nothing else is written then."""
    count: int = 30
    """Films (count)."""
    seed: int = 0
    """Which falls are chosen."""


def main(options: Options) -> int:
    """Run the command; the exit code. Raises UsageError."""
    check_numbers(options, {"count": (1, 999), "seed": (0, 2**31)})
    if options.films is not None:
        return film(options, options.films)
    rows = list(figures())
    write_atomically(options.table, csv_text(rows))
    heads = {name: name.replace("_", " ") for name in ("made_for", "episodes", "right", "certain", "certain_and_wrong")}
    put(options.page, [table(heads, [{name: str(row[name]) for name in heads} for row in rows])], "agreement")
    columns = ("threshold", "value", "unit", "reason")
    lines = (dict(zip(columns, map(str, (name, *of)), strict=True)) for name, of in THRESHOLDS.items())
    put(options.page, [table({name: name for name in columns}, lines)], "thresholds")
    return 0


def figures() -> Iterator[dict[str, Any]]:
    """A row a cause: episodes made for it, how many have it by the rules, certain ones, and all that they have."""
    for cause in CAUSES:
        given = Counter[tuple[str, bool]]()
        for case in (case for case in CASES if case.cause == cause):
            given.update((each["cause"], each["certain"]) for each in found(case.run()))
        by_cause = {each: given[each, True] + given[each, False] for each in CAUSES}
        sure = {each: given[each, True] for each in CAUSES}
        counts = {"episodes": given.total(), "right": by_cause[cause], "certain": sum(sure.values())}
        yield {"made_for": cause, **counts, "certain_and_wrong": sum(sure.values()) - sure[cause], **by_cause}


def found(episodes: Episodes, falls: bool = False) -> Iterator[dict[str, Any]]:
    """Seed, step of the fall, cause and certainty of each failed episode, or of each fall."""
    measures = measure(episodes)
    for number in np.flatnonzero(measures.fell if falls else measures.outcome != SUCCEEDED).tolist():
        assert episodes.scenario is not None
        of = verdict(Record(episodes, episodes.scenario, number), measures)
        what = {"cause": of.event.cause, "certain": of.certain, "detail": of.detail}
        yield {"seed": int(episodes.seeds[number]), "step": int(episodes.fall_step[number]), **what}


def film(options: Options, folder: Path) -> int:
    """Draw the films, one of each policy and scenario before a second one of any; the exit code."""
    make_writable_folder(folder)
    seeds, draw = episode_seeds("validation", options.seed, 4), np.random.default_rng(options.seed)
    falls: list[dict[str, Any]] = []
    for policy, scenario in product(POLICIES, SCENARIOS):
        record = rollout.run(policies.resolve(policy), scenario, seeds, nthread=2)
        of = [{"policy": policy, "scenario": scenario, **each} for each in found(record, True)]
        draw.shuffle(of)
        falls += [{**each, "again": again + draw.random()} for again, each in enumerate(of)]
    chosen = sorted(falls, key=lambda each: each["again"])[: options.count]
    key = [{"film": f"{number:02d}.png", **each} for number, each in enumerate(chosen)]
    for each in key:
        tiled(list(frames(each)), 6).save(folder / each["film"])
    form = [{"film": each["film"], "cause": "", "certain": "", "remark": ""} for each in key]
    write_atomically(folder / "readings.csv", csv_text(form))
    write_atomically(folder.with_name(f"{folder.name}_key.csv"), csv_text(key))
    return 0


def frames(fall: dict[str, Any]) -> Iterator[Image.Image]:
    """Frames about a fall with their times; a push that acted since the frame before is written on it."""
    policy = policies.resolve(fall["policy"])
    steps = rollout.watch(policy, fall["scenario"], fall["seed"], steps=fall["step"] + 200)
    pushed = False
    with closing(Filming(SIZE)) as filming, closing(steps):
        for step in steps:
            since, dt = step.number - fall["step"] - 1, step.env.dt
            pushed |= bool(step.infos["push"].any())
            if since > AROUND[1] / dt + 0.5 or step.infos["diverged"][0]:
                return
            if since >= -AROUND[0] / dt and since % round(EVERY / dt) == 0:
                image = Image.fromarray(filming.draw(step.env))
                Text(16, edge=1).write(image, f"{step.number * dt:.2f} s{'  PUSH' if pushed else ''}", 0)
                pushed = False
                yield image
