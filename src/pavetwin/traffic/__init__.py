"""What moves: demand, SUMO recording, the recorded trace.

Traffic does not react to the UAV, so it is recorded once and replayed everywhere.
"""
