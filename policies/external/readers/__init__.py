"""Readers of policy specifications (`PolicySpec`) in other projects' files and this project's TOML.

A specification defines the joints, servo gains, actions and observation terms of an external policy.
"""

from policies.external.readers.detect import check_network_matches, read
from policies.external.readers.drafts import IncompleteSpecError, write_draft
from policies.external.readers.toml_file import write_toml

__all__ = ["IncompleteSpecError", "check_network_matches", "read", "write_draft", "write_toml"]
