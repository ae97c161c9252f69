"""Functions that read the list of a leaderboard's policies, a TOML file, and find the policies' files.

The list names policies of this project, and published policies of other projects. An example is
docs/leaderboard/go1.toml. A file of a published policy is expected at FOLDER/OWNER/REPOSITORY/PATH, as in a clone of
its repository. A missing file can be downloaded.
"""

import hashlib
import http.client
import re
import sys
import tomllib
import urllib.parse
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from quad_env.cli.command_line import UsageError
from quad_env.cli.format import with_count
from quad_env.config import check_settings
from quad_env.files.reading import MAX_TEXT_SIZE, read_bytes
from quad_env.files.text import format_exception
from quad_env.files.writing import write_atomically

_SOURCE = re.compile(r"https://[\w.-]+(/[\w-][\w.-]*){2}")
"""Pattern of a repository URL: https://HOST/OWNER/REPOSITORY."""
_SHA256 = re.compile("[0-9a-f]{64}")
"""Pattern of a SHA-256 hash, 64 hexadecimal digits."""
_OUTSIDE = re.compile(r"[\\:]|^/|(^|/)\.\.(/|$)")
"""Pattern of a path that may point outside of its folder; policy lists with a match are refused."""
_DOWNLOAD_TIMEOUT = 60.0
"""Time without an answer of the server after which a download fails, s."""


@dataclass(frozen=True)
class PublishedPolicy:
    """Published policy of another project, which a leaderboard compares with policies of this project."""

    name: str
    """Name of the policy in the tables of the leaderboard."""
    source: str
    """URL of the repository on GitHub or Hugging Face that contains the policy."""
    revision: str
    """Hash of the repository's commit from which the files of the policy are taken."""
    policy: str
    """Path of the file that describes the policy: its network, observations and actions.

    The path is a key of `files`, or the path of a file in the folder of the policy list. A file in the folder of the
    list is copied into the folder of the first file in `files`."""
    files: Mapping[str, str]
    """Path of a file in the repository -> SHA-256 hash of the file, 64 hexadecimal digits."""

    def url(self, path: str) -> str:
        """Return the URL of the repository's file `path` at the commit `revision`."""
        raw = "resolve" if self.source.startswith("https://huggingface.co/") else "raw"
        return f"{self.source}/{raw}/{self.revision}/{urllib.parse.quote(path)}"

    def place(self, folder: Path, path: str) -> Path:
        """Return the local path of a file of the repository.

        Args:
            folder: Folder with the files of published policies.
            path: Path of the file in its repository.

        Returns:
            The path FOLDER/OWNER/REPOSITORY/PATH.
        """
        return folder.joinpath(*PurePosixPath(self.source).parts[-2:], path)


@dataclass(frozen=True)
class PolicyList:
    """List of the policies that a leaderboard compares on one robot, made by `read_list`."""

    robot: str
    """Name or path of the robot of all policies, as in the option `--robot` of `python -m evaluate`."""
    ours: Sequence[str]
    """Policies of this project, as in the option `--policies` of `python -m evaluate`.

    A policy may be followed by servo gains as in the option `--servo`, for example "trot at 35/0.5"."""
    published: tuple[PublishedPolicy, ...] = ()
    """Policies of other projects, with the sources of their files."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all policies in the list; the policies of this project come first."""
        return (*self.ours, *(policy.name for policy in self.published))


def read_list(path: Path) -> PolicyList:
    """Read and check a list of policies in a TOML file; raise UsageError if it is missing or invalid."""
    try:
        content = tomllib.loads(read_bytes(path).decode())
        published = tuple(PublishedPolicy(**entry) for entry in content.pop("published", ()))
        policy_list = PolicyList(**{"ours": ()} | content, published=published)
        for value in (policy_list, *published):
            check_settings(value)
        _check(policy_list)
    except (OSError, RecursionError, TypeError, ValueError) as error:
        keys = "robot, ours, and tables [[published]] of name, source, revision, policy and files"
        raise UsageError(f"{path} is no list of policies ({format_exception(error)}); a list has {keys}") from error
    return policy_list


