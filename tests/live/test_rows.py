"""Rows go through shared memory in order, over its end, and never over rows that nobody has taken."""

import multiprocessing

import pytest

from live.recording import rows
from live.recording.rows import Ring, memory


def test_rows_come_out_as_they_were_put_and_none_is_written_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "LENGTH", 5)
    shared = memory(multiprocessing.get_context("spawn"), width=2)
    writer, reader = Ring(shared), Ring(shared)
    taken: list[list[float]] = []
    for number in range(23):
        while (row := writer.free_row()) is None:
            assert writer.put - len(taken) == 5
            taken += [reader.take().tolist(), reader.take().tolist()]
        row[:] = number, -number
        writer.put_row()
    taken += [reader.take().tolist() for _ in range(writer.put - len(taken))]
    assert taken == [[number, -number] for number in range(23)]
