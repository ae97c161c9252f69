"""Labels of a distillation: inputs of the student and corrections of the teacher, in memory and in a folder."""

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
"""Name of the folder of labels in a run folder."""


@dataclass(frozen=True)
class LabelBlock:
    """Labels of T control steps of n robots."""

    inputs: FloatArray
    """Inputs of the student's network, (T, n, k)."""
    corrections: FloatArray
    """Corrections of the teacher as fractions of the authority, (T, n, 12)."""
    is_valid: BoolArray
    """True for labels to learn from, (T, n)."""


class LabelStore:
    """All labels of a run, one block for each round.

    Args:
        folder: Folder of the run.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder / FOLDER
        self.blocks: list[LabelBlock] = []
        """Blocks in the order of the rounds."""

    def load(self, rounds: int) -> None:
        """Load the blocks of the first `rounds` rounds. Raises UsageError if one is missing or damaged."""
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
        """Write the blocks from the round with the index `first_round` to the folder."""
        self._folder.mkdir(parents=True, exist_ok=True)
        for index, block in enumerate(self.blocks[first_round:], first_round):
            write_atomically(self._path(index), format_safetensors(vars(block)))

    def sampler(self, minibatch: int, random: np.random.Generator) -> "LabelSampler":
        """Return a sampler of all valid labels so far; `minibatch` labels are drawn with `random`."""
        return LabelSampler(self.blocks, minibatch, random)

    def delete_files(self) -> None:
        """Delete the files of labels, after the last round."""
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
        minibatch: Labels of a minibatch.
        random: Random generator.
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
        """Draw a minibatch.

        Returns:
            inputs: Inputs of the network, (minibatch, k).
            corrections: Corrections of the teacher, (minibatch, 12).
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
