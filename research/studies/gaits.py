"""Measured gaits: `python -m research gaits` draws a steady walk of each controller into the pages.

A page names walks in the lines `<!-- gaits ROBOT POLICY… -->` and `<!-- /gaits -->`. Between these lines, the command
writes a table of gait and effort measures, a film of 2 s of each walk, and a picture. The picture shows the times at
which each foot is on the ground (gait diagram) above frames of one stride (M. Hildebrand, Symmetrical gaits of horses,
Science, 1965). A policy walks on the scenario `steady`; `POLICY@SCENARIO` selects another scenario.
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
from evaluate.measures.episodes import Episodes
from evaluate.measures.footfalls import MIN_SWING_TIME, debounce
from evaluate.measures.metrics import measure
from evaluate.report.headings import EFFORT_TITLES, ROW_LABEL, format_effort
from evaluate.report.plots import drawing
from evaluate.rollouts import rollout
from policies.base import CONTROL_PERIOD
from quad_env.cli.child_process import available_cores
from quad_env.cli.command_line import UsageError
from quad_env.cli.format import number
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.scenarios.registry import STEADY, scenario
from quad_env.seeding import episode_seeds
from research.pages.blocks import read_page
from research.pages.markdown import table
from research.studies.failure_films import stack_images

FILM_STEPS = range(400, 600, 2)
"""Control steps of 10 ms, counted from 0, after which frames of a walk are rendered.

The gait diagram shows the same time.
"""
FRAME_STRIDE = 3
"""Number of rendered frames from one frame of the film to the next; the frames between are left out."""
FRAMES = 8
"""Number of frames that show one stride in the picture of a walk."""
SIZE = (400, 300)
"""Width and height of a rendered frame before the frame is cropped and reduced, pixels."""
SKY = 50
"""Height of the sky, which is cut off at the top of a rendered frame, pixels."""
SAMPLES = 2
"""Divisor that reduces width and height of a rendered frame for the README's film of several walks."""
SMALL = (160, 100)
"""Width and height of a frame in the picture and the film of a single walk, pixels."""
QUALITY = 20
"""Quality of the WebP encoding of the films, from 0 to 100; a larger value gives larger files."""
LETTERS = 13
"""Font size of the names of robot and policy in the README's film of several walks, pixels."""
README_FILM_POLICIES = (
    *product(("simple_quad",), ("trot_feedback", "mpc_wbc", "residual", "robust")),
    *product(("go1", "go2"), ("trot_feedback", "mpc_wbc")),
)
"""Name of the robot and name of the policy of each walk in the film of the README.

The film is written only if the pages name all of these walks.
"""
COLUMNS = 4
"""Number of walks side by side in the README's film of several walks."""
FIGURES = "step_rate", "duty_factor", "flight", "trunk_height", "cost_of_transport"
"""Names of the gait and effort measures in the tables that the command `gaits` writes into pages."""
Key = tuple[str, str]
"""Type of the key of a walk: (name of the robot, name of the policy), as a page names the walk.

The name of the policy is POLICY or POLICY@SCENARIO.
"""
PLACE = re.compile(r"(?<=<!-- gaits )(\S+) (.+?)( -->\n).*?(?=<!-- /gaits -->)", re.DOTALL)
"""Regular expression for the text between `<!-- gaits` and `<!-- /gaits -->` in a page.

The groups of a match are the name of the robot, the names of the policies, and the end of the first line.
"""


@dataclass(frozen=True)
class GaitsOptions:
    """Options of the command `gaits`, which draws steady walks of controllers for pages."""

    pages: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Markdown files with lines `<!-- gaits ROBOT POLICY… -->`; by default all pages in docs and models."""
    out: Path = Path("docs/gaits")
    """Folder for the pictures; the README's film walking.webp is written next to this folder."""


def main(options: GaitsOptions) -> int:
    """Run the command `gaits`: draw the walks that the pages name, and write pictures and pages.

    A missing page, robot, policy or scenario raises UsageError, PolicyError or OSError before the first walk is drawn.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: No page has a line `<!-- gaits ROBOT POLICY… -->`.
    """
    pages = options.pages or sorted((*Path("docs").glob("*.md"), *Path("models").rglob("*.md")))
    texts = {page: text for page in pages if PLACE.search(text := read_page(page))}
    blocks = [block for text in texts.values() for block in PLACE.findall(text)]
    keys = sorted({(robot, name) for robot, names, _ in blocks for name in names.split()})
    if not keys:
        raise UsageError(f"no place for gaits in {' '.join(map(str, pages))}")
    walks = {key: _walk(*key) for key in keys}
    make_writable_folder(options.out)
    figures, films = _draw_walks(walks, options.out)
    if films.keys() >= set(README_FILM_POLICIES):
        frames = zip(*(films[key] for key in README_FILM_POLICIES), strict=True)
        film = _film([tile_images(images, COLUMNS) for images in frames])
        write_atomically(options.out.with_name("walking.webp"), film)
    for page, text in texts.items():
        folder = Path(os.path.relpath(options.out, page.parent)).as_posix()
        write_atomically(page, PLACE.sub(partial(_filled, walks, figures, folder), text).encode())
    return 0


