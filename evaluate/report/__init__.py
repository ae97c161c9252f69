"""`report.html`: one page that opens offline, on a phone and in print; what every policy succeeds in comes first."""
