"""Generated blocks of Markdown files: the lines between `<!-- NAME -->` and `<!-- /NAME -->`."""

from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically

RESULTS = "results"
"""Name of the block with the main results of a file."""


def insert_block(text: str, lines: list[str], marker: str = RESULTS) -> str:
    """Replace the lines of a block.

    Args:
        text: Text of a Markdown file.
        lines: New lines of the block.
        marker: Name of the block.

    Returns:
        The text with the new lines between the markers of the block.

    Raises:
        UsageError: The text has no block of that name.
    """
    begin = f"<!-- {marker} -->"
    end = f"<!-- /{marker} -->"
    if begin not in text or end not in text:
        raise UsageError(f"no {begin} and {end} in the file that is to hold the results")
    head, rest = text.split(begin, 1)
    block = "\n".join(lines)
    return f"{head}{begin}\n{block}\n{end}{rest.split(end, 1)[1]}"


def read_page(page: Path, *places: str) -> str:
    """Read a Markdown page and check that it has the given blocks.

    Args:
        page: File of the page.
        *places: Names of the blocks that the page must have.

    Returns:
        The text of the page.

    Raises:
        UsageError: The file cannot be read, or a block is missing.
    """
    try:
        text = read_bytes(page).decode()
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read the page {page} ({error})") from error
    for marker in places:
        insert_block(text, [], marker)
    return text


def write_block(page: Path | None, lines: list[str], marker: str = RESULTS) -> None:
    """Write `lines` into the block `marker` of the file `page`; do nothing if `page` is None."""
    if page is not None:
        write_atomically(page, insert_block(read_page(page), lines, marker).encode())
