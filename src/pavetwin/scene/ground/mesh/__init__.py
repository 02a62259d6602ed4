"""A tile's ground as meshes, and the models of flush fixtures."""
