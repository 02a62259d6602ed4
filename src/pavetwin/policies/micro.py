"""The policy that looks past an obstacle from a few metres aside."""

from math import cos, sin, tau

import numpy as np

from pavetwin.config.mission import PolicySettings
from pavetwin.policies.base import Action, Displace, GoOn, Pilot, Policy
from pavetwin.policies.registered import policy
from pavetwin.twin import Snapshot

DIRECTIONS = 16
RINGS = (1 / 3, 2 / 3, 1.0)
"""Radii of the candidates, as shares of `max_displacement_m`."""

LEAST_GAIN = 0.05
"""A displacement must be predicted to show at least this share of the hidden cells more than staying does."""

SHARE_DIGITS = 9
"""Shares that are the same to so many decimals are equal: they are of some hundred cells, and what differs less is the
last digits of floating-point numbers, which differ from processor to processor."""


@policy("micro")
class Micro(Policy):
    """One displacement δ, ‖δ‖ ≤ d_max: the candidate from which most of the hidden cells are predicted to be seen.

    Of equals the shortest is taken. It acts again in the same episode once a window's length further along the route,
    where other cells are hidden.
    """

    reads = frozenset({"max_displacement_m"})
    pilot = Pilot.NOBODY
    by_hand = (
        "The step aside is computed from the places of all vehicles around the drone, which a pilot does not know."
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
