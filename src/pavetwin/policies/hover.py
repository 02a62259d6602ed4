"""The policy that waits for the traffic to clear."""

from pavetwin.policies.base import Action, GoOn, Pilot, Policy, Wait
from pavetwin.policies.registered import policy
from pavetwin.twin import Snapshot


@policy("hover")
class Hover(Policy):
    """p_{t+1} = p_t for `wait_s`; looks again, and waits again, at most `max_wait_s` in one episode of occlusion."""

    reads = frozenset({"wait_s", "max_wait_s"})
    pilot = Pilot.OBSERVER
    by_hand = (
        "An observer sees on the live picture that the road is hidden and calls stop; the pilot pauses the "
        "plan until the road is clear."
    )

    def decide(self, snapshot: Snapshot) -> Action:
        if snapshot.occlusion is None:
            return GoOn()
        left_s = self.settings.max_wait_s - snapshot.occlusion.episode.waited_s
        return Wait(min(self.settings.wait_s, left_s)) if left_s > 1e-6 else GoOn()
