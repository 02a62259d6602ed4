"""`python -m benchmarks.eyes`: the fitted sensor that ships, and the paper's study with a detector's eyes."""
