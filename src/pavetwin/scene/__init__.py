"""The scene of a world: meshes and maps, as values that any renderer can draw."""
