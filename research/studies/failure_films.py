"""Strips of failed episodes: images from which a person judges the cause of the failure.

A strip has a title, frames of the episode, and plots of recorded signals below the frames.
"""

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

COUNT = 15
"""Number of frames in a strip, the image that shows a failed episode."""
COLUMNS = 5
"""Number of frames in each row of a strip, the image that shows a failed episode."""
SIZE = (340, 270)
"""Width and height of a frame in a strip (image that shows a failed episode), pixels."""
CURVES = {
    "foot_contact": "feet on the ground",
    "command": "command, m/s and rad/s",
    "heading_velocity": "forward, left, m/s, and yaw rate, rad/s",
    "tilt": "tilt, rad",
    "torque_share": "torque of each leg, share of its limit",
    "given": "tilt, velocity, yaw rate as given",
}
"""Name of a recorded signal -> title of the signal's plot below the frames."""
LEAD_TIME = 0.6
"""Minimum time that a strip (image of a failed episode) shows before the onset of the fall, s."""


def frame_range(record: EpisodeSignals, measures: Measures, earlier: float) -> slice:
    """Select the control steps of a failed episode that a strip (image of the episode) shows.

    Args:
        record: Signals of the failed episode.
        measures: Measures of the failed episode, for example its velocity errors.
        earlier: Additional time before a fall, s. The caller varies it, so that the length of the strip does not reveal
            the onset of the fall.

    Returns:
        Range of control steps that begins before the fall and ends with the fall. If there is no fall, the range is the
        interval of constant command in which the robot tracks the command worst.
    """
    if not record.fell:
        return record.episodes.intervals.settled[worst_interval(measures, record.number)]
    return slice(max(0, record.onset - round((LEAD_TIME + earlier) / record.episodes.dt)), record.end + 1)


def draw_strip(policy: Policy, record: EpisodeSignals, part: slice) -> Image.Image:
    """Simulate a failed episode again, and draw the strip of some of its control steps.

    Args:
        policy: Policy that controlled the robot in the episode.
        record: Signals of the failed episode.
        part: Control steps that the strip shows.

    Returns:
        Image with a title, the frames, and plots of the signals.
    """
    frames = tile_images(list(_frames(policy, record, part)), COLUMNS)
    return stack_images(_text(_title(record, part), frames.width, 20), frames, _curves(record, part, frames.width))


def stack_images(*images: Image.Image) -> Image.Image:
    """Stack images of equal width vertically, with the first image at the top."""
    stack = Image.new("RGB", (images[0].width, sum(image.height for image in images)))
    top = 0
    for image in images:
        stack.paste(image, (0, top))
        top += image.height
    return stack


def _text(lines: Sequence[str], width: int, size: int = 14) -> Image.Image:
    """Draw lines of text on a dark bar of the given width, pixels, with the font size `size`, pixels."""
    text = Text(size)
    bar = Image.new("RGB", (width, text.height(len(lines))), DARK)
    for index, line in enumerate(lines):
        text.write(bar, line, index)
    return bar


def _title(record: EpisodeSignals, part: slice) -> tuple[str, str]:
    """Return the title of a strip, the image that shows a failed episode.

    Args:
        record: Signals of the failed episode.
        part: Control steps that the strip shows.

    Returns:
        Two lines of text: description of the scenario, and description of the end of the episode.
    """
    scenario = record.scenario
    axis = AXES[scenario.axis]
    profile = " Real motors, delays, sensors, and an estimator." if scenario.hardware else ""
    scene = f"{scenario.name}: {axis.sentence} The {axis.quantity} is {scenario.severity:g} {scenario.severity_unit}"
    fall = f"It falls at {part.stop * record.episodes.dt:.2f} s."
    return f"{scene}.{profile}", fall if record.fell else "It stays upright, and does not follow its command."


def _frames(policy: Policy, record: EpisodeSignals, part: slice) -> Iterator[Image.Image]:
    """Simulate a failed episode again, and render the robot at COUNT evenly spaced times.

    Args:
        policy: Policy that controlled the robot in the episode.
        record: Signals of the failed episode.
        part: Control steps that the strip shows.

    Yields:
        Frames. The caption of a frame has the time, and words if the robot has fallen, is pushed, or touches the ground
        with a shin or thigh.
    """
    numbers = np.linspace(max(1, part.start), part.stop, COUNT).round().astype(int).tolist()
    seed = int(record.episodes.seeds[record.number])
    labelled_policy = LabelledPolicy(policy.name, policy)
    spec = FilmSpec((labelled_policy,), record.scenario, seed, numbers[-1], "")
    with closing(EpisodeView(labelled_policy, spec, RenderOptions(SIZE, camera=None))) as view:
        for step in view:
            if step.number in numbers:
                marks = {
                    "FALL": record.fell and step.number > record.end,
                    "PUSH": step.infos["push"].any(),
                    "shin or thigh touches": step.infos["leg_contact"][0],
                }
                words = [f"{step.number * step.env.dt:.2f} s", *(mark for mark, is_set in marks.items() if is_set)]
                yield stack_images(view.picture(), _text(["  ".join(words)], SIZE[0]))


def _curves(record: EpisodeSignals, part: slice, width: int) -> Image.Image:
    """Draw the plots of the signals over the time that the strip shows.

    Args:
        record: Signals of the failed episode.
        part: Control steps that the strip shows.
        width: Width of the image, pixels.

    Returns:
        Image with one plot per signal of CURVES, side by side.
    """
    from matplotlib.figure import Figure

    part = slice(part.start, min(part.stop, record.end))
    signals = curves(record.episodes, record.end)
    time = (np.arange(part.start, part.stop) + 1) * record.episodes.dt
    figure = Figure(figsize=(width / 100, 2.4), dpi=100, layout="constrained")
    names = [name for name in CURVES if name in signals]
    for axes, name in zip(figure.subplots(1, len(names)), names, strict=True):
        axes.set_title(CURVES[name], fontsize=9)
        axes.plot(time, np.array(signals[name], np.float64)[:, part].T)
    buffer = io.BytesIO()
    figure.savefig(buffer)
    return Image.open(buffer).convert("RGB")
