"""A UAV inspects eight segments of an invented town in dense traffic. Needs no download, no GPU, no display."""

import sys
from pathlib import Path

import pavetwin as pt

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/first_flight")
world = pt.save_world(pt.add_defects(pt.build_world("town", pt.BuildOptions(seed=1))), folder / "town", force=True)
traffic = pt.replay_of(world, "high", seed=1)
settings = pt.load_settings("default", altitude_m=10.0)
environment = pt.prepare(world, settings)
targets = pt.choose_targets(environment, count=8, seed=1)
result = pt.fly(environment, traffic, settings, targets, policy="hover", seed=1)
pt.save_mission(result, folder / "mission")
print(pt.totals(result))
