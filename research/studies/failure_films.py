"""Strips of failed episodes for a person to judge: frames with marks, and time series below them."""

import io
from collections.abc import Iterator, Sequence
from contextlib import closing

import numpy as np
from PIL import Image, ImageDraw

from evaluate.causes.record import Record
from evaluate.causes.verdict import worst_interval
from evaluate.film.captions import Text, motion
from evaluate.film.files import tiled
from evaluate.film.scene import PUSH, Scene, heading
from evaluate.measures.averages import Floats, planar
from evaluate.measures.metrics import Measures
from evaluate.rollouts import rollout
from evaluate.rollouts.observers import Step
from policies.base import Policy
from quad_env.physics.arrows import Arrow
from quad_env.physics.rendering import Camera, Viewpoint
from quad_env.scenarios.axes import AXES

COUNT, COLUMNS, SIZE, LINES = 15, 5, (340, 270), 5
"""Frames of a strip and in a row of it, pixels of a frame, and lines of text below it."""
VIEW, FIELD = (75.0, -28.0, 1.8), np.radians(35.0)
"""Camera to the right of the robot, from its heading: azimuth and elevation, degrees, distance, m; its field, rad."""
BEFORE, FOLLOWS, TRAIL = 0.6, 0.6, 6
"""s before the onset of a fall, tilt up to which the camera follows the heading, rad, and positions of a foot's way."""
GREEN, WHITE, BLACK, ORANGE, RED = (0, 190, 100), (255, 255, 255), (0, 0, 0), (255, 150, 0), (220, 0, 0)
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
    parts = _text(_title(record, part), frames.width, 20), frames, _curves(record, part, frames.width)
    out = Image.new("RGB", (frames.width, sum(each.height for each in parts)))
    for number, each in enumerate(parts):
        out.paste(each, (0, sum(above.height for above in parts[:number])))
    return out


def _text(lines: Sequence[str], width: int, size: int = 14) -> Image.Image:
    text = Text(size)
    band = text.band(width, len(lines))
    for number, line in enumerate(lines):
        text.write(band, line, number)
    return band


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
    steps = rollout.watch(policy, record.scenario, int(record.episodes.seeds[record.number]), steps=shown[-1])
    with closing(steps):
        scene = Scene(step := next(steps))
        with closing(Camera(step.env.simulation.model, *SIZE, camera=None)) as camera:
            ways, yaw = [step.infos["foot_position"][0]], heading(step)
            for step in steps:
                scene.advance(step)
                ways = [*ways[1 - TRAIL :], step.infos["foot_position"][0]]
                yaw = heading(step) if step.infos["tilt"][0] < FOLLOWS else yaw
                if step.number in shown:
                    arrows, trunk = scene.arrows(), step.infos["position"][0]
                    if (force := record.drawn.force) is not None:
                        end = trunk + 0.4 * np.array([*force / np.hypot(*force), 0.0])
                        arrows.append(Arrow(tuple(trunk), tuple(end), 0.02, PUSH))
                    yield _below(_marked(step, camera, arrows, yaw, ways), step, record)


def _marked(step: Step, camera: Camera, arrows: list[Arrow], yaw: float, ways: list[Floats]) -> Image.Image:
    """A frame with the trunk's front, the feet, and their ways over the last 0.05 s."""
    robot, simulation = step.env.robot, step.env.simulation
    trunk, azimuth = step.infos["position"][0], float(np.degrees(yaw)) + VIEW[0]
    view = Viewpoint(azimuth, *VIEW[1:], (*trunk[:2].tolist(), float(trunk[2]) - 0.1))
    image = Image.fromarray(camera.draw(simulation.snapshot(0), arrows=arrows, viewpoint=view))
    draw, rotation = ImageDraw.Draw(image), simulation.snapshot(0).xmat[1].reshape(3, 3)
    front = np.array([(1, 1, 1), (1, -1, 1), (1, -1, -1), (1, 1, -1), (1, 1, 1)]) * robot.trunk_size / 2
    draw.line(_pixels(trunk + front @ rotation.T, view), ORANGE, 3)
    for leg, name in enumerate(robot.leg_names):
        ground = step.infos["foot_contact"][0, leg]
        way = _pixels(np.array([each[leg] for each in ways]), view)
        x, y = way[-1]
        draw.line(way, RED if ground else WHITE, 3)
        draw.ellipse((x - 6, y - 6, x + 6, y + 6), GREEN if ground else WHITE, BLACK)
        draw.text((x + 8, y - 6), name.upper(), WHITE, font_size=12, stroke_width=2, stroke_fill=BLACK)
    return image


