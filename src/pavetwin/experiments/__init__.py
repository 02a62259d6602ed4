"""From one flight to a factorial study: designs, runs, the store, statistics and reports."""
