"""Measured gaits: `python -m research gaits` draws a steady walk of each controller into the pages.

A page with the lines `<!-- gaits ROBOT POLICY… -->` and `<!-- /gaits -->` gets the figures of these policies of that
robot, a film of 2 s of each, and the contacts of its feet in that time above frames of one stride (M. Hildebrand,
Symmetrical gaits of horses, Science, 1965). `POLICY@SCENARIO` walks on another scenario than `steady`.
"""

import io
import os
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import product, repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import mujoco
import numpy as np
import tyro
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console
from rich.progress import track

from evaluate.cells import load_labelled_policy
from evaluate.film.captions import Text
from evaluate.film.files import encode_animation, tile_images
from evaluate.film.shooting import EpisodeView, FilmSpec, RenderOptions
from evaluate.hardware import parse_robot_option
from evaluate.measures.footfalls import MIN_SWING_TIME, debounce
from evaluate.measures.metrics import measure
from evaluate.report.headings import EFFORT_TITLES, ROW_LABEL, format_effort
from evaluate.report.plots import drawing
from evaluate.rollouts.rollout import STEPS
from policies.base import CONTROL_PERIOD
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import number
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.scenarios.registry import STEADY, scenario
from quad_env.seeding import episode_seeds
from research.pages.markdown import table
from research.pages.places import read_page
from research.studies.failure_films import stack_images

FILM_STEPS = range(400, 600, 2)
"""Control steps, counted from 0, after which frames are rendered; contacts are drawn from the first to the last."""
FRAME_STRIDE, FRAMES = 3, 8
"""One of so many is a frame of the film; frames of a stride."""
SIZE, SKY, SAMPLES, SMALL = (400, 300), 50, 2, (160, 100)
"""Pixels of a frame as it is drawn, those at its top that are cut off, how many become one, across and down, in the
picture of several walks, and size of a frame otherwise."""
QUALITY, LETTERS = 20, 13
"""Of films, out of 100, and size of the letters in the picture of several walks, pixels."""
README_FILM_POLICIES, COLUMNS = tuple(product(("simple_quad",), ("trot_feedback", "mpc_wbc", "residual", "robust"))), 4
README_FILM_POLICIES += tuple(product(("go1", "go2"), ("trot_feedback", "mpc_wbc")))
"""Walks of the README's picture, drawn where the pages have all of them, in rows of so many."""
FIGURES = "step_rate", "duty_factor", "flight", "trunk_height", "cost_of_transport"
"""Figures of the table."""
Key = tuple[str, str]
"""Robot and policy, as a page names them."""
PLACE = re.compile(r"(?<=<!-- gaits )(\S+) (.+?)( -->\n).*?(?=<!-- /gaits -->)", re.DOTALL)
"""Block for gaits in a page."""


@dataclass(frozen=True)
class GaitsOptions:
    """Record a steady walk of each controller, and draw it into the pages that name it."""

    pages: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Markdown files with such places; by default those of docs and models."""
    out: Path = Path("docs/gaits")
    """Folder of the pictures; next to it goes walking.webp, the README's."""


def main(options: GaitsOptions) -> int:
    """Record, draw, write, and return the exit code.

    Raises UsageError, PolicyError or OSError before anything is drawn.
    """
    pages = options.pages or sorted((*Path("docs").glob("*.md"), *Path("models").rglob("*.md")))
    texts = {page: text for page in pages if PLACE.search(text := read_page(page))}
    places = [place for text in texts.values() for place in PLACE.findall(text)]
    named = {(robot, name) for robot, names, _ in places for name in names.split()}
    if not named:
        raise UsageError(f"no place for gaits in {' '.join(map(str, pages))}")
    walks = {each: _walk(*each) for each in sorted(named)}
    make_writable_folder(options.out)
    with ProcessPoolExecutor(available_cores(), get_context("spawn")) as pool:
        drawn = pool.map(draw_walk, walks.values(), repeat(options.out))
        shown = list(track(drawn, "walking", len(walks), console=Console(stderr=True)))
    figures, films = (dict(zip(walks, each, strict=True)) for each in zip(*shown, strict=True))
    if films.keys() >= set(README_FILM_POLICIES):
        tiles = zip(*(films[each] for each in README_FILM_POLICIES), strict=True)
        write_atomically(options.out.with_name("walking.webp"), _film([tile_images(each, COLUMNS) for each in tiles]))
    for page, text in texts.items():
        folder = Path(os.path.relpath(options.out, page.parent)).as_posix()
        write_atomically(page, PLACE.sub(partial(_filled, walks, figures, folder), text).encode())
    return 0


def _walk(robot: str, name: str) -> FilmSpec:
    """Create the film of `POLICY` or `POLICY@SCENARIO` of a robot. Raises UsageError or PolicyError."""
    hardware, (policy, _, where) = parse_robot_option(robot, "a place for gaits"), name.partition("@")
    try:
        place = scenario(where or STEADY, hardware.robot_model)
    except ValueError as error:
        raise UsageError(f"a place for gaits: {error}") from error
    (seed,), called = episode_seeds("validation", 0, 1).tolist(), re.sub(r"[^\w.-]+", "_", f"{robot}_{name}")
    return FilmSpec((load_labelled_policy(policy, hardware, [place]),), place, seed, STEPS, called, hardware)


