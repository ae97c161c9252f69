"""Pictures side by side."""

import math
from collections.abc import Sequence

from PIL import Image


def tiled(images: Sequence[Image.Image], columns: int) -> Image.Image:
    """Images of one size in rows of so many."""
    width, height = images[0].size
    columns = min(columns, len(images))
    out = Image.new("RGB", (columns * width, -(-len(images) // columns) * height), "white")
    for place, image in enumerate(images):
        out.paste(image, (place % columns * width, place // columns * height))
    return out


def stacked(images: Sequence[Image.Image]) -> Image.Image:
    """Images of one width, one below the other."""
    out = Image.new("RGB", (images[0].width, sum(image.height for image in images)))
    top = 0
    for image in images:
        out.paste(image, (0, top))
        top += image.height
    return out


def columns_for(count: int) -> int:
    """Columns of so many pictures: up to three stand in a row, more as nearly in a square as they can."""
    return count if count <= 3 else math.ceil(math.sqrt(count))
