"""The report of a study: one HTML page that opens offline, and its table as CSV, Markdown and LaTeX."""
