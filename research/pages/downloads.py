"""Deployment files of the shipped walks: `python -m research downloads` writes ZIP files and the table of them.

Each robot with a shipped policy models/ROBOT/walk gets a ZIP file in each format of `python -m train export --to`. The
table in docs/deployment-files.md has their digests, and the reasons of formats that cannot describe a policy.
"""

import hashlib
import io
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path

from policies import bundle
from policies.base import PolicyError
from policies.description import DESCRIPTION
from policies.registry import WALK
from policies.residual import ResidualPolicy
from policies.shipped import models_folder
from quad_env.cli.command_line import UsageError
from quad_env.files.writing import make_writable_folder, write_atomically
from quad_env.robots.registry import ROBOTS, get_robot
from research.pages.blocks import read_page, write_block
from research.pages.markdown import table

BLOCK = "downloads"
"""Name of the block with the table."""
COLUMNS = {"file": "file", "difference": "joint targets read back, rad", "size": "KiB", "digest": "SHA-256"}
"""Name of a column of the table -> heading."""
_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of all files in a ZIP file, so that its bytes depend on their content alone."""


@dataclass(frozen=True)
class DownloadsOptions:
    """Options of the command `downloads`."""

    out: Path = Path("results/downloads")
    """Folder to which the ZIP files are written."""
    page: Path = Path("docs/deployment-files.md")
    """Markdown page with the block `downloads`."""
    url: str = ""
    """Address of the folder from which users download the ZIP files; by default the table has no links."""


def main(options: DownloadsOptions) -> int:
    """Run the command `downloads`: write the ZIP files of all shipped walks, and the table into the page.

    Args:
        options: Options of the command.

    Returns:
        Exit code of the process.

    Raises:
        UsageError: No robot has a shipped walk, or the page has no block for the table.
    """
    # The import is in this function, because the formats take long to import, and --help must not wait for it.
    from train.export.export import FORMATS

    read_page(options.page, BLOCK)
    walks = shipped_walks()
    if not walks:
        raise UsageError(f"models: no robot has a shipped policy {WALK}, got none; valid: one of {', '.join(ROBOTS)}")
    make_writable_folder(options.out)
    rows = []
    remarks = []
    for name, policy in walks.items():
        for format_name in FORMATS:
            try:
                rows.append(_write(name, policy, format_name, options))
            except PolicyError as error:
                remarks.append(f"- {name}: {str(error).splitlines()[0]}")
    lines = [table(COLUMNS, rows), *(["", *remarks] if remarks else [])]
    write_block(options.page, lines, BLOCK)
    print("\n".join(lines))
    return 0


def shipped_walks() -> dict[str, ResidualPolicy]:
    """Load the shipped walks: name of the robot -> policy. Robots without one are left out."""
    folders = {name: models_folder(get_robot(name)) / WALK for name in ROBOTS}
    return {
        name: bundle.load(folder, get_robot(name), servo="own")
        for name, folder in folders.items()
        if (folder / DESCRIPTION).is_file()
    }


def _write(name: str, policy: ResidualPolicy, format_name: str, options: DownloadsOptions) -> dict[str, str]:
    """Write the ZIP file of a walk in a format, and return its row of the table; PolicyError if this is impossible."""
    from train.export.export import export

    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary) / f"{name}-{WALK}-{format_name}"
        result = export(policy, f"models/{name}/{WALK}", format_name, folder)
        data = zip_folder(folder)
    file = f"{folder.name}.zip"
    write_atomically(options.out / file, data)
    return {
        "file": f"[{file}]({options.url.rstrip('/')}/{file})" if options.url else file,
        "difference": f"{result.difference:.1e}",
        "size": f"{len(data) / 1024:.0f}",
        "digest": f"`{hashlib.sha256(data).hexdigest()}`",
    }


def zip_folder(folder: Path) -> bytes:
    """Return a ZIP file with the files of a folder, in the order of their names, under the name of the folder."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(each for each in folder.rglob("*") if each.is_file()):
            entry = zipfile.ZipInfo(f"{folder.name}/{file.relative_to(folder).as_posix()}", _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, file.read_bytes())
    return buffer.getvalue()
