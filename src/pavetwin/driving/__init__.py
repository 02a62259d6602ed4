"""A survey car that somebody drives by hand: how it moves, where it may be, and what its camera sees of the road."""
