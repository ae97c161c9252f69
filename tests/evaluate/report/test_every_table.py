"""Every cell of every table of the page has the numbers of results.json that its heading names."""

import pytest

from tests.evaluate.report.expected_cells import Report, wrong

SECTIONS = (
    *("ranking", "best-and-worst", "effort", "breaking-points"),
    *("axis-flat", "axis-push", "axis-rough", "how-it-was-measured"),
)
"""Sections with tables of numbers."""


@pytest.fixture(scope="module")
def report(four) -> Report:
    return Report(four)


def test_the_sections_with_figures_are_known(report) -> None:
    found = {table.section for table in report.tables}
    assert found - {"worst-and-most-typical-failures"} == set(SECTIONS)


@pytest.mark.parametrize("section", SECTIONS)
def test_every_cell_is_the_figure_that_its_heading_names(report, section: str) -> None:
    tables = [table for table in report.tables if table.section == section]
    assert [line for table in tables for line in wrong(report, table)] == []
