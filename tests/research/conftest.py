"""Fixtures of the evaluation that tests of research use too."""

from tests.evaluate.conftest import made_up_cell as made_up_cell
