"""`report.html`: one page that opens offline, on a phone and in print; the outcome in words comes first."""
