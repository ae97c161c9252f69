"""Files of films: MP4, WebP, GIF, or a strip of frames in a PNG; each is there whole or not at all."""

import io
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from PIL import Image

from evaluate.film.sheet import tiled
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
    elif kind == STRIP:
        write_atomically(path, _strip(list(images)))
    else:
        write_atomically(path, moving_picture(list(images), kind[1:], period, END_SHOWN))


def moving_picture(
    images: Sequence[Image.Image], kind: str, period: float, end: float = 0.0, quality: int = 80
) -> bytes:
    """A WebP, of that quality out of 100, or a GIF, over and over: each image for `period` s, the last `end` s more."""
    buffer, lasting = io.BytesIO(), [round(1000 * period)] * len(images)
    lasting[-1] += round(1000 * end)
    images[0].save(buffer, kind, save_all=True, append_images=images[1:], duration=lasting, loop=0, quality=quality)
    return buffer.getvalue()


def _strip(images: list[Image.Image]) -> bytes:
    """So many images, evenly over the film, in rows."""
    places = np.linspace(0, len(images) - 1, min(STRIP_FRAMES, len(images))).round().astype(int)
    rows = -(-len(places) // max(1, STRIP_WIDTH // images[0].width))
    buffer = io.BytesIO()
    tiled([images[place] for place in places], -(-len(places) // rows)).save(buffer, "png")
    return buffer.getvalue()


def _encode(images: Iterable[Image.Image], path: Path, period: float) -> None:
    """An MP4 of even width and height, as its colours need; OSError unless all of it is there in the end."""
    import imageio_ffmpeg

    shown = _with_end(images, round(END_SHOWN / period))
    first = _even(next(shown))
    with _whole(path) as temporary:
        how = {"fps": 1 / period, "macro_block_size": 1, "ffmpeg_log_level": "quiet"}
        with closing(imageio_ffmpeg.write_frames(temporary, first.size, **how)) as encoder:
            encoder.send(None)
            encoder.send(first.tobytes())
            count = 1
            for image in shown:
                encoder.send(_even(image).tobytes())
                count += 1
        if not _has_frames(temporary, count):
            raise OSError("the encoder failed; is the disk full?")


def _with_end(images: Iterable[Image.Image], more: int) -> Iterator[Image.Image]:
    """The images, and the last one so many times more."""
    for image in images:
        yield image
    yield from [image] * more


def _even(image: Image.Image) -> Image.Image:
    width, height = image.size
    return image.crop((0, 0, width + width % 2, height + height % 2))


def _has_frames(path: str, count: int) -> bool:
    import imageio_ffmpeg

    try:
        return bool(imageio_ffmpeg.count_frames_and_secs(path)[0] == count)
    except RuntimeError:
        return False


@contextmanager
def _whole(path: Path) -> Iterator[str]:
    """The name of a file that takes this path once the block is done, and is gone if it fails."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    os.close(handle)
    try:
        yield temporary
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
