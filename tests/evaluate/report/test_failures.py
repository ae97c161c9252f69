"""The report links the page of each failure, or shows the command that makes it."""

import re
from pathlib import Path

from evaluate.analysis import failures as analysis
from evaluate.report.sections.failures import render_failures
from tests.evaluate.report.test_report import Outline


def test_a_failure_has_a_link_where_its_page_is_and_the_command_that_makes_it_elsewhere(made, tmp_path: Path) -> None:
    named = [failure for _, failure in analysis.select_failures(made)]
    assert {(each.policy, each.axis) for each in named} == {
        ("trot", "push"),
        ("other", "push"),
        ("trot", "rough"),
        ("other", "rough"),
    }
    first = render_failures(made, tmp_path)
    assert Outline(first).references == []
    assert re.findall(r"<code>python -m evaluate replay \S+ (\d+) --page", first) == [str(each.row) for each in named]
    (tmp_path / "pages").mkdir()
    path = tmp_path / "pages" / named[1].page
    path.touch()
    then = render_failures(made, tmp_path)
    assert Outline(then).references == [f"pages/{path.name}"]
    assert then.count("<code>") == len(named) - 1
    assert then.count("<details") == 2
