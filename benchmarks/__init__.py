"""The speed of PaveTwin on this machine, compared with the targets of the design: `python -m benchmarks`, or `make
bench`."""
