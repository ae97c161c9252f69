"""Files of films: MP4, WebP, GIF, or a strip of frames in a PNG; each is there whole or not at all."""

import io
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from itertools import chain, repeat
from pathlib import Path

import numpy as np
from PIL import Image

from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.files.writing import write_atomically

STRIP = ".png"
KINDS = (".mp4", ".webp", ".gif", STRIP)
STRIP_FRAMES, STRIP_WIDTH = 12, 2560
"""Images of a strip, and pixels that its rows fill."""
END_SHOWN = 1.5
"""s for which the last frame stays."""

MOST_PIXELS = 500_000_000
"""Of all images of what is in memory until it is written, 4 bytes a pixel: all but an MP4."""


def check(path: Path, option: str = "--video") -> None:
    """Raise UsageError unless a film can be written there in the format that the file's name asks for."""
    kind = path.suffix.lower()
    if kind not in KINDS:
        raise UsageError(f"{option} must end in {', '.join(KINDS)}, not {path.name!r}")
    if kind == ".mp4":
        try:
            import imageio_ffmpeg

            imageio_ffmpeg.get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            raise UsageError(
                f'{option}: an .mp4 needs an encoder, pip install -e ".[video]"; a .webp, a .gif and a .png do without'
            ) from None
    make_folder_of(path, option)


def check_pixels(path: Path, pixels: int) -> None:
    """Raise UsageError where so many cannot be written in that format."""
    if path.suffix.lower() != ".mp4" and pixels > MOST_PIXELS:
        raise UsageError(
            f"a {path.suffix} of {pixels / 1e6:.0f} million pixels is too long, {MOST_PIXELS / 1e6:.0f} are the most: "
            "write an .mp4, or film less, in smaller frames or fewer a second"
        )


def write(images: Iterable[Image.Image], path: Path, period: float) -> None:
    """Write a film that shows each image for `period` s, the last one longer. Raises OSError where that fails."""
    kind = path.suffix.lower()
    if kind == ".mp4":
        _encode(images, path, period)
    else:
        whole = list(images)
        write_atomically(path, _strip(whole) if kind == STRIP else moving_picture(whole, kind[1:], period, END_SHOWN))


def moving_picture(
    images: Sequence[Image.Image], kind: str, period: float, end: float = 0.0, quality: int = 80
) -> bytes:
    """A WebP, of that quality out of 100, or a GIF, over and over: each image for `period` s, the last `end` s more."""
    buffer, lasting = io.BytesIO(), [round(1000 * period)] * len(images)
    lasting[-1] += round(1000 * end)
    how = {"duration": lasting, "loop": 0, "quality": quality, "method": 4}  # a third smaller than by Pillow's 0
    images[0].save(buffer, kind, save_all=True, append_images=images[1:], **how)
    return buffer.getvalue()


def _strip(images: list[Image.Image]) -> bytes:
    """So many images, evenly over the film, in rows."""
    places = np.linspace(0, len(images) - 1, min(STRIP_FRAMES, len(images))).round().astype(int)
    rows = -(-len(places) // max(1, STRIP_WIDTH // images[0].width))
    tiled([images[place] for place in places], -(-len(places) // rows)).save(buffer := io.BytesIO(), "png")
    return buffer.getvalue()


def tiled(images: Sequence[Image.Image], columns: int) -> Image.Image:
    """Images of one size in rows of so many."""
    width, height = images[0].size
    columns = min(columns, len(images))
    out = Image.new("RGB", (columns * width, -(-len(images) // columns) * height), "white")
    for place, image in enumerate(images):
        out.paste(image, (place % columns * width, place // columns * height))
    return out


def _encode(images: Iterable[Image.Image], path: Path, period: float) -> None:
    """An MP4 of even width and height, as its colours need; OSError unless all of it is there in the end."""
    import imageio_ffmpeg

    left = iter(images)
    first = next(left)
    size = first.width + first.width % 2, first.height + first.height % 2
    how = {"fps": 1 / period, "macro_block_size": 1, "ffmpeg_log_level": "quiet"}
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        temporary, count, frame = Path(folder) / path.name, 0, b""
        with closing(imageio_ffmpeg.write_frames(str(temporary), size, **how)) as encoder:
            encoder.send(None)
            for image in chain([first], left, repeat(None, round(END_SHOWN / period))):
                frame = frame if image is None else image.crop((0, 0, *size)).tobytes()
                encoder.send(frame)
                count += 1
        with suppress(RuntimeError):
            if imageio_ffmpeg.count_frames_and_secs(str(temporary))[0] == count:
                temporary.replace(path)
                return
        raise OSError("the encoder failed; is the disk full?")
