"""How fast PaveTwin is on this machine, beside what the design asks for: `python -m benchmarks`, or `make bench`."""
