"""An agent of your own: it answers every event of the mission's loop, and learns how long waiting is worth its time."""

import sys
from pathlib import Path

import pavetwin as pt


class Learner:
    """Waits below τ_o, and from episode to episode shifts its patience towards what was rewarded."""

    def __init__(self) -> None:
        self.patience_s, self.before = 4.0, 0.0

    def decide(self, snapshot: pt.Snapshot) -> pt.GoOn | pt.Wait:
        """The state is the snapshot: time, UAV, memory, visibility, agents. The answer is one of four actions."""
        assert snapshot.occlusion is not None
        waited_s = snapshot.occlusion.episode.waited_s
        return pt.Wait(1.0) if waited_s < self.patience_s else pt.GoOn()

    def learn(self, mission: pt.Mission) -> None:
        """The reward: defects found, less what the time costs."""
        reward = len(mission.memory.confirmed) - 0.02 * mission.duration_s
        self.patience_s = min(20.0, max(1.0, self.patience_s * (1.3 if reward > self.before else 0.8)))
        self.before = reward


folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/own_agent")
built = pt.add_defects(pt.build_world(Path(__file__).parent / "crossroads.osm"), pt.DefectOptions(per_segment=10))
world = pt.save_world(built, folder / "crossroads", force=True)
settings = pt.load_settings("default", altitude_m=10.0)
environment, traffic = pt.prepare(world, settings), pt.replay_of(world, "high", seed=1)
mission = pt.Mission(environment, traffic, settings, pt.choose_targets(environment, count=3, seed=1), policy="learner")
agent, sensor = Learner(), pt.load_sensor(settings.sensing, seed=1)

for event in mission:
    match event:
        case pt.Captured():
            if mission.confirm(sensor.detect(mission.frame(event))):
                agent.learn(mission)
        case pt.Occluded():
            mission.act(agent.decide(mission.snapshot(event)))
        case pt.BatteryLow():
            print(f"{mission.duration_s:.0f} s: back to the base for another battery")

print(f"found {pt.totals(mission).confirmed} of {pt.totals(mission).defects}, patience {agent.patience_s:.1f} s")
pt.save_mission(pt.result_of(mission), folder / "mission")
