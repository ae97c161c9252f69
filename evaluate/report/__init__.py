"""`report.html`: one page that opens offline, on a phone and in print; the outcome in words comes first."""

from evaluate.report.page import Origin, render, write_report

__all__ = ["Origin", "render", "write_report"]
