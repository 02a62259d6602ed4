"""The figures of a report. Each takes what was computed and draws it."""
