"""Stores the labels of a distillation in memory and in files, and draws minibatches of them.

A label has the inputs of the student's network and the correction of the teacher, for one robot in one control step.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.numpy import load as parse_safetensors
from safetensors.numpy import save as format_safetensors

from quad_env.cli.command_line import UsageError
from quad_env.files.reading import MAX_DATA_SIZE, read_bytes
from quad_env.files.writing import write_atomically
from train.residual_env import BoolArray, FloatArray

FOLDER = "labels"
"""Name of the subfolder of a run folder with the files of labels."""


@dataclass(frozen=True)
class LabelBlock:
    """Labels of n robots in the T control steps of one round of a distillation."""

    inputs: FloatArray
    """Inputs of the student's network, (T, n, k), with k inputs per robot."""
    corrections: FloatArray
    """Corrections of the teacher as fractions of the largest correction of each joint, from -1 to 1, (T, n, 12)."""
    is_valid: BoolArray
    """True for labels from which the student learns, (T, n); False shortly before a fall."""


class LabelStore:
    """Store of all labels of a distillation, one block for each round, in memory and in files.

    The files let a resumed run continue with all earlier labels.

    Args:
        folder: Folder of the run. The files are in its subfolder `FOLDER`.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / FOLDER
        self.blocks: list[LabelBlock] = []
        """Blocks of labels in memory, in the order of the rounds."""

    def load(self, rounds: int) -> None:
        """Load the labels of the first `rounds` rounds from their files.

        Raises UsageError if a file is missing or damaged.
        """
        for index in range(rounds):
            path = self._path(index)
            try:
                arrays = parse_safetensors(read_bytes(path, MAX_DATA_SIZE))
                self.blocks.append(LabelBlock(arrays["inputs"], arrays["corrections"], arrays["is_valid"]))
            except (OSError, SafetensorError, KeyError, ValueError) as error:
                raise UsageError(
                    f"the labels in {path} cannot be read ({error}): start again with another --out"
                ) from None

    def save_from(self, first_round: int) -> None:
        """Write the labels of the round with the index `first_round`, and of all later rounds, to files."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for index, block in enumerate(self.blocks[first_round:], first_round):
            write_atomically(self._path(index), format_safetensors(vars(block)))

    def sampler(self, minibatch: int, random: np.random.Generator) -> "LabelSampler":
        """Return a sampler of all valid labels so far, which draws `minibatch` labels at a time with `random`."""
        return LabelSampler(self.blocks, minibatch, random)

    def delete_files(self) -> None:
        """Delete all files of labels, which a finished run does not need any more."""
        for path in self._folder.glob("*.safetensors"):
            path.unlink()
        if self._folder.is_dir():
            self._folder.rmdir()

    def _path(self, index: int) -> Path:
        return self._folder / f"{index:05d}.safetensors"


class LabelSampler:
    """Draws random minibatches of valid labels, each label with the same probability.

    Args:
        blocks: Blocks of labels.
        minibatch: Number of labels in a minibatch.
        random: Random generator that selects the labels.
    """

    def __init__(self, blocks: list[LabelBlock], minibatch: int, random: np.random.Generator) -> None:
        self._blocks = blocks
        self._minibatch = minibatch
        self._random = random
        self._rows = [np.flatnonzero(block.is_valid) for block in blocks]
        self._ends = np.cumsum([len(rows) for rows in self._rows])

    def __len__(self) -> int:
        """Return the number of valid labels."""
        return int(self._ends[-1])

    def sample(self) -> tuple[FloatArray, FloatArray]:
        """Draw a random minibatch of valid labels.

        Returns:
            inputs: Inputs of the student's network, (minibatch, k), with k inputs per label.
            corrections: Corrections of the teacher as fractions of the largest correction, (minibatch, 12).
        """
        chosen = np.sort(self._random.integers(0, len(self), self._minibatch))
        block_of = np.searchsorted(self._ends, chosen, side="right")
        inputs: list[NDArray[np.float32]] = []
        corrections: list[NDArray[np.float32]] = []
        for index in np.unique(block_of):
            start = self._ends[index] - len(self._rows[index])
            rows = self._rows[index][chosen[block_of == index] - start]
            block = self._blocks[index]
            inputs.append(block.inputs.reshape(-1, block.inputs.shape[-1])[rows])
            corrections.append(block.corrections.reshape(-1, block.corrections.shape[-1])[rows])
        return np.concatenate(inputs), np.concatenate(corrections)