def _pixels(points: Floats, view: Viewpoint) -> list[tuple[float, float]]:
    """Where a free camera sees points in the world, (n, 3), m."""
    (cos, sin), (level, down) = ((np.cos(angle), np.sin(angle)) for angle in np.radians([view.azimuth, view.elevation]))
    ahead, right = np.array([level * cos, level * sin, down]), np.array([sin, -cos, 0.0])
    from_camera = points - (np.array(view.target) - view.distance * ahead)
    x, y, depth = (from_camera @ axis for axis in (right, np.cross(ahead, right), ahead))
    scale = SIZE[1] / 2 / np.tan(FIELD / 2) / depth
    return list(zip(SIZE[0] / 2 + scale * x, SIZE[1] / 2 + scale * y, strict=True))


def _below(image: Image.Image, step: Step, record: Record) -> Image.Image:
    """The frame with its figures below; framed in red once the robot has fallen."""
    infos, table = step.infos, step.env.observation_table.slices
    fallen = record.fell and step.number > record.end
    share = np.abs(infos["peak_torque"][0]) / record.episodes.torque_limit
    marks = {"FALL": fallen, "PUSH": infos["push"].any(), "shin or thigh touches": infos["leg_contact"][0]}
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
    text = _text([*lines, ""][:LINES], image.width)
    out = Image.new("RGB", (image.width, image.height + text.height))
    out.paste(image)
    out.paste(text, (0, image.height))
    if fallen:
        ImageDraw.Draw(out).rectangle((0, 0, out.width - 1, out.height - 1), outline=RED, width=5)
    return out


def _curves(record: Record, part: slice, width: int) -> Image.Image:
    """Contacts, velocity, tilt and torques over the time of a strip."""
    from matplotlib.figure import Figure

    part, seen, legs = slice(part.start, min(part.stop, record.end)), record.episodes, record.episodes.robot.leg_names
    time, ends = (np.arange(part.start, part.stop) + 1) * seen.dt, (part.start * seen.dt, part.stop * seen.dt)
    velocity, tilt = record.of("heading_velocity")[part], record.of("tilt")[part]
    share = np.sort(100.0 * record.of("peak_torque")[part] / seen.torque_limit)
    curves = {
        "velocity, m/s": {"forward": velocity[:, 0], "left": velocity[:, 1]},
        "tilt, °": {"true": np.degrees(tilt)},
        "torque, % of the limit": {"joint that needs most": share[:, -1], "fourth of them": share[:, -4]},
    }
    if seen.observed is not None:
        shown = record.of("observed")[part]
        curves["velocity, m/s"]["forward, as shown to the policy"] = shown[:, 6]
        curves["tilt, °"]["as shown to the policy"] = np.degrees(np.arctan2(planar(shown), -shown[:, 2]))
    drawn = Figure(figsize=(width / 100, 2.4), dpi=100, layout="constrained")
    first, *others = drawn.subplots(1, 1 + len(curves))
    ground = np.where(record.of("foot_contact")[part] > 0, planar(record.shank[1][part, :, -1]), np.nan).T
    look = {"vmin": -0.3, "vmax": 1.0, "aspect": "auto", "interpolation": "nearest"}
    first.imshow(ground, "YlOrRd", extent=(*ends, len(legs) - 0.5, -0.5), **look)
    first.set_yticks(range(len(legs)), [name.upper() for name in legs])
    first.set_title("feet on the ground (red: sliding)", fontsize=9)
    for axes, (title, lines) in zip(others, curves.items(), strict=True):
        for label, values in lines.items():
            axes.plot(time, values, label=label)
        axes.set_title(title, fontsize=9)
        axes.legend(fontsize=7)
    buffer = io.BytesIO()
    drawn.savefig(buffer)
    return Image.open(buffer).convert("RGB")
