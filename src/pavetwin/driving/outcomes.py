"""What became of the defects of the segments that a drive saw: found, or missed and why."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from pavetwin.mission.inspected_defects import HIDDEN, MissReason

if TYPE_CHECKING:
    from pavetwin._core import DefectShares


@dataclass
class DefectLooks:
    """The captures with a defect's centre in them."""

    captures: int = 0
    visible: float = 0.0
    """The largest visible share of its area."""
    time_s: float | None = None
    """Of the first capture that showed so much."""
    _hidden: dict[MissReason, float] = field(default_factory=lambda: dict.fromkeys(HIDDEN, 0.0))

    def add(self, shares: "DefectShares", time_s: float) -> None:
        """One more capture."""
        self.captures += 1
        if self.time_s is None or shares["visible"] > self.visible:
            self.visible, self.time_s = shares["visible"], time_s
        for reason, column in HIDDEN.items():
            self._hidden[reason] += shares[column]  # type: ignore[literal-required]

    def hidden_by(self) -> dict[MissReason, float]:
        """What hid it: shares of its area, as means over the captures."""
        return {reason: share / self.captures for reason, share in self._hidden.items() if share}

    def reason(self, least_visible: float) -> MissReason:
        """Why it was missed.

        Args:
            least_visible: share that a capture must show of it, for a sensor to report it.
        """
        if not self.captures:
            return MissReason.OUTSIDE_SWATH
        if self.visible >= least_visible:
            return MissReason.NOT_RECOGNISED
        hidden = self.hidden_by()
        return max(hidden, key=lambda reason: hidden[reason])
