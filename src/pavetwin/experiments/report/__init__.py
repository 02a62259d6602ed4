"""The report of a study: one HTML page that opens offline, and its table as CSV, Markdown and LaTeX."""

from pavetwin.experiments.report.from_folder import gather_folder
from pavetwin.experiments.report.gather import gather
from pavetwin.experiments.report.study import Study
from pavetwin.experiments.report.write import write_report

__all__ = ["Study", "gather", "gather_folder", "write_report"]
