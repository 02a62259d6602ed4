"""The scene of a world: meshes and maps, as values for any renderer."""
