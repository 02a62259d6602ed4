"""Road markings: standards, and their placement."""
