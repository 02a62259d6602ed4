"""A UAV inspects eight segments of a generated town in dense traffic. Needs no download, no GPU, no display."""

import sys
from pathlib import Path

import pavetwin as pt

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/first_flight")
world = pt.save_world(pt.add_defects(pt.build_world("town", pt.BuildOptions(seed=1))), folder / "town", force=True)
settings = pt.load_settings("default", altitude_m=10.0)
spec = pt.plan_mission(world, settings, density="high", segments=8, policy="hover", seed=1)
result = pt.fly(spec)
pt.save_mission(result, folder / "mission")
print(pt.totals(result))
