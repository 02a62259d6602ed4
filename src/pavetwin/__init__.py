"""PaveTwin: a digital twin for planning UAV pavement inspection over open traffic."""
