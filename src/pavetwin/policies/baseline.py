"""The policy that never reacts."""

from pavetwin.policies.base import Action, GoOn, Pilot, Policy
from pavetwin.policies.registered import policy
from pavetwin.twin import Snapshot


@policy("baseline")
class Baseline(Policy):
    """Flies on whatever it sees."""

    reads = frozenset()
    pilot = Pilot.ANY
    by_hand = "The autopilot flies the plan as it is; nobody reacts to the traffic."

    def decide(self, snapshot: Snapshot) -> Action:  # noqa: ARG002
        return GoOn()
