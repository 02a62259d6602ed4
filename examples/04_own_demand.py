"""Traffic of your own: two flows written as a SUMO route file, recorded once, flown over by two policies."""

import sys
from pathlib import Path

import pavetwin as pt

FLOWS = """<routes>
  <vType id="truck" vClass="trailer" length="16.5" width="2.55" height="4"/>
  <flow id="eastward" type="truck" begin="0" end="1200" period="exp(0.15)" from="{west}" to="{east}"/>
  <flow id="westward" type="truck" begin="0" end="1200" period="exp(0.15)" from="-{east}" to="-{west}"/>
</routes>
"""

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/own_demand")
built = pt.add_defects(pt.build_world(Path(__file__).parent / "crossroads.osm"), pt.DefectOptions(per_segment=10))
world = pt.save_world(built, folder / "crossroads", force=True)
routes = folder / "trucks.rou.xml"
routes.write_text(FLOWS.format(west="102#0", east="102#1"), encoding="utf-8")

spec = pt.plan_mission(
    world,
    pt.load_settings("default", altitude_m=10.0),
    routes=[routes],
    take_off_s=120.0,  # at the first departure the streets are empty
    segments=[segment.id for segment in world.segments if segment.street == "West Street"],
    seed=1,
)
inputs = pt.load_inputs(spec)
for policy in ("baseline", "hover"):
    sums = pt.totals(pt.fly(spec.with_policy(policy), inputs=inputs))
    print(f"{policy}: coverage={sums.coverage:.3f}, {sums.wait_s:.0f} s waited")
