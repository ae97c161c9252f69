"""Files of a training run that an evaluation reads: settings and validations."""

import json
from pathlib import Path
from typing import Any

from quad_env.cli.command_line import UsageError
from quad_env.files.reading import read_bytes

SETTINGS_FILE = "config.json"
"""Name of the JSON file with the settings of a training run, in its folder."""
VALIDATIONS_FILE = "validations.json"
"""Name of the JSON file with all validations of a training run, and the number of steps at the best one."""


def load_settings(folder: Path) -> dict[str, Any]:
    """Load the settings of the training run in `folder` as a dictionary of JSON types.

    The settings are not checked, because older versions may have written other ones. Raises UsageError if the folder
    has no run or the file is damaged.
    """
    try:
        settings = json.loads(read_bytes(folder / SETTINGS_FILE))
    except OSError as error:
        problem = f"{SETTINGS_FILE} cannot be read ({error.strerror})"
        raise UsageError(f"no run in {folder}: {problem}; name the folder of a training run") from None
    except ValueError:
        settings = None
    if not isinstance(settings, dict):
        raise UsageError(f"no run in {folder}: {SETTINGS_FILE} is damaged; name the folder of a training run")
    return settings
