"""A film of one episode: frames with the time, the command and what happens, as MP4, GIF, WebP or a strip in a PNG."""

import io
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from evaluate.rollouts.hardware import IDEAL, Hardware
from evaluate.rollouts.observers import HEIGHT, WIDTH, Falls, Frame, Frames, Step
from evaluate.rollouts.rollout import roll_out
from evaluate.terminal.command_line import UsageError
from policies.base import CONTROL_PERIOD, Policy
from policies.files import write_atomically
from quad_env.scenarios.named import Scenario

KINDS = (".mp4", ".webp", ".gif", ".png")
FRAMES_A_SECOND = 25
AFTERMATH = 100
"""Control steps that are shown after a fall."""
PUSH_SHOWN = 30
"""Control steps for which a push is marked, since it is shorter than the eye needs."""
STRIP, STRIP_ROWS = 12, 3
"""Frames of a strip."""
STRIP_FRAMES_A_SECOND = 5
_BAND, _INK, _ALARM = (30, 34, 38), (255, 255, 255), (200, 30, 30)

Progress = Callable[[float], None]


@dataclass(frozen=True)
class Take:
    """What is filmed: a policy in one episode of a scenario."""

    policy: Policy
    scenario: Scenario
    seed: int
    steps: int
    title: str
    hardware: Hardware = IDEAL


def check_kind(path: Path) -> None:
    """Raise UsageError unless a film can be written in the format that the file's name asks for."""
    if path.suffix.lower() not in KINDS:
        raise UsageError(f"--video must end in {', '.join(KINDS)}, not {path.name!r}")
    if path.suffix.lower() == ".mp4":
        try:
            import imageio_ffmpeg

            imageio_ffmpeg.get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            raise UsageError(
                "--video: an .mp4 needs an encoder, `pip install imageio-ffmpeg`; a .webp, a .gif and a .png do without"
            ) from None


def write(take: Take, path: Path, progress: Progress) -> None:
    """Film an episode. UsageError where nothing can be drawn, OSError where nothing can be written."""
    kind = path.suffix.lower()
    if kind == ".mp4":
        with _encoder(path) as keep:
            shoot(take, progress, FRAMES_A_SECOND, keep)
        return
    images: list[Image.Image] = []
    shoot(take, progress, STRIP_FRAMES_A_SECOND if kind == ".png" else FRAMES_A_SECOND, images.append)
    if kind == ".png":
        buffer = io.BytesIO()
        _strip(images).save(buffer, "png")
        write_atomically(path, buffer.getvalue())
    else:
        write_atomically(path, moving_picture(images, kind[1:], 1 / FRAMES_A_SECOND))


def moving_picture(images: list[Image.Image], kind: str, period: float, quality: int = 80) -> bytes:
    """A WebP, of that quality out of 100, or a GIF, which shows each image for `period` s, over and over."""
    buffer, lasting = io.BytesIO(), round(1000 * period)
    images[0].save(buffer, kind, save_all=True, append_images=images[1:], duration=lasting, loop=0, quality=quality)
    return buffer.getvalue()


def shoot(take: Take, progress: Progress, frames_a_second: int, keep: Callable[[Image.Image], None]) -> None:
    """Keep the frames of an episode, until shortly after a fall."""
    with closing(Frames(round(1 / (CONTROL_PERIOD * frames_a_second)))) as frames:
        film = _Film(take, frames, progress, keep)
        how = take.policy, take.scenario, np.array([take.seed])
        roll_out(*how, film, steps=take.steps, terminate_on_fall=False, hardware=take.hardware)
    progress(1.0)


class _Film:
    """Observer that captions the frames, and ends the rollout shortly after a fall."""

    def __init__(self, take: Take, frames: Frames, progress: Progress, keep: Callable[[Image.Image], None]) -> None:
        self._title, self._last = take.title, take.steps
        self._frames, self._progress, self._keep = frames, progress, keep
        self._falls, self._push_shown = Falls(1, take.steps), 0

    def __call__(self, step: Step) -> bool:
        if not step.number:
            return False
        self._falls(step)
        self._last = min(self._last, int(self._falls.step[0]) + 1 + AFTERMATH)
        self._push_shown = PUSH_SHOWN if step.infos["push"].any() else self._push_shown - 1
        if self._frames.due(step):
            frame, time = _drawn(self._frames, step), step.number * step.env.dt
            self._keep(_captioned(frame, self._title, time, step.infos["command"][0], self._alarms(step.env.dt)))
            self._progress(step.number / self._last)
        return step.number >= self._last

    def _alarms(self, dt: float) -> list[str]:
        falls = self._falls
        fall = f"fell at {(falls.step[0] + 1) * dt:.2f} s: {falls.reason[0]}" if falls.fell[0] else ""
        return [fall, "pushed" if self._push_shown > 0 else ""]


def _drawn(frames: Frames, step: Step) -> Frame:
    try:
        return frames.draw(step.env)
    except Exception as error:  # whatever the graphics driver fails with
        raise UsageError(f"--video: nothing can be drawn here ({type(error).__name__}: {error})") from error


def _captioned(frame: Frame, title: str, time: float, command: NDArray[np.float64], alarms: list[str]) -> Image.Image:
    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    asked = f"command {command[0]:+.2f} m/s forward, {command[1]:+.2f} m/s left, {command[2]:+.2f} rad/s"
    draw.rectangle((0, 0, image.width, 50), fill=_BAND)
    draw.text((10, 5), f"{title}\n{time:.2f} s   {asked}", fill=_INK, font_size=16)
    if alarm := "   ".join(filter(None, alarms)):
        draw.rectangle((0, 50, image.width, 80), fill=_ALARM)
        draw.text((10, 54), alarm, fill=_INK, font_size=18)
    return image


def _strip(frames: list[Image.Image]) -> Image.Image:
    """So many frames, evenly over the film, in rows."""
    chosen = [frames[i] for i in np.linspace(0, len(frames) - 1, min(STRIP, len(frames))).round().astype(int)]
    columns = -(-len(chosen) // STRIP_ROWS)
    width, height = chosen[0].size
    sheet = Image.new("RGB", (columns * width, -(-len(chosen) // columns) * height), "white")
    for i, frame in enumerate(chosen):
        sheet.paste(frame, (i % columns * width, i // columns * height))
    return sheet


@contextmanager
def _encoder(path: Path) -> Iterator[Callable[[Image.Image], None]]:
    """Takes the frames of an MP4, which is there once all is done."""
    import imageio_ffmpeg

    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".mp4")
    os.close(handle)
    try:
        writer = imageio_ffmpeg.write_frames(temporary, (WIDTH, HEIGHT), fps=FRAMES_A_SECOND, macro_block_size=1)
        writer.send(None)
        yield lambda image: writer.send(image.tobytes())
        writer.close()
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
