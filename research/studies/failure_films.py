"""Strips of failed episodes for a person to judge: frames with marks, and time series below them."""

import io
from collections.abc import Iterator, Sequence
from contextlib import closing

import numpy as np
from PIL import Image

from evaluate.causes.record import Record
from evaluate.causes.verdict import worst_interval
from evaluate.film.captions import DARK, Text, motion
from evaluate.film.curves import curves
from evaluate.film.files import tiled
from evaluate.film.shooting import Look, Panel, Take
from evaluate.measures.averages import planar
from evaluate.measures.metrics import Measures
from evaluate.rollouts.experiment import LabelledPolicy
from evaluate.rollouts.observers import Step
from policies.base import Policy
from quad_env.scenarios.axes import AXES

COUNT, COLUMNS, SIZE, LINES = 15, 5, (340, 270), 5
"""Frames of a strip and in a row of it, pixels of a frame, and lines of text below it."""
BEFORE = 0.6
"""s before the onset of a fall."""
FALLS = {"trunk_contact": "the trunk touches the ground", "tilt": "tilt over 70°", "height": "the trunk is too low"}


def span(record: Record, measures: Measures, earlier: float) -> slice:
    """Control steps of a fall, so many s earlier than need be, for nobody is to see where it begins; or of the command
    interval that went worst."""
    if not record.fell:
        return record.episodes.intervals.settled[worst_interval(measures, record.number)]
    return slice(max(0, record.onset - round((BEFORE + earlier) / record.episodes.dt)), record.end + 1)


def strip(policy: Policy, record: Record, part: slice) -> Image.Image:
    """An episode over those control steps."""
    frames = tiled(list(_frames(policy, record, part)), COLUMNS)
    return _stacked(_text(_title(record, part), frames.width, 20), frames, _curves(record, part, frames.width))


def _stacked(*images: Image.Image) -> Image.Image:
    """Images of one width below each other."""
    out = Image.new("RGB", (images[0].width, sum(each.height for each in images)))
    for number, each in enumerate(images):
        out.paste(each, (0, sum(above.height for above in images[:number])))
    return out


def _text(lines: Sequence[str], width: int, size: int = 14) -> Image.Image:
    text = Text(size)
    out = Image.new("RGB", (width, text.height(len(lines))), DARK)
    for number, line in enumerate(lines):
        text.write(out, line, number)
    return out


def _title(record: Record, part: slice) -> tuple[str, str]:
    """The scenario in words, and how the episode ended."""
    scenario, seen = record.scenario, record.episodes
    axis, reason = AXES[scenario.axis], str(seen.fall_reason[record.number])
    real = " Real motors, delays, sensors, and an estimator." if scenario.hardware else ""
    scene = f"{scenario.name}: {axis.sentence} The {axis.quantity} is {scenario.severity:g} {scenario.severity_unit}"
    if record.fell:
        return f"{scene}.{real}", f"It falls at {part.stop * seen.dt:.2f} s: {FALLS.get(reason, reason)}."
    mean = motion(record.of("heading_velocity")[part].mean(axis=0))
    return f"{scene}.{real}", f"It stays upright, and does not follow its command. Mean of the time shown: {mean}."


def _frames(policy: Policy, record: Record, part: slice) -> Iterator[Image.Image]:
    """The robot at so many moments, with captions."""
    shown = np.linspace(max(1, part.start), part.stop, COUNT).round().astype(int).tolist()
    seed = int(record.episodes.seeds[record.number])
    take = Take((filmed := LabelledPolicy(policy.name, policy),), record.scenario, seed, shown[-1], "")
    with closing(Panel(filmed, take, Look(SIZE, camera=None))) as panel:
        for step in panel:
            if step.number in shown:
                yield _below(panel.picture(), step, record)


def _below(image: Image.Image, step: Step, record: Record) -> Image.Image:
    """The frame with its figures below."""
    infos, table = step.infos, step.env.observation_table.slices
    share = np.abs(infos["peak_torque"][0]) / record.episodes.torque_limit
    marks = {
        "FALL": record.fell and step.number > record.end,
        "PUSH": infos["push"].any(),
        "shin or thigh touches": infos["leg_contact"][0],
    }
    lines = [
        "  ".join([f"{step.number * step.env.dt:.2f} s", *(mark for mark, seen in marks.items() if seen)]),
        f"command {motion(infos['command'][0])}",
        f"moves {motion(infos['heading_velocity'][0])}",
        f"tilt {np.degrees(infos['tilt'][0]):.0f}°, torque {share.max():.0%}, {(share > 0.95).sum()} joints at limit",
    ]
    if not step.env.shows_truth:
        shown = step.observation[0].astype(np.float64)
        gravity, velocity = (shown[table[name]] for name in ("projected_gravity", "linear_velocity"))
        tilt = np.degrees(np.arctan2(planar(gravity), -gravity[2]))
        lines.append(f"policy is shown tilt {tilt:.0f}°, {velocity[0]:+.2f} m/s forward, {velocity[1]:+.2f} m/s left")
    return _stacked(image, _text([*lines, ""][:LINES], image.width))


def _curves(record: Record, part: slice, width: int) -> Image.Image:
    """Contacts, velocity, tilt and torques over the time of a strip."""
    from matplotlib.figure import Figure

    part, seen, legs = slice(part.start, min(part.stop, record.end)), record.episodes, record.episodes.robot.leg_names
    time, ends = (np.arange(part.start, part.stop) + 1) * seen.dt, (part.start * seen.dt, part.stop * seen.dt)
    signals = {name: np.array(columns)[:, part] for name, columns in curves(seen, record.end).items()}
    velocity, share = signals["heading_velocity"], 100.0 * np.sort(signals["torque_share"], axis=0)
    plots = {
        "velocity, m/s": {"forward": velocity[0], "left": velocity[1]},
        "tilt, °": {"true": np.degrees(signals["tilt"][0])},
        "torque, % of the limit": {"leg that needs most": share[-1], "leg that needs least": share[0]},
    }
    if "given" in signals:
        plots["velocity, m/s"]["forward, as shown to the policy"] = signals["given"][1]
        plots["tilt, °"]["as shown to the policy"] = np.degrees(signals["given"][0])
    drawn = Figure(figsize=(width / 100, 2.4), dpi=100, layout="constrained")
    first, *others = drawn.subplots(1, 1 + len(plots))
    ground = np.where(record.of("foot_contact")[part] > 0, planar(record.shank[1][part, :, -1]), np.nan).T
    look = {"vmin": -0.3, "vmax": 1.0, "aspect": "auto", "interpolation": "nearest"}
    first.imshow(ground, "YlOrRd", extent=(*ends, len(legs) - 0.5, -0.5), **look)
    first.set_yticks(range(len(legs)), [name.upper() for name in legs])
    first.set_title("feet on the ground (red: sliding)", fontsize=9)
    for axes, (title, lines) in zip(others, plots.items(), strict=True):
        for label, values in lines.items():
            axes.plot(time, values, label=label)
        axes.set_title(title, fontsize=9)
        axes.legend(fontsize=7)
    buffer = io.BytesIO()
    drawn.savefig(buffer)
    return Image.open(buffer).convert("RGB")
