"""Manual driving of a survey car: its motion, the drivable road, and what its camera sees."""
