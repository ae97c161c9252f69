"""Captions of frames: text that is made smaller, then shorter, until it fits into its frame."""

from dataclasses import dataclass

from PIL import Image, ImageDraw

from quad_env.columns import Array
from quad_env.physics.arrows import Colour

Ink = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""
DARK: Ink = (30, 34, 38)
"""Background of captions."""
WHITE: Ink = (255, 255, 255)
"""Default text colour."""
MIN_FONT_SIZE = 10
"""pixels. Smallest readable font size."""
_MARGIN = 8
"""pixels. Margin around a text."""


@dataclass(frozen=True)
class Text:
    """Style of text on images, with the methods that write it."""

    size: int
    """pixels. Font size."""
    edge: int = 0
    """pixels. Width of the dark edge around the letters."""

    def height(self, lines: int) -> int:
        """Return the height of a bar with that number of lines, pixels."""
        return lines * round(1.35 * self.size) + _MARGIN

    def write(
        self, image: Image.Image, text: str, line: int, ink: Ink = WHITE, *, right: bool = False, taken: int = 0
    ) -> int:
        """Write one line on an image, smaller or shorter if it does not fit.

        Args:
            image: Image to write on.
            text: Text.
            line: Line counted from the top, from 0; negative from the bottom, from −1.
            ink: Colour.
            right: Whether the line ends at the right margin.
            taken: Width that other text takes on the line, pixels.

        Returns:
            Width that the text takes with its margins, pixels.
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
        """Write a line on a coloured bar along the bottom.

        Args:
            image: Image to write on.
            text: Text.
            ground: Colour of the bar.
        """
        bar = (0, image.height - self.height(1), image.width, image.height)
        ImageDraw.Draw(image).rectangle(bar, fill=ground)
        self.write(image, text, -1)


def format_velocity(velocity: Array) -> str:
    """Format forward and left velocity, m/s, and yaw rate, rad/s, (3,)."""
    forward, left, turning = velocity.round(2) + 0.0  # no negative zero
    return f"{forward:+.2f} m/s forward, {left:+.2f} m/s left, {turning:+.2f} rad/s"


def text_colour(colour: Colour) -> Ink:
    """Convert the colour of a mark to a text colour."""
    return round(255 * colour[0]), round(255 * colour[1]), round(255 * colour[2])
