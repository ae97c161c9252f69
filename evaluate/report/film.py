"""A film of one episode: frames with the time, the command and what happens, as MP4, GIF, WebP or a strip in a PNG."""

import io
import os
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from evaluate.rollouts.hardware import IDEAL, Hardware
from evaluate.terminal.command_line import UsageError
from policies.base import Policy
from policies.files import write_atomically
from quad_env.config import FALL_REASONS
from quad_env.scenarios.named import Scenario

if TYPE_CHECKING:
    from PIL.Image import Image

KINDS = (".mp4", ".webp", ".gif", ".png")
FRAMES_A_SECOND = 25
AFTERMATH = 100
"""Control steps that are shown after a fall."""
PUSH_SHOWN = 30
"""Control steps for which a push is marked, since it is shorter than the eye needs."""
STRIP, STRIP_ROWS = 12, 3
"""Frames of a strip."""
STRIP_FRAMES_A_SECOND = 5
SHADOW_SIZE = 1024
"""Pixels; the model's own 4096 take half of a frame's time."""
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
    frames = shots(take, progress, STRIP_FRAMES_A_SECOND if kind == ".png" else FRAMES_A_SECOND)
    if kind == ".mp4":
        _write_mp4(frames, path)
        return
    buffer = io.BytesIO()
    if kind == ".png":
        _strip(list(frames)).save(buffer, "png")
    else:
        first = next(frames)
        lasting = round(1000 / FRAMES_A_SECOND)
        first.save(buffer, kind[1:], save_all=True, append_images=frames, duration=lasting, loop=0)
    write_atomically(path, buffer.getvalue())


def shots(take: Take, progress: Progress, frames_a_second: int) -> "Iterator[Image]":
    """The frames of an episode, until shortly after a fall."""
    from gymnasium.vector import AutoresetMode

    from quad_env.envs.vector_env import SimpleQuadVectorEnv

    env = SimpleQuadVectorEnv(
        1,
        scenario=take.scenario,
        nthread=1,
        autoreset_mode=AutoresetMode.DISABLED,
        max_episode_steps=take.steps,
        terminate_on_fall=False,
        render_mode="rgb_array",
        readings=True,
        **asdict(take.hardware),
    )
    env.simulation.model.vis.quality.shadowsize = SHADOW_SIZE
    try:
        observation, _ = env.reset(seed=[take.seed])
        take.policy.reset(num_envs=1, seed=0)
        fell, pushed = "", 0
        last, every = take.steps - 1, round(1 / env.dt / frames_a_second)
        for step in range(take.steps):
            observation, _, terminated, _, infos = env.step(take.policy.act(observation))
            pushed = PUSH_SHOWN if infos["push"].any() else pushed - 1
            if not fell and (infos["diverged"][0] or infos["fall"][0]):
                reason = "diverged" if infos["diverged"][0] else FALL_REASONS[infos["fall"][0]]
                fell, last = f"fell at {(step + 1) * env.dt:.2f} s: {reason}", min(last, step + AFTERMATH)
            if step % every == 0:
                alarms = [fell, "pushed" if pushed > 0 else ""]
                yield _captioned(_frame(env), take.title, (step + 1) * env.dt, infos["command"][0], alarms)
                progress((step + 1) / (last + 1))
            if step >= last or terminated[0]:
                break
    finally:
        env.close()
    progress(1.0)


def _frame(env: Any) -> NDArray[np.uint8]:
    try:
        return env.render()[0]  # type: ignore[no-any-return]
    except Exception as error:  # whatever the graphics driver fails with
        raise UsageError(f"--video: nothing can be drawn here ({type(error).__name__}: {error})") from error


def _captioned(
    frame: NDArray[np.uint8], title: str, time: float, command: NDArray[np.float64], alarms: list[str]
) -> "Image":
    from PIL import Image, ImageDraw

    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    asked = f"command {command[0]:+.2f} m/s forward, {command[1]:+.2f} m/s left, {command[2]:+.2f} rad/s"
    draw.rectangle((0, 0, image.width, 50), fill=_BAND)
    draw.text((10, 5), f"{title}\n{time:.2f} s   {asked}", fill=_INK, font_size=16)
    if alarm := "   ".join(filter(None, alarms)):
        draw.rectangle((0, 50, image.width, 80), fill=_ALARM)
        draw.text((10, 54), alarm, fill=_INK, font_size=18)
    return image


def _strip(frames: "list[Image]") -> "Image":
    """So many frames, evenly over the film, in rows."""
    from PIL import Image

    chosen = [frames[i] for i in np.linspace(0, len(frames) - 1, min(STRIP, len(frames))).round().astype(int)]
    columns = -(-len(chosen) // STRIP_ROWS)
    width, height = chosen[0].size
    sheet = Image.new("RGB", (columns * width, -(-len(chosen) // columns) * height), "white")
    for i, frame in enumerate(chosen):
        sheet.paste(frame, (i % columns * width, i // columns * height))
    return sheet


def _write_mp4(frames: "Iterator[Image]", path: Path) -> None:
    import imageio_ffmpeg

    first = next(frames)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".mp4")
    os.close(handle)
    try:
        writer = imageio_ffmpeg.write_frames(temporary, first.size, fps=FRAMES_A_SECOND, macro_block_size=1)
        writer.send(None)
        for frame in chain((first,), frames):
            writer.send(frame.tobytes())
        writer.close()
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
