"""What surfaces are made of: detail textures, and the formula that shades them."""
