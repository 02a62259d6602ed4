"""The report of a detector's evaluation: a page with tables, figures and pictures of the worst errors."""
