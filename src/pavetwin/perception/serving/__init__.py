"""The detector behind HTTP: `pavetwin serve`."""
