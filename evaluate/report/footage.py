"""The film of the report: which episode it shows, and how it gets into the page.

It is made by a program of its own, since a missing or broken OpenGL may end a whole process: `python -m
evaluate.report.footage FOLDER` reads pickled arguments of `film` from its input and writes 0.webp, 1.webp, ….
"""

import io
import os
import pickle
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from evaluate.analysis.results import Results
from evaluate.analysis.severity_levels import place
from evaluate.film.frames import frames_of
from evaluate.report.html import image, note, section
from evaluate.report.plots.drawing import cell_of
from evaluate.report.sections.figures import policy_label
from evaluate.rollouts.hardware import Hardware
from policies.base import CONTROL_PERIOD as DT
from quad_env.scenarios.named import Scenario
from quad_env.scenarios.terrain import Flat

WIDTH, HEIGHT = 240, 180
"""Pixels of a frame."""
STEPS_PER_FRAME = 8
"""Control steps: 12.5 frames a second."""
FRAMES = 50
"""4 s"""
QUALITY = 55
LIMIT = 300.0
"""s that filming may take"""
AFTERMATH = 1.5
"""s shown after the last fall"""
REPOSITORY = Path(__file__).resolve().parents[2]


class NoFilm(Exception):
    """Nothing can be filmed here; says why."""


@dataclass(frozen=True)
class Take:
    """The stretch of an episode that is shown."""

    scenario: Scenario
    episode: int
    seed: int
    first_step: int
    policies: tuple[str, ...]
    """Those that ran it."""


def footage(results: Results, trust: bool = False) -> str:
    """The section with the film, or with the reason why there is none; see `film` for `trust`."""
    take = choose(results)
    if take is None:
        return ""
    length = FRAMES * STEPS_PER_FRAME
    what = (
        f"Episode {take.episode} of {place(take.scenario)}, seed {take.seed}, "
        f"{take.first_step * DT:g} … {(take.first_step + length) * DT:g} s, in real time: the first "
        "on level ground that splits the policies most evenly into fallen and not, about the last fall."
    )
    try:
        strips = shoot(take, results.hardware, trust)
    except NoFilm as reason:
        return section("The same episode", note(f"No film: {reason}."))
    tiles = (
        f'<figure><div class="screen">{image(strip, f"{FRAMES} frames of {policy}", "webp")}</div>'
        f"<figcaption>{policy_label(results, policy)}</figcaption></figure>"
        for policy, strip in zip(take.policies, strips, strict=True)
    )
    timing = f"--frames: {FRAMES}; --length: {length * DT:g}s"
    switch = '<label class="pause"><input type="checkbox"> pause</label>'
    return section("The same episode", note(what), f'<div class="film" style="{timing}">{switch}{"".join(tiles)}</div>')


def choose(results: Results) -> Take | None:
    """The first episode that splits its policies most evenly, on level ground if any is; None where no two ran one."""
    scenarios = list({cell.scenario.name: cell.scenario for cell in results.cells}.values())
    level = [scenario for scenario in scenarios if isinstance(scenario.terrain, Flat)]
    takes = [take for scenario in level or scenarios if (take := _most_even(results, scenario))]
    return min(takes, key=lambda take: take[0])[1] if takes else None


def _most_even(results: Results, scenario: Scenario) -> tuple[int, Take] | None:
    """How far from even the scenario's most even episode is, and its stretch."""
    cells = [cell_of(results, scenario.name, policy) for policy in results.policies]
    there = [cell for cell in cells if cell is not None]
    if len(there) < min(2, len(cells)):
        return None
    fell = np.array([cell.measures.fell for cell in there])
    unevenness = np.abs(2 * fell.sum(axis=0) - len(there))
    episode = int(unevenness.argmin())
    times = [cell.measures.fall_time[episode] for cell in there if cell.measures.fell[episode]]
    end = min(max(times, default=2.0) + AFTERMATH, 10.0)
    first = max(0, round(end / DT) - FRAMES * STEPS_PER_FRAME)
    ran = tuple(cell.policy for cell in there)
    return int(unevenness[episode]), Take(scenario, episode, int(there[0].seeds[episode]), first, ran)


def shoot(take: Take, hardware: Hardware, trust: bool = False) -> list[bytes]:
    """The strips of frames of its policies; NoFilm says why there are none."""
    shots = [(name, take, hardware, trust) for name in take.policies]
    paths = os.pathsep.join(filter(None, (str(REPOSITORY), os.environ.get("PYTHONPATH"))))
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "evaluate.report.footage", folder]
        env = os.environ | {"PYTHONPATH": paths}
        try:
            done = subprocess.run(command, input=pickle.dumps(shots), capture_output=True, timeout=LIMIT, env=env)
        except (OSError, subprocess.TimeoutExpired, pickle.PicklingError) as error:
            raise NoFilm(str(error)) from error
        if done.returncode != 0:
            lines = done.stderr.decode(errors="replace").strip().splitlines()
            raise NoFilm(f"rendering is impossible here ({lines[-1] if lines else f'exit code {done.returncode}'})")
        return [(Path(folder) / f"{number}.webp").read_bytes() for number in range(len(shots))]


def film(policy: str, take: Take, hardware: Hardware, trust: bool = False) -> bytes:
    """The frames of one policy, one below the other, as WebP.

    `trust`: whether the policy may be loaded from a file in which code can be hidden.
    """
    frames = frames_of(
        hardware.policy(policy, trust),
        take.scenario,
        take.seed,
        first=take.first_step + 1,
        every=STEPS_PER_FRAME,
        count=FRAMES,
        size=(WIDTH, HEIGHT),
        hardware=hardware,
    )
    buffer = io.BytesIO()
    Image.fromarray(np.concatenate(frames)).save(buffer, "webp", quality=QUALITY, method=1)
    return buffer.getvalue()


if __name__ == "__main__":
    for number, shot in enumerate(pickle.load(sys.stdin.buffer)):
        Path(sys.argv[1], f"{number}.webp").write_bytes(film(*shot))
