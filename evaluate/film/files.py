"""Film files: MP4, WebP, GIF, or PNG with a strip (several frames of the film in one image).

If writing fails, no incomplete film file remains.
"""

import io
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from itertools import chain, repeat
from pathlib import Path

import numpy as np
from PIL import Image

from quad_env.cli.command_line import UsageError, make_folder_of
from quad_env.cli.extras import install_command
from quad_env.files.writing import write_atomically

STRIP_SUFFIX = ".png"
"""Suffix of a film file that is a strip: a PNG image with several frames of the film."""
FILM_SUFFIXES = (".mp4", ".webp", ".gif", STRIP_SUFFIX)
"""Suffixes of all formats of film files."""
STRIP_FRAMES = 12
"""Number of frames of the film that a strip (PNG image) shows."""
STRIP_WIDTH = 2560
"""Largest width of a strip (PNG image with rows of frames), pixels."""
LAST_FRAME_TIME = 1.5
"""Additional time for which the last frame of a film is displayed, s."""

MAX_PIXELS = 500_000_000
"""Largest number of pixels of a WebP, GIF or PNG film, summed over all frames.

Films in these formats are encoded in memory, with 4 bytes per pixel. MP4 films have no limit, because their frames are
encoded one by one.
"""


def check_film_path(path: Path, option: str = "--video") -> None:
    """Check that a film can be written to a path, and make the folder of the file.

    Args:
        path: File of the film; its suffix selects the format.
        option: Command-line option that names the file, for the error message.

    Raises:
        UsageError: The suffix is unknown, an encoder is missing, or the folder cannot be made.
    """
    kind = path.suffix.lower()
    if kind not in FILM_SUFFIXES:
        raise UsageError(f"{option} must end in {', '.join(FILM_SUFFIXES)}, not {path.name!r}")
    if kind == ".mp4":
        try:
            import imageio_ffmpeg

            imageio_ffmpeg.get_ffmpeg_exe()
        except (ImportError, RuntimeError):
            raise UsageError(
                f"{option}: an .mp4 needs an encoder, {install_command('video')}; a .webp, a .gif and a .png do without"
            ) from None
    make_folder_of(path, option)


def check_pixels(path: Path, pixels: int) -> None:
    """Check that a film is not too long for its file format.

    Args:
        path: File of the film.
        pixels: Number of pixels in all frames.

    Raises:
        UsageError: The film has more than MAX_PIXELS pixels, and its format is not MP4.
    """
    if path.suffix.lower() != ".mp4" and pixels > MAX_PIXELS:
        raise UsageError(
            f"a {path.suffix} of {pixels / 1e6:.0f} million pixels is too long, {MAX_PIXELS / 1e6:.0f} are the most: "
            "write an .mp4, or film less, in smaller frames or fewer a second"
        )


def write_film(images: Iterable[Image.Image], path: Path, period: float) -> None:
    """Write a film to a file; its last frame is displayed longer than the other frames (LAST_FRAME_TIME).

    Args:
        images: Frames of equal size.
        path: File to write; its suffix selects the format.
        period: Display time of a frame, s.
    """
    suffix = path.suffix.lower()
    if suffix == ".mp4":
        _encode(images, path, period)
        return
    frames = list(images)
    if suffix == STRIP_SUFFIX:
        content = _strip(frames)
    else:
        content = encode_animation(frames, suffix[1:], period, LAST_FRAME_TIME)
    write_atomically(path, content)


def encode_animation(
    images: Sequence[Image.Image], kind: str, period: float, end: float = 0.0, quality: int = 80
) -> bytes:
    """Encode frames as a WebP or GIF animation that repeats forever.

    Args:
        images: Frames of equal size.
        kind: File format, `webp` or `gif`.
        period: Display time of a frame, s.
        end: Additional display time of the last frame, s.
        quality: Quality of WebP, 0 … 100.

    Returns:
        Contents of the animation file.
    """
    buffer = io.BytesIO()
    durations = [round(1000 * period)] * len(images)
    durations[-1] += round(1000 * end)
    settings = {
        "duration": durations,
        "loop": 0,
        "quality": quality,
        "method": 4,  # WebP files with this setting are a third smaller than with 0.
    }
    images[0].save(buffer, kind, save_all=True, append_images=images[1:], **settings)
    return buffer.getvalue()


def _strip(images: list[Image.Image]) -> bytes:
    """Return a PNG image with STRIP_FRAMES of the `images`, evenly spaced in time and arranged in rows."""
    indices = np.linspace(0, len(images) - 1, min(STRIP_FRAMES, len(images))).round().astype(int)
    rows = -(-len(indices) // max(1, STRIP_WIDTH // images[0].width))
    columns = -(-len(indices) // rows)
    buffer = io.BytesIO()
    tile_images([images[index] for index in indices], columns).save(buffer, "png")
    return buffer.getvalue()


def tile_images(images: Sequence[Image.Image], columns: int) -> Image.Image:
    """Arrange `images` of equal size in one image, in rows of at most `columns` images."""
    width, height = images[0].size
    columns = min(columns, len(images))
    rows = -(-len(images) // columns)
    tiles = Image.new("RGB", (columns * width, rows * height), "white")
    for index, image in enumerate(images):
        tiles.paste(image, (index % columns * width, index // columns * height))
    return tiles


def _encode(images: Iterable[Image.Image], path: Path, period: float) -> None:
    """Encode a film as MP4 in a temporary folder, and move the file to `path` when it is complete.

    A frame with an odd width or height is padded by one pixel, because the colour format of MP4 needs even sizes.

    Args:
        images: Frames of equal size.
        path: File to write.
        period: Display time of a frame, s.

    Raises:
        OSError: The encoder did not write all frames.
    """
    import imageio_ffmpeg

    remaining = iter(images)
    first = next(remaining)
    size = (first.width + first.width % 2, first.height + first.height % 2)
    settings = {"fps": 1 / period, "macro_block_size": 1, "ffmpeg_log_level": "quiet"}
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
        temporary = Path(folder) / path.name
        count = 0
        frame = b""
        with closing(imageio_ffmpeg.write_frames(str(temporary), size, **settings)) as encoder:
            encoder.send(None)
            for image in chain([first], remaining, repeat(None, round(LAST_FRAME_TIME / period))):
                frame = frame if image is None else image.crop((0, 0, *size)).tobytes()
                encoder.send(frame)
                count += 1
        with suppress(RuntimeError):
            if imageio_ffmpeg.count_frames_and_secs(str(temporary))[0] == count:
                temporary.replace(path)
                return
        raise OSError("the encoder failed; is the disk full?")
