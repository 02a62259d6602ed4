"""HTML reports that open offline: their blocks, their figures, their page and the wording of numbers."""