def _draw_walks(
    walks: Mapping[Key, FilmSpec], folder: Path
) -> tuple[dict[Key, dict[str, str]], dict[Key, list[Image.Image]]]:
    """Simulate and draw all walks in parallel processes.

    Args:
        walks: Names of robot and policy -> specification of the walk.
        folder: Folder for the pictures.

    Returns:
        figures: Names of robot and policy -> gait and effort measures of the walk, each name of a column -> text.
        films: Names of robot and policy -> images of the walk for the README's film of several walks.
    """
    with ProcessPoolExecutor(available_cores(), get_context("spawn")) as pool:
        results = pool.map(draw_walk, walks.values(), repeat(folder))
        drawn_walks = list(track(results, "walking", len(walks), console=Console(stderr=True)))
    figures = {key: figures for key, (figures, _) in zip(walks, drawn_walks, strict=True)}
    films = {key: images for key, (_, images) in zip(walks, drawn_walks, strict=True)}
    return figures, films


def _walk(robot: str, name: str) -> FilmSpec:
    """Create the specification of a walk; raise UsageError or PolicyError if a name is unknown.

    Args:
        robot: Name of the robot.
        name: POLICY for a walk on the scenario `steady`, or POLICY@SCENARIO.

    Returns:
        Specification of the walk: policy, scenario, seed and duration.

    Raises:
        UsageError: The robot or the scenario is unknown.
    """
    hardware = parse_robot_option(robot, "a place for gaits")
    policy, _, scenario_name = name.partition("@")
    try:
        walk_scenario = scenario(scenario_name or STEADY, hardware.robot_model)
    except ValueError as error:
        raise UsageError(f"a place for gaits: {error}") from error
    (seed,) = episode_seeds("validation", 0, 1).tolist()
    return FilmSpec(
        policies=(load_labelled_policy(policy, hardware, [walk_scenario]),),
        scenario=walk_scenario,
        seed=seed,
        steps=rollout.STEPS,
        title=re.sub(r"[^\w.-]+", "_", f"{robot}_{name}"),
        hardware=hardware,
    )


def draw_walk(walk: FilmSpec, folder: Path) -> tuple[dict[str, str], list[Image.Image]]:
    """Simulate and draw a walk, and write the picture NAME.webp and the film NAME_film.webp.

    If the robot falls, the last frame is repeated in the film.

    Args:
        walk: Specification of the walk.
        folder: Folder for the picture and the film.

    Returns:
        figures: Gait and effort measures of the whole walk: name of the column -> text.
        images: Images of the walk for the README's film of several walks.
    """
    images, episodes = _render_walk(walk)
    film = images[::FRAME_STRIDE]
    write_atomically(folder / f"{walk.title}_film.webp", _film([image.resize(SMALL) for image in film]))
    write_atomically(folder / f"{walk.title}.webp", _still(images, episodes))
    large_images = [image.reduce(SAMPLES) for image in film]
    for image in large_images:
        Text(LETTERS, edge=1).write(image, f"{walk.hardware.robot}, {walk.policies[0].label}", -1)
    measures = measure(episodes)
    figures = {name: format_effort(name, float(getattr(measures, name)[0].mean())) for name in FIGURES}
    speed = number(float(measures.mean_velocities[0, :, 0].mean()), 2)
    return figures | {"speed": speed}, large_images


def _render_walk(walk: FilmSpec) -> tuple[list[Image.Image], Episodes]:
    """Simulate a walk, and render a frame after each control step in FILM_STEPS.

    Args:
        walk: Specification of the walk.

    Returns:
        images: Rendered frames.
        episodes: Record of the simulated episode.
    """
    (policy,) = walk.policies
    with closing(EpisodeView(policy, walk, RenderOptions(SIZE, camera=None))) as view:
        images = [_frame(view) for step in view if step.number - 1 in FILM_STEPS]
        images += [_frame(view)] * (len(FILM_STEPS) - len(images))
        return images, view.recorder.episodes()


def _still(images: Sequence[Image.Image], episodes: Episodes) -> bytes:
    """Draw the picture of a walk: the gait diagram above the frames of one stride.

    Args:
        images: Rendered frames of the walk.
        episodes: Record of the simulated episode.

    Returns:
        Picture encoded as WebP.
    """
    is_upright = np.arange(FILM_STEPS.start, FILM_STEPS.stop) < episodes.fall_step[0]
    contact = episodes.foot_contact[FILM_STEPS.start : FILM_STEPS.stop, 0] & is_upright[:, None]
    times = np.linspace(*find_stride(contact), FRAMES, endpoint=False)
    chosen = (times / FILM_STEPS.step).round().astype(int).tolist()
    strip = tile_images([images[index].resize(SMALL) for index in chosen], FRAMES)
    diagram = draw_gait_diagram(contact, chosen, episodes.robot.leg_names, strip.width)
    buffer = io.BytesIO()
    stack_images(diagram, strip).save(buffer, "webp", quality=75, method=6)
    return buffer.getvalue()


