"""Captions: lines of text in the frames of a film.

A text that is too wide gets a smaller font. If it is still too wide at MIN_FONT_SIZE, its end is cut off.
"""

from dataclasses import dataclass

from PIL import Image, ImageDraw

from quad_env.columns import Array
from quad_env.physics.arrows import Colour

Ink = tuple[int, int, int]
"""Type of the colour of a text or a bar: red, green and blue, each 0 … 255."""
DARK: Ink = (30, 34, 38)
"""Background colour of the bars behind captions."""
WHITE: Ink = (255, 255, 255)
"""Default colour of captions."""
MIN_FONT_SIZE = 10
"""Smallest readable font size, pixels."""
_MARGIN = 8
"""Distance of a caption from the edges of its image or bar, pixels."""


@dataclass(frozen=True)
class Text:
    """Style of captions, with methods that write captions in this style on images."""

    size: int
    """Font size of the captions, pixels."""
    edge: int = 0
    """Width of the black outline around the letters, pixels."""

    def height(self, lines: int) -> int:
        """Return the height of a bar with space for the given number of `lines` of text, pixels."""
        return lines * round(1.35 * self.size) + _MARGIN

    def write(
        self, image: Image.Image, text: str, line: int, ink: Ink = WHITE, *, right: bool = False, taken: int = 0
    ) -> int:
        """Write one line of text on an image.

        A text that does not fit gets a smaller font. If it does not fit at the smallest font size, its end is cut off.

        Args:
            image: Image to write on.
            text: Text of the line.
            line: Index of the line: 0 is the first from the top, −1 the first from the bottom.
            ink: Colour of the text.
            right: True to align the text with the right margin, False to align it with the left margin.
            taken: Width of the part of the line that another text occupies, pixels.

        Returns:
            Width of the text including its margins, pixels.
        """
        draw = ImageDraw.Draw(image)
        size = self.size
        room = image.width - 2 * _MARGIN - taken
        while size > MIN_FONT_SIZE and draw.textlength(text, font_size=size) > room:
            size -= 1
        while len(text) > 1 and draw.textlength(text, font_size=size) > room:
            text = f"{text[:-2]}…"
        width = round(draw.textlength(text, font_size=size))
        left = image.width - _MARGIN - width if right else _MARGIN
        top = self.height(line) - _MARGIN // 2 if line >= 0 else image.height - self.height(-line) + _MARGIN // 2
        draw.text((left, top), text, fill=ink, font_size=size, stroke_width=self.edge, stroke_fill=(0, 0, 0))
        return width + 2 * _MARGIN

    def write_banner(self, image: Image.Image, text: str, ground: Ink) -> None:
        """Write a line of text on a coloured bar along the bottom of an image.

        Args:
            image: Image to write on.
            text: Text of the line.
            ground: Colour of the bar.
        """
        bar = (0, image.height - self.height(1), image.width, image.height)
        ImageDraw.Draw(image).rectangle(bar, fill=ground)
        self.write(image, text, -1)


def format_velocity(velocity: Array) -> str:
    """Format a velocity as text, for example `+0.50 m/s forward, +0.00 m/s left, +0.80 rad/s`.

    `velocity` is forward velocity, m/s, leftward velocity, m/s, and yaw rate, rad/s, (3,).
    """
    forward, left, turning = velocity.round(2) + 0.0  # Zero is added, because −0.00 would be printed with its sign.
    return f"{forward:+.2f} m/s forward, {left:+.2f} m/s left, {turning:+.2f} rad/s"


def text_colour(colour: Colour) -> Ink:
    """Convert the `colour` of an arrow, components 0 … 1, to the colour of a text, components 0 … 255."""
    return round(255 * colour[0]), round(255 * colour[1]), round(255 * colour[2])
