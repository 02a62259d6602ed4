"""The policy that notes a hidden place and comes back after the pass."""

from pavetwin.policies.base import Action, GoOn, Pilot, Policy, Revisit
from pavetwin.policies.registered import policy
from pavetwin.twin import Snapshot


@policy("skip")
class Skip(Policy):
    """Notes the place (none closer than `note_spacing_m`, at most one every `note_interval_s`) and goes on."""

    reads = frozenset({"note_spacing_m", "note_interval_s", "revisit_stay_s"})
    pilot = Pilot.OBSERVER
    by_hand = (
        "An observer sees on the live picture that the road is hidden and notes the place; the pilot comes "
        "back to it after the pass."
    )

    def decide(self, snapshot: Snapshot) -> Action:
        occlusion = snapshot.occlusion
        if occlusion is None or occlusion.hidden_place is None:
            return GoOn()
        last = snapshot.memory.last_note()
        if last is not None and snapshot.time_s - last.time_s < self.settings.note_interval_s:
            return GoOn()
        if snapshot.memory.noted_near(occlusion.hidden_place, self.settings.note_spacing_m):
            return GoOn()
        return Revisit(occlusion.hidden_place, stay_s=self.settings.revisit_stay_s)
