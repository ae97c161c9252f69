"""Readers of policy specifications in files of other projects, and in this project's own TOML format."""

from policies.external.readers.detect import check_network_matches, read
from policies.external.readers.drafts import IncompleteSpecError, write_draft
from policies.external.readers.toml_file import write_toml

__all__ = ["IncompleteSpecError", "check_network_matches", "read", "write_draft", "write_toml"]
