"""A policy of your own: it waits for moving traffic, and comes back later to what stands. Checked, then flown."""

import sys
from pathlib import Path

import pavetwin as pt
from pavetwin.policies import Action, GoOn, Policy, Revisit, Wait, check_policy
from pavetwin.twin import Snapshot


class Patient(Policy):
    """Waits for moving traffic, comes back later for what stands."""

    name = "patient"
    default_options = {"patience_s": 20.0}  # noqa: RUF012

    def decide(self, snapshot: Snapshot) -> Action:
        occlusion = snapshot.occlusion
        if occlusion is None or occlusion.hidden_place is None:
            return GoOn()
        x, y = occlusion.hidden_place
        near = [a for a in snapshot.agents if abs(a.position[0] - x) < 8 and abs(a.position[1] - y) < 8]
        moving = any(abs(a.velocity_mps[0]) + abs(a.velocity_mps[1]) > 0.5 for a in near)
        patience_s = min(self.options["patience_s"], self.settings.max_wait_s)
        if moving and occlusion.episode.waited_s + 1.0 <= patience_s:
            return Wait(1.0)
        if snapshot.memory.noted_near(occlusion.hidden_place, 3.0):
            return GoOn()
        return Revisit(occlusion.hidden_place)


if __name__ == "__main__":
    assert check_policy(Patient) == []
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/own_policy")
    built = pt.add_defects(pt.build_world(Path(__file__).parent / "crossroads.osm"), pt.DefectOptions(per_segment=10))
    world = pt.save_world(built, folder / "crossroads", force=True)
    settings = pt.load_settings("default", altitude_m=10.0)
    spec = pt.plan_mission(world, settings, density="high", segments=2, policy="baseline", seed=1)
    inputs = pt.load_inputs(spec)
    for policy in (Patient(settings.policy), None):
        result = pt.fly(spec, inputs=inputs, policy=policy)
        sums = pt.totals(result)
        print(f"{result.policy}: coverage={sums.coverage:.3f} in {sums.time_s:.0f} s")
