"""The detector in use: inference, tiles, sizes, results, and the server. Training is in `pavetwin.training`."""
