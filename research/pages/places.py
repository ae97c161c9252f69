"""Places in Markdown files that commands write tables into."""

from pathlib import Path

from quad_env.cli.command_line import UsageError

RESULTS = "results"
"""Name of a file's first place: between `<!-- results -->` and `<!-- /results -->`."""


def insert(text: str, lines: list[str], place: str = RESULTS) -> str:
    """The text with the lines between the markers of that place; UsageError where it has none."""
    begin, end = f"<!-- {place} -->", f"<!-- /{place} -->"
    if begin not in text or end not in text:
        raise UsageError(f"no {begin} and {end} in the file that is to hold the results")
    head, rest = text.split(begin, 1)
    inserted = "\n".join(lines)
    return f"{head}{begin}\n{inserted}\n{end}{rest.split(end, 1)[1]}"


def page_with(page: Path, *places: str) -> str:
    """Text of the page; UsageError where it cannot be read or lacks one of the places."""
    try:
        text = page.read_text(encoding="utf-8")
    except (OSError, UnicodeError) as error:
        raise UsageError(f"--page: cannot read {page} ({error})") from error
    for place in places:
        insert(text, [], place)
    return text
