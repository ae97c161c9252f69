"""Blocks of Markdown files that commands write: lines between `<!-- NAME -->` and `<!-- /NAME -->`."""

from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically

RESULTS = "results"
"""Name of the first block of a file."""


def insert_block(text: str, lines: list[str], marker: str = RESULTS) -> str:
    """Insert lines between the markers of a block.

    Args:
        text: Markdown.
        lines: Lines of the block.
        marker: Name of the block.

    Returns:
        The text with the block.

    Raises:
        UsageError: The text lacks the block.
    """
    begin = f"<!-- {marker} -->"
    end = f"<!-- /{marker} -->"
    if begin not in text or end not in text:
        raise UsageError(f"no {begin} and {end} in the file that is to hold the results")
    head, rest = text.split(begin, 1)
    block = "\n".join(lines)
    return f"{head}{begin}\n{block}\n{end}{rest.split(end, 1)[1]}"


def read_page(page: Path, *places: str) -> str:
    """Read a page.

    Args:
        page: File.
        *places: Names of the blocks that it must have.

    Returns:
        Its text.

    Raises:
        UsageError: The file is unreadable, or lacks a block.
    """
    try:
        text = read_bytes(page).decode()
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read the page {page} ({error})") from error
    for marker in places:
        insert_block(text, [], marker)
    return text


def write_block(page: Path | None, lines: list[str], marker: str = RESULTS) -> None:
    """Write the `lines` into the block `marker` of the `page`, if there is a page."""
    if page is not None:
        write_atomically(page, insert_block(read_page(page), lines, marker).encode())
