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
    """Lines of text on images: size of the letters and of a dark edge around them, pixels."""

    size: int
    edge: int = 0

    def height(self, lines: int) -> int:
        """Of a bar for so many lines, pixels."""
        return lines * round(1.35 * self.size) + _MARGIN

    def write(
        self, image: Image.Image, text: str, line: int, ink: Ink = WHITE, *, right: bool = False, taken: int = 0
    ) -> int:
        """One line, counted from the top, or from the bottom where negative, at the left or the right margin, where so
        many pixels of it are `taken`; gives how many it takes itself."""
        draw, size, room = ImageDraw.Draw(image), self.size, image.width - 2 * _MARGIN - taken
        while size > SMALLEST and draw.textlength(text, font_size=size) > room:
            size -= 1
        while len(text) > 1 and draw.textlength(text, font_size=size) > room:
            text = f"{text[:-2]}…"
        length = round(draw.textlength(text, font_size=size))
        top = self.height(line) - _MARGIN // 2 if line >= 0 else image.height - self.height(-line) + _MARGIN // 2
        place = image.width - _MARGIN - length if right else _MARGIN, top
        draw.text(place, text, fill=ink, font_size=size, stroke_width=self.edge, stroke_fill=(0, 0, 0))
        return length + 2 * _MARGIN

    def sign(self, image: Image.Image, text: str, ground: Ink) -> None:
        """A line on a coloured bar along the bottom."""
        bar = (0, image.height - self.height(1), image.width, image.height)
        ImageDraw.Draw(image).rectangle(bar, fill=ground)
        self.write(image, text, -1)


def motion(velocity: Array) -> str:
    """Forward and left, m/s, and yaw rate, rad/s, (3,), in words."""
    forward, left, turning = velocity.round(2) + 0.0  # no negative zero
    return f"{forward:+.2f} m/s forward, {left:+.2f} m/s left, {turning:+.2f} rad/s"


def ink(colour: Colour) -> Ink:
    """A mark's colour for text."""
    return round(255 * colour[0]), round(255 * colour[1]), round(255 * colour[2])
