"""Where the ground's surfaces lie: streets, kerbs, gutters, sidewalks, ways across junctions, heights."""
