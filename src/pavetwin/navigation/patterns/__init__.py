"""How a segment is inspected: the passes flown along it. One file a pattern, one registry."""

from pavetwin.navigation.patterns.base import PATTERNS, Pass, Pattern, from_nearest_end, half_widths, passes, pattern

__all__ = ["PATTERNS", "Pass", "Pattern", "from_nearest_end", "half_widths", "passes", "pattern"]
