"""Check that no other distribution has installed a package `evaluate` into the same folder, as Hugging Face's does."""

from pathlib import Path

_FOLDER = Path(__file__).resolve().parents[1]
"""Folder that contains this package: a clone, or a folder `site-packages`."""


def check_distribution() -> None:
    """Check that this package has its folder to itself.

    Raises:
        ImportError: Another distribution has installed files of another package into the same folder.
    """
    if message := find_mixed_distribution():
        raise ImportError(message, name="evaluate")


def find_mixed_distribution() -> str | None:
    """Return a one-line message about another distribution `evaluate` in the same folder; None if there is none.

    pip has no way to declare that two distributions exclude each other, and installs one over the other.
    """
    # An installed distribution has a folder such as `evaluate-0.4.6.dist-info` (or `.egg-info`) next to its packages.
    other = next(_FOLDER.glob("evaluate-*-info"), None)
    if other is None:
        return None
    version = other.name.removeprefix("evaluate-").rpartition(".")[0]
    return (
        f"evaluate: simple-quad-bench and evaluate {version} (Hugging Face) have overwritten each other's files in "
        f"{_FOLDER}; valid: one of them per environment: pip uninstall evaluate, then "
        "pip install --force-reinstall --no-deps simple-quad-bench"
    )
