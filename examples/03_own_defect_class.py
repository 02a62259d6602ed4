"""A defect class of your own: rutting, from a plugin file. Placed, measured, and searched for by the UAV."""

import sys
from collections import Counter
from pathlib import Path

import pavetwin as pt
from pavetwin.defects import heightfield_of, measure

here = Path(__file__).parent
folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/own_defect_class")
pt.load_plugins([here / "rutting.py"])
options = pt.DefectOptions(per_segment=6, mix={"rutting": 1, "pothole": 1})
built = pt.add_defects(pt.build_world(here / "crossroads.osm"), options)
world = pt.save_world(built, folder / "crossroads", force=True)
print("placed:", dict(Counter(defect.kind for defect in world.defects)))
for defect in [each for each in world.defects if each.kind == "rutting"][:3]:
    sizes = measure(heightfield_of(defect))
    size = f"{sizes.extent_length_m:.1f} m x {sizes.extent_width_m:.1f} m, {sizes.depth_m * 1000:.0f} mm deep"
    print(f"  rutting {defect.id}: {size}, {defect.severity}")

spec = pt.plan_mission(world, pt.load_settings("default", altitude_m=10.0), density="medium", segments=4, seed=1)
result = pt.fly(spec)
kinds = {defect.id: defect.kind for defect in world.defects}
print("confirmed:", dict(Counter(kinds[defect] for defect in result.memory.confirmed)))
