"""What makes a mission short."""

SHORT = ("--density", "low", "--segments", "2", "--seed", "1")
