"""Whether the damage that a population places is what its sources found."""
