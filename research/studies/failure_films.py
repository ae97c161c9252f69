"""Strips of failed episodes for a person to judge: frames with marks, and time series below them."""

import io
from collections.abc import Iterator, Sequence
from contextlib import closing

import numpy as np
from PIL import Image

from evaluate.causes.record import EpisodeSignals
from evaluate.causes.verdict import worst_interval
from evaluate.cells import LabelledPolicy
from evaluate.film.captions import DARK, Text
from evaluate.film.curves import curves
from evaluate.film.files import tile_images
from evaluate.film.shooting import EpisodeView, FilmSpec, RenderOptions
from evaluate.measures.metrics import Measures
from policies.base import Policy
from quad_env.scenarios.axes import AXES

COUNT, COLUMNS, SIZE = 15, 5, (340, 270)
"""Frames of a strip and in a row of it, pixels of a frame."""
CURVES = {
    "foot_contact": "feet on the ground",
    "command": "command, m/s and rad/s",
    "heading_velocity": "forward, left, m/s, and yaw rate, rad/s",
    "tilt": "tilt, rad",
    "torque_share": "torque of each leg, share of its limit",
    "given": "tilt, velocity, yaw rate as given",
}
"""Signal below the frames -> title."""
LEAD_TIME = 0.6  # s before the onset of a fall
"""s. Time before the onset of a fall."""


def frame_range(record: EpisodeSignals, measures: Measures, earlier: float) -> slice:
    """Select the control steps of a strip.

    Args:
        record: Signals of the episode.
        measures: Its measures.
        earlier: Additional time before a fall, s, so that the start of the strip does not show its onset.

    Returns:
        The time around a fall, or the command interval with the worst tracking.
    """
    if not record.fell:
        return record.episodes.intervals.settled[worst_interval(measures, record.number)]
    return slice(max(0, record.onset - round((LEAD_TIME + earlier) / record.episodes.dt)), record.end + 1)


def draw_strip(policy: Policy, record: EpisodeSignals, part: slice) -> Image.Image:
    """Draw a part of an episode.

    Args:
        policy: Policy of the episode.
        record: Signals of the episode.
        part: Control steps.

    Returns:
        Frames with title and curves.
    """
    frames = tile_images(list(_frames(policy, record, part)), COLUMNS)
    return stack_images(_text(_title(record, part), frames.width, 20), frames, _curves(record, part, frames.width))


def stack_images(*images: Image.Image) -> Image.Image:
    """Arrange images of one width below each other."""
    out = Image.new("RGB", (images[0].width, sum(each.height for each in images)))
    for number, each in enumerate(images):
        out.paste(each, (0, sum(above.height for above in images[:number])))
    return out


def _text(lines: Sequence[str], width: int, size: int = 14) -> Image.Image:
    """Draw lines of text on a dark bar."""
    text = Text(size)
    out = Image.new("RGB", (width, text.height(len(lines))), DARK)
    for number, line in enumerate(lines):
        text.write(out, line, number)
    return out


def _title(record: EpisodeSignals, part: slice) -> tuple[str, str]:
    """Describe the scenario, and the end of the episode."""
    scenario, axis = record.scenario, AXES[record.scenario.axis]
    real = " Real motors, delays, sensors, and an estimator." if scenario.hardware else ""
    scene = f"{scenario.name}: {axis.sentence} The {axis.quantity} is {scenario.severity:g} {scenario.severity_unit}"
    fall = f"It falls at {part.stop * record.episodes.dt:.2f} s."
    return f"{scene}.{real}", fall if record.fell else "It stays upright, and does not follow its command."


def _frames(policy: Policy, record: EpisodeSignals, part: slice) -> Iterator[Image.Image]:
    """Render the robot at evenly spaced times, with captions."""
    shown = np.linspace(max(1, part.start), part.stop, COUNT).round().astype(int).tolist()
    seed = int(record.episodes.seeds[record.number])
    take = FilmSpec((filmed := LabelledPolicy(policy.name, policy),), record.scenario, seed, shown[-1], "")
    with closing(EpisodeView(filmed, take, RenderOptions(SIZE, camera=None))) as panel:
        for step in panel:
            if step.number in shown:
                fell, touches = record.fell and step.number > record.end, step.infos["leg_contact"][0]
                marks = {"FALL": fell, "PUSH": step.infos["push"].any(), "shin or thigh touches": touches}
                words = [f"{step.number * step.env.dt:.2f} s", *(mark for mark, seen in marks.items() if seen)]
                yield stack_images(panel.picture(), _text(["  ".join(words)], SIZE[0]))


def _curves(record: EpisodeSignals, part: slice, width: int) -> Image.Image:
    """Draw the signals over the time of a strip, from `evaluate.film.curves`."""
    from matplotlib.figure import Figure

    part, found = slice(part.start, min(part.stop, record.end)), curves(record.episodes, record.end)
    time, drawn = (np.arange(part.start, part.stop) + 1) * record.episodes.dt, io.BytesIO()
    figure = Figure(figsize=(width / 100, 2.4), dpi=100, layout="constrained")
    shown = [name for name in CURVES if name in found]
    for axes, name in zip(figure.subplots(1, len(shown)), shown, strict=True):
        axes.set_title(CURVES[name], fontsize=9)
        axes.plot(time, np.array(found[name], np.float64)[:, part].T)
    figure.savefig(drawn)
    return Image.open(drawn).convert("RGB")