def _check(policy_list: PolicyList) -> None:
    """Check a list of policies.

    Raises ValueError if the list is empty or has equal names, if a source or a hash is invalid, or if a path may point
    outside of its folder.
    """
    if not policy_list.names or len(set(policy_list.names)) < len(policy_list.names):
        raise ValueError("it names no policy, or one twice")
    for policy in policy_list.published:
        if not policy.files or any(map(_OUTSIDE.search, (policy.policy, *policy.files))):
            raise ValueError(f"{policy.name!r} has no files, or one that is not in its repository")
        if not _SOURCE.fullmatch(policy.source) or not all(map(_SHA256.fullmatch, policy.files.values())):
            raise ValueError(f"{policy.name!r} wants a source https://HOST/OWNER/REPOSITORY, SHA-256 of 64 digits")


def resolve_references(policy_list: PolicyList, file: Path, folder: Path, *, fetch: bool = False) -> dict[str, str]:
    """Find the files of all policies in a list, and check the hashes of the files.

    Args:
        policy_list: List of policies.
        file: File of the list.
        folder: Folder with the files of the published policies.
        fetch: True to download missing files. False to print their URLs on stderr and raise UsageError.

    Returns:
        Name of a policy -> name or file of the policy, as in the option `--policies` of `python -m evaluate`.

    Raises:
        UsageError: A file is missing or has another hash.
    """
    missing = [line for policy in policy_list.published for line in _missing(policy, folder, fetch=fetch)]
    for line in missing:
        print(line, file=sys.stderr)
    if missing:
        raise UsageError(f"{with_count(len(missing), 'file')} of {file} not in {folder}: get them, or give --fetch")
    references = {name: name for name in policy_list.ours}
    for policy in policy_list.published:
        references[policy.name] = str(_described(policy, file.parent, folder))
    return references


def _missing(published: PublishedPolicy, folder: Path, *, fetch: bool) -> Iterator[str]:
    """Check the files of a published policy, and yield a line of text for each missing file.

    Args:
        published: Published policy.
        folder: Folder with the files of the published policies.
        fetch: True to download missing files and yield nothing.

    Yields:
        Text about a missing file, with its URL and the path to which it must be downloaded.

    Raises:
        UsageError: A file has a wrong hash, or cannot be read or downloaded.
    """
    for path, sha256 in published.files.items():
        place = published.place(folder, path)
        url = published.url(path)
        if not place.exists() and not fetch:
            yield f"{published.name}: download {url} to {place}"
            continue
        try:
            _check_or_download(published, place, url, sha256)
        except (OSError, http.client.HTTPException) as error:
            raise UsageError(f"{published.name}: {error}; download {url} to {place}") from error


def _check_or_download(published: PublishedPolicy, place: Path, url: str, sha256: str) -> None:
    """Check the hash of a file of a published policy; download the file first if it is missing.

    Args:
        published: Published policy.
        place: Local path of the file.
        url: URL of the file.
        sha256: Expected SHA-256 hash, hexadecimal.

    Raises:
        UsageError: The file has another hash.
    """
    exists = place.exists()
    content = read_bytes(place) if exists else _fetched(url)
    digest = hashlib.sha256(content).hexdigest()
    if digest != sha256:
        mismatch = f"is not the file of {published.name}: its SHA-256 is {digest}, not {sha256}"
        raise UsageError(f"{place} {mismatch}; download {url} to it" if exists else f"{url} {mismatch}")
    if not exists:
        place.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(place, content)


def _fetched(url: str) -> bytes:
    """Download a URL and return its content; raise OSError if the content exceeds MAX_TEXT_SIZE bytes."""
    with urllib.request.urlopen(url, timeout=_DOWNLOAD_TIMEOUT) as reply:
        content: bytes = reply.read(MAX_TEXT_SIZE + 1)
    if len(content) > MAX_TEXT_SIZE:
        raise OSError(f"{url} is larger than {MAX_TEXT_SIZE // 2**20} MiB")
    return content


def _described(published: PublishedPolicy, lists: Path, folder: Path) -> Path:
    """Return the local path of the file that describes a published policy.

    If the repository of the policy has no description, the description in the folder of the policy list is copied to
    the policy's files.

    Args:
        published: Published policy.
        lists: Folder that contains the policy list, a TOML file.
        folder: Folder with the files of the published policies.

    Returns:
        Path of the description in `folder`.

    Raises:
        UsageError: The description cannot be copied.
    """
    if published.policy in published.files:
        return published.place(folder, published.policy)
    place = published.place(folder, next(iter(published.files))).with_name(Path(published.policy).name)
    try:
        write_atomically(place, read_bytes(lists / published.policy))
    except OSError as error:
        raise UsageError(f"{published.name}: its description cannot be copied to {place} ({error})") from error
    return place
