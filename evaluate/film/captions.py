"""Captions of frames: text that gets smaller, then shorter, before it leaves its frame."""

from dataclasses import dataclass

from PIL import Image, ImageDraw

from quad_env.columns import Array
from quad_env.physics.arrows import Colour

Ink = tuple[int, int, int]
DARK: Ink = (30, 34, 38)
WHITE: Ink = (255, 255, 255)
SMALLEST = 10
"""Size of letters that can still be read, pixels."""
_MARGIN = 8


@dataclass(frozen=True)
class Text:
    """Lines of text on images."""

    size: int
    """Of the letters, pixels."""
    edge: int = 0
    """Of dark pixels around them."""

    @property
    def line(self) -> int:
        """Pixels from a line to the next."""
        return round(1.35 * self.size)

    def band(self, width: int, lines: int) -> Image.Image:
        """A bar for so many lines."""
        return Image.new("RGB", (width, lines * self.line + _MARGIN), DARK)

    def write(
        self, image: Image.Image, text: str, line: int, ink: Ink = WHITE, *, right: bool = False, taken: int = 0
    ) -> int:
        """One line, counted from the top, at the left or the right margin, where so many pixels of it are `taken`;
        gives how many pixels it takes itself."""
        draw = ImageDraw.Draw(image)
        text, size = self._fitted(draw, text, image.width - 2 * _MARGIN - taken)
        length = round(draw.textlength(text, font_size=size))
        left = image.width - _MARGIN - length if right else _MARGIN
        place = left, _MARGIN // 2 + line * self.line
        draw.text(place, text, fill=ink, font_size=size, stroke_width=self.edge, stroke_fill=(0, 0, 0))
        return length + 2 * _MARGIN

    def sign(self, image: Image.Image, text: str, ground: Ink) -> None:
        """A line on a coloured bar along the bottom."""
        height = self.line + _MARGIN
        bar = Image.new("RGB", (image.width, height), ground)
        self.write(bar, text, 0)
        image.paste(bar, (0, image.height - height))

    def _fitted(self, draw: ImageDraw.ImageDraw, text: str, room: int) -> tuple[str, int]:
        size = self.size
        while size > SMALLEST and draw.textlength(text, font_size=size) > room:
            size -= 1
        while len(text) > 1 and draw.textlength(text, font_size=size) > room:
            text = f"{text[:-2]}…"
        return text, size


def framed(image: Image.Image, ink: Ink) -> Image.Image:
    """The image with a frame of that colour within its edges."""
    ImageDraw.Draw(image).rectangle((0, 0, image.width - 1, image.height - 1), outline=ink, width=image.height // 60)
    return image


def motion(velocity: Array) -> str:
    """Forward and left, m/s, and yaw rate, rad/s, (3,), in words."""
    forward, left, turning = velocity.round(2) + 0.0  # no negative zero
    return f"{forward:+.2f} m/s forward, {left:+.2f} m/s left, {turning:+.2f} rad/s"


def ink(colour: Colour) -> Ink:
    """A mark's colour for text."""
    red, green, blue = (round(255 * part) for part in colour[:3])
    return red, green, blue
