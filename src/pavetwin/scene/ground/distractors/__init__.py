"""What lies on carriageways and is no defect: covers and grates, repairs, sealed cracks, stains."""
