"""The mission's loop in Python: answer each event yourself, pause at a moment, look at the twin at any time."""

import sys
from pathlib import Path

import pavetwin as pt
from pavetwin.mission.events import DefectsConfirmed, MissionEvent
from pavetwin.mission.mission import Event


def tell(event: MissionEvent) -> None:
    """Told everything that happens, as it happens."""
    if isinstance(event, DefectsConfirmed):
        print(f"{event.time_s:6.1f} s  confirmed {len(event.defects)}")


folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/python_loop")
built = pt.add_defects(pt.build_world(Path(__file__).parent / "crossroads.osm"), pt.DefectOptions(per_segment=10))
world = pt.save_world(built, folder / "crossroads", force=True)
traffic = pt.replay_of(world, "high", seed=1)
settings = pt.load_settings("default", altitude_m=10.0)
environment = pt.prepare(world, settings)
policy, sensor = pt.load_policy("hover", settings.policy), pt.load_sensor(settings.sensing, 1)
mission = pt.Mission(environment, traffic, settings, [0], policy=policy.name, observer=tell)


def answer(event: Event) -> None:
    """Answer an event: the sensor reports what a capture shows, the policy reacts to an occlusion."""
    match event:
        case pt.Captured():
            mission.confirm(sensor.detect(mission.frame(event)))
        case pt.Occluded():
            mission.act(policy.decide(mission.snapshot(event)))


happened = mission.advance_until(20.0, answer)
print(f"paused at {mission.state().position}, battery {mission.state().battery:.3f}, after {len(happened)} events")
for event in mission:
    answer(event)
timeline = pt.Timeline(mission)
for time_s in (15.0, 30.0, timeline.duration_s):
    state = timeline.at(time_s)
    print(
        f"at {state.time_s:5.1f} s: {len(state.agents)} agents, {len(state.found)} found, {state.wait_s:.0f} s waited"
    )
