"""Distillations that are interrupted, and the comparison of their policies with those of another run."""

from pathlib import Path

import pytest

from train.distillation.run import Distillation
from train.run_folder import BEST, LAST


def stop_at_round(patch: pytest.MonkeyPatch, number: int) -> None:
    """Let a distillation end as by Ctrl-C at the start of a round."""
    run_round = Distillation._run_round

    def stop(run: Distillation, index: int) -> None:
        if index == number:
            raise KeyboardInterrupt
        run_round(run, index)

    patch.setattr(Distillation, "_run_round", stop)


def assert_same_policies(folder: Path, other: Path) -> None:
    """Fail unless the policies of two runs have the same bits."""
    for name in (BEST, LAST):
        file = f"{name}/policy.safetensors"
        assert (folder / file).read_bytes() == (other / file).read_bytes()
