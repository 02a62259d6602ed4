"""`python -m benchmarks.effects`: how much each thing that the twin knows or assumes changes what it advises."""