def draw_walk(walk: FilmSpec, folder: Path) -> tuple[dict[str, str], list[Image.Image]]:
    """Draw a walk, and write NAME.webp and NAME_film.webp.

    A robot that has fallen is shown as it lies.

    Args:
        walk: Policy and episode.
        folder: Folder of the pictures.

    Returns:
        Figures of the whole walk, as text by column, and the larger images of the film.
    """
    (policy,), images = walk.policies, list[Image.Image]()
    with closing(EpisodeView(policy, walk, RenderOptions(SIZE, camera=None))) as panel:
        images += [_frame(panel) for step in panel if step.number - 1 in FILM_STEPS]
        images += [_frame(panel)] * (len(FILM_STEPS) - len(images))
        episodes = panel.recorder.episodes()
    upright = np.arange(FILM_STEPS.start, FILM_STEPS.stop) < episodes.fall_step[0]
    contact = episodes.foot_contact[FILM_STEPS.start : FILM_STEPS.stop, 0] & upright[:, None]
    chosen = (np.linspace(*find_stride(contact), FRAMES, endpoint=False) / FILM_STEPS.step).round().astype(int).tolist()
    film, strip = images[::FRAME_STRIDE], tile_images([images[number].resize(SMALL) for number in chosen], FRAMES)
    write_atomically(folder / f"{walk.title}_film.webp", _film([image.resize(SMALL) for image in film]))
    above = draw_gait_diagram(contact, chosen, episodes.robot.leg_names, strip.width)
    stack_images(above, strip).save(still := io.BytesIO(), "webp", quality=75, method=6)
    write_atomically(folder / f"{walk.title}.webp", still.getvalue())
    found, larger = measure(episodes), [image.reduce(SAMPLES) for image in film]
    for image in larger:
        Text(LETTERS, edge=1).write(image, f"{walk.hardware.robot}, {policy.label}", -1)
    of = {name: format_effort(name, float(getattr(found, name)[0].mean())) for name in FIGURES}
    return of | {"speed": number(float(found.mean_velocities[0, :, 0].mean()), 2)}, larger


def _frame(panel: EpisodeView) -> Image.Image:
    """Render the robot, without the sky."""
    return panel.picture().crop((0, SKY, *SIZE))


def _film(images: Sequence[Image.Image]) -> bytes:
    """Encode the film."""
    return encode_animation(images, "webp", FRAME_STRIDE * FILM_STEPS.step * CONTROL_PERIOD, quality=QUALITY)


def find_stride(contact: NDArray[np.bool_]) -> tuple[int, int]:
    """Find two touch-downs of the first foot that has two, in contacts (steps, feet); else all steps."""
    stance = debounce(contact, round(MIN_SWING_TIME / CONTROL_PERIOD))
    landed = (np.flatnonzero(np.diff(of_foot.astype(int)) == 1) + 1 for of_foot in stance.T)
    return next(((int(steps[0]), int(steps[1])) for steps in landed if len(steps) > 1), (0, len(contact)))


def draw_gait_diagram(
    contact: NDArray[np.bool_], chosen: Sequence[int], legs: Sequence[str], width: int
) -> Image.Image:
    """Draw the gait diagram: a row per foot, filled while in contact, and marks at the frames.

    Args:
        contact: Contacts, (steps, feet).
        chosen: Indices of the frames in the film.
        legs: Names of the legs.
        width: Width, pixels.

    Returns:
        The image.
    """
    times, below, buffer = np.array((FILM_STEPS.start, FILM_STEPS.stop)) * CONTROL_PERIOD, len(legs) - 0.5, io.BytesIO()
    marks = (FILM_STEPS.start + FILM_STEPS.step * np.array(chosen) + 0.5) * CONTROL_PERIOD
    with drawing.plot_settings():
        drawn, axes = drawing.make_figure(1.5, width / 100, drawing.Margins(left=0.4, right=0.25))
        place = float(times[0]), float(times[1]), below, -0.5
        axes.imshow(contact.T, "Blues", aspect="auto", interpolation="nearest", vmin=0.0, vmax=1.4, extent=place)
        axes.hlines(np.arange(1, len(legs)) - 0.5, *times, color="white", linewidth=3)
        axes.plot(marks, np.full(len(marks), below), "k^", clip_on=False)
        axes.set_yticks(range(len(legs)), [name.upper() for name in legs])
        axes.set_xlabel("time, s; triangles: the frames below")
        drawn.savefig(buffer, dpi=100)
    return Image.open(buffer).convert("RGB")


def _filled(
    walks: Mapping[Key, FilmSpec], figures: Mapping[Key, dict[str, str]], folder: str, place: re.Match[str]
) -> str:
    """Return a block with its tables; `folder` is the path of the pictures from the page."""
    heads = {ROW_LABEL: "controller", "speed": "speed, m/s"}
    heads |= {name: ", ".join(filter(None, EFFORT_TITLES[name])) for name in FIGURES}
    pictures = {ROW_LABEL: "controller", "film": "2 s", "still": "feet on the ground in these 2 s; one stride"}
    rows = []
    for name in place[2].split():
        walk = walks[place[1], name]
        words = f"`{walk.policies[0].label}`{'' if walk.scenario == STEADY else f' on `{walk.scenario.name}`'}"
        file, alt = f"{folder}/{walk.title}", f"{place[1]}, {name}"
        cells = {"film": f"![{alt}: film]({file}_film.webp)", "still": f"![{alt}: contacts]({file}.webp)"}
        rows.append({ROW_LABEL: words} | cells | figures[place[1], name])
    made_by = f"One walk of 10 s each on a validation seed; `python -m research gaits`, MuJoCo {mujoco.__version__}."
    return f"{place[1]} {place[2]}{place[3]}{table(heads, rows)}\n\n{table(pictures, rows)}\n\n{made_by}\n"
