"""Objects on carriageways that are not defects: covers and grates, repairs, sealed cracks, stains."""
