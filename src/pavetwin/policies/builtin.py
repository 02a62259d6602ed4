"""The policies that ship with PaveTwin: baseline, hover, micro and skip."""

from math import cos, sin, tau

import numpy as np

from pavetwin.config.mission import PolicySettings
from pavetwin.policies.policy import Action, Displace, GoOn, Pilot, Policy, Revisit, Wait
from pavetwin.policies.registered import policy
from pavetwin.twin import Snapshot

DIRECTIONS = 16
"""Number of directions of the candidates of `micro`."""

RINGS = (1 / 3, 2 / 3, 1.0)
"""Radii of the candidates, as shares of `max_displacement_m`."""

LEAST_GAIN = 0.05
"""A displacement must be predicted to show at least this share of the hidden cells more than staying does."""

SHARE_DIGITS = 9
"""Decimals to which shares are compared: they count some hundred cells, and smaller differences are floating-point
noise that varies with the processor."""


@policy("baseline")
class Baseline(Policy):
    """Fly on in any case."""

    reads = frozenset()
    pilot = Pilot.ANY
    by_hand = "The autopilot flies the plan without reacting to traffic."

    def decide(self, snapshot: Snapshot) -> Action:  # noqa: ARG002
        return GoOn()


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


@policy("micro")
class Micro(Policy):
    """One displacement δ, ‖δ‖ ≤ d_max: the candidate from which most of the hidden cells are predicted to be seen.

    The shortest of equal candidates is taken. It acts again in the same episode one window length further along the
    route, where other cells are hidden.
    """

    reads = frozenset({"max_displacement_m"})
    pilot = Pilot.NOBODY
    by_hand = (
        "The displacement is computed from the positions of all vehicles around the drone, which a pilot does not know."
    )

    def __init__(self, settings: PolicySettings) -> None:
        super().__init__(settings)
        ring = [(cos(tau * k / DIRECTIONS), sin(tau * k / DIRECTIONS)) for k in range(DIRECTIONS)]
        radii = [share * settings.max_displacement_m for share in RINGS]
        self.candidates = np.array([(0.0, 0.0)] + [(r * east, r * north) for r in radii for east, north in ring])

    def decide(self, snapshot: Snapshot) -> Action:
        occlusion = snapshot.occlusion
        if occlusion is None or occlusion.episode.since_displacement_m < snapshot.window_along_m:
            return GoOn()
        shares = np.round(snapshot.predict_visibility(self.candidates), SHARE_DIGITS)
        best = int(np.argmax(shares))  # the first of equals, and shorter ones come first
        if round(float(shares[best]) - max(float(shares[0]), 0.0), SHARE_DIGITS) < LEAST_GAIN:
            return GoOn()
        east, north = self.candidates[best]
        return Displace(float(east), float(north))


@policy("skip")
class Skip(Policy):
    """Note the place (none closer than `note_spacing_m`, at most one every `note_interval_s`) and fly on."""

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
