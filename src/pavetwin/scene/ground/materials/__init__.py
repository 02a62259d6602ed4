"""Materials of surfaces: detail textures, and the formula that shades them."""
