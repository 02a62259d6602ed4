"""The policy that never reacts."""

from pavetwin.policies.base import Action, GoOn, Policy
from pavetwin.policies.registered import policy
from pavetwin.twin import Snapshot


@policy("baseline")
class Baseline(Policy):
    """Flies on whatever it sees."""

    reads = frozenset()

    def decide(self, snapshot: Snapshot) -> Action:  # noqa: ARG002
        return GoOn()