def _frame(view: EpisodeView) -> Image.Image:
    """Render the robot after the latest control step, and cut off the sky at the top of the frame."""
    return view.picture().crop((0, SKY, *SIZE))


def _film(images: Sequence[Image.Image]) -> bytes:
    """Encode frames of a film as an animated WebP image that plays in real time."""
    return encode_animation(images, "webp", FRAME_STRIDE * FILM_STEPS.step * CONTROL_PERIOD, quality=QUALITY)


def find_stride(contact: NDArray[np.bool_]) -> tuple[int, int]:
    """Find one stride in a walk: the time between two successive touch-downs of the same foot.

    Args:
        contact: True for feet in contact, (steps, feet).

    Returns:
        Start and end of the stride, indices of control steps in `contact`. The first foot that has two touch-downs is
        used. If there is no foot with two touch-downs, the result is the whole range of `contact`.
    """
    stance = debounce(contact, round(MIN_SWING_TIME / CONTROL_PERIOD))
    for foot_stance in stance.T:
        touchdowns = np.flatnonzero(np.diff(foot_stance.astype(int)) == 1) + 1
        if len(touchdowns) > 1:
            return int(touchdowns[0]), int(touchdowns[1])
    return 0, len(contact)


def draw_gait_diagram(
    contact: NDArray[np.bool_], chosen: Sequence[int], legs: Sequence[str], width: int
) -> Image.Image:
    """Draw the gait diagram of a walk: one row per foot, which is filled while the foot is in contact.

    Args:
        contact: True for feet in contact, (steps, feet).
        chosen: Indices into FILM_STEPS of the frames below the diagram; their times are marked by triangles.
        legs: Names of the legs, in the order of the feet.
        width: Width of the image, pixels.

    Returns:
        Image with the diagram over the time of FILM_STEPS.
    """
    times = np.array((FILM_STEPS.start, FILM_STEPS.stop)) * CONTROL_PERIOD
    bottom = len(legs) - 0.5
    marks = (FILM_STEPS.start + FILM_STEPS.step * np.array(chosen) + 0.5) * CONTROL_PERIOD
    buffer = io.BytesIO()
    with drawing.plot_settings():
        figure, axes = drawing.make_figure(1.5, width / 100, drawing.Margins(left=0.4, right=0.25))
        extent = (float(times[0]), float(times[1]), bottom, -0.5)
        axes.imshow(contact.T, "Blues", aspect="auto", interpolation="nearest", vmin=0.0, vmax=1.4, extent=extent)
        axes.hlines(np.arange(1, len(legs)) - 0.5, *times, color="white", linewidth=3)
        axes.plot(marks, np.full(len(marks), bottom), "k^", clip_on=False)
        axes.set_yticks(range(len(legs)), [name.upper() for name in legs])
        axes.set_xlabel("time, s; triangles: the frames below")
        figure.savefig(buffer, dpi=100)
    return Image.open(buffer).convert("RGB")


def _filled(
    walks: Mapping[Key, FilmSpec], figures: Mapping[Key, dict[str, str]], folder: str, block: re.Match[str]
) -> str:
    """Return the new text between `<!-- gaits` and `<!-- /gaits -->` in a page, with two tables.

    The first table has the measures of the walks; the second table has their films and pictures.

    Args:
        walks: Names of robot and policy -> specification of the walk.
        figures: Names of robot and policy -> measures of the walk, each name of a column -> text.
        folder: Path from the page to the folder of the pictures.
        block: Match of the pattern PLACE in the page.

    Returns:
        Text that replaces the match.
    """
    heads = {ROW_LABEL: "controller", "speed": "speed, m/s"}
    heads |= {name: ", ".join(filter(None, EFFORT_TITLES[name])) for name in FIGURES}
    pictures = {ROW_LABEL: "controller", "film": "2 s", "still": "feet on the ground in these 2 s; one stride"}
    robot, names, marker_end = block.groups()
    rows = [_picture_row(walks[robot, name], robot, name, folder) | figures[robot, name] for name in names.split()]
    made_by = f"One walk of 10 s each on a validation seed; `python -m research gaits`, MuJoCo {mujoco.__version__}."
    return f"{robot} {names}{marker_end}{table(heads, rows)}\n\n{table(pictures, rows)}\n\n{made_by}\n"


def _picture_row(walk: FilmSpec, robot: str, name: str, folder: str) -> dict[str, str]:
    """Return the row of a walk in the table of pictures.

    Args:
        walk: Specification of the walk.
        robot: Name of the robot.
        name: POLICY or POLICY@SCENARIO, as in the page.
        folder: Path from the page to the folder of the pictures.

    Returns:
        Name of the column -> Markdown.
    """
    scenario_note = "" if walk.scenario == STEADY else f" on `{walk.scenario.name}`"
    file = f"{folder}/{walk.title}"
    return {
        ROW_LABEL: f"`{walk.policies[0].label}`{scenario_note}",
        "film": f"![{robot}, {name}: film]({file}_film.webp)",
        "still": f"![{robot}, {name}: contacts]({file}.webp)",
    }
