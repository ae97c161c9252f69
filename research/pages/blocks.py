"""Generated blocks of Markdown pages: the lines between `<!-- NAME -->` and `<!-- /NAME -->`.

The functions replace the lines of a block by new results; the text outside of the block stays unchanged.
"""

from pathlib import Path

from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes
from quad_env.files.writing import write_atomically

RESULTS = "results"
"""Name of the part of a Markdown page into which a command writes the main results.

The part (generated block) is between the lines `<!-- results -->` and `<!-- /results -->`.
"""


def insert_block(text: str, lines: list[str], marker: str = RESULTS) -> str:
    """Replace the lines of a generated block in the text of a Markdown page.

    A generated block consists of the lines between `<!-- MARKER -->` and `<!-- /MARKER -->`.

    Args:
        text: Text of the page.
        lines: New lines of the block.
        marker: Name of the block.

    Returns:
        The text with the new lines between the markers of the block.

    Raises:
        UsageError: The page has no block of that name.
    """
    begin = f"<!-- {marker} -->"
    end = f"<!-- /{marker} -->"
    if begin not in text or end not in text:
        raise UsageError(f"no {begin} and {end} in the file that is to hold the results")
    head, rest = text.split(begin, 1)
    block = "\n".join(lines)
    return f"{head}{begin}\n{block}\n{end}{rest.split(end, 1)[1]}"


def read_page(page: Path, *places: str) -> str:
    """Read a Markdown page, and check that it has the generated blocks of the given names.

    A generated block consists of the lines between `<!-- NAME -->` and `<!-- /NAME -->`.

    Args:
        page: File of the page.
        *places: Names of the blocks that the page must have.

    Returns:
        The text of the page.

    Raises:
        UsageError: The page cannot be read, or a block is missing.
    """
    try:
        text = read_bytes(page).decode()
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read the page {page} ({error})") from error
    for marker in places:
        insert_block(text, [], marker)
    return text


def write_block(page: Path | None, lines: list[str], marker: str = RESULTS) -> None:
    """Replace the lines of a generated block in the file of a Markdown page.

    A generated block consists of the lines between `<!-- MARKER -->` and `<!-- /MARKER -->`.

    Args:
        page: File of the page; None to do nothing.
        lines: New lines of the block.
        marker: Name of the block.
    """
    if page is not None:
        write_atomically(page, insert_block(read_page(page), lines, marker).encode())
