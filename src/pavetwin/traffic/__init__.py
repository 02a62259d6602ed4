"""Traffic: demand, recording by SUMO, and the recorded trace.

Traffic does not react to the UAV, so it is recorded once and replayed everywhere.
"""
