"""The detections of a mission, each compared with the defects that are there."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import shapely

from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.detections import NO_DETECTIONS, Detections, Outcome
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.sensing import Frame, Sighting, match, unknown_class
from pavetwin.world.model import Defect


class DetectionLog:
    """The detections of a mission, judged capture by capture.

    A detection is matched by `pavetwin.sensing.match` to the defects in the image. It confirms a defect that the
    capture sees; it is a duplicate when that defect is confirmed already, in this capture or before; it is ignored
    when the capture does not see the defect that it matches (outside the inspection window, or too much of it hidden)
    and when it is an object of another class. Any other detection is a false alarm.
    """

    def __init__(
        self, environment: MissionEnvironment, *, sensor: str = "", other_classes: Collection[str] = ()
    ) -> None:
        """Args:
        sensor: name of the sensor, for messages.
        other_classes: classes that it reports besides defects.
        """
        self._defects = environment.defects
        self._sensor, self._other_classes = sensor, other_classes
        self._judged: list[_Judged] = []
        self._frames: dict[int, Frame] = {}
        self._listed, self._listed_count = NO_DETECTIONS, 0
        self._outcomes, self._counted = Counter[Outcome](), 0

    @property
    def all(self) -> Detections:
        """All detections in the order of time, with places on the ground and outcomes.

        The columns are made on request, since many missions only count outcomes.
        """
        if self._listed_count < len(self._judged):
            latest = [each.placed() for each in self._judged[self._listed_count :]]
            self._listed = Detections.concatenated([self._listed, *latest])
            self._listed_count = len(self._judged)
        return self._listed

    @property
    def frames(self) -> Mapping[int, Frame]:
        """The captures with detections, by index."""
        return MappingProxyType(self._frames)

    @property
    def outcomes(self) -> Counter[Outcome]:
        """Number of detections of each outcome."""
        for judged in self._judged[self._counted :]:
            self._outcomes.update(judged.outcome)
        self._counted = len(self._judged)
        return self._outcomes.copy()

    def latest(self) -> Detections:
        """The judged detections of the last capture that has any."""
        return self._judged[-1].placed() if self._judged else NO_DETECTIONS

    def judge(
        self,
        frame: Frame,
        detections: Detections,
        confirmed: Collection[int],
        *,
        segment: int,
        on_revisit: bool,
    ) -> list[int]:
        """Judge the detections of a capture. Returns the ids of the defects that it confirms.

        Args:
            confirmed: ids of the defects that are confirmed already.
            segment: index of the segment under inspection.

        Raises:
            PaveTwinError: a detection's class is not known.
        """
        if not len(detections):
            return []
        self._check(detections)
        if frame.source is not None:
            frame = replace(frame, source=None)
        judged = _Judged(frame, detections, segment, on_revisit)
        self._compare(judged, confirmed)
        self._judged.append(judged)
        self._frames[frame.number] = frame
        return [
            defect
            for outcome, defect in zip(judged.outcome, judged.defect, strict=True)
            if outcome is Outcome.CONFIRMED and defect is not None
        ]

    def _check(self, detections: Detections) -> None:
        unknown = {*detections.class_name} - self._classes
        for name in sorted(unknown):
            if message := unknown_class(name, self._classes, self._other_classes):
                raise PaveTwinError(f"The sensor '{self._sensor}' reports {message}.")

    def _compare(self, judged: "_Judged", confirmed: Collection[int]) -> None:
        """Set the outcome, the defect and its sighting of each detection."""
        frame, detections = judged.frame, judged.detections
        if "is_spurious" in detections.columns and detections.is_spurious.all():
            return
        seen = {(id(each.defect.polygon), each.defect.kind): each for each in frame.sightings}
        exact = [
            seen.pop((id(outline), name), None)
            for outline, name in zip(detections.footprint, detections.class_name, strict=True)
        ]
        if all(
            sighting is not None or spurious for sighting, spurious in zip(exact, detections.is_spurious, strict=True)
        ):
            # Outlines of defects that the capture sees, each reported once: nothing needs to be matched.
            for row, sighting in enumerate(exact):
                if sighting is not None:
                    defect = sighting.defect.id
                    outcome = Outcome.DUPLICATE if defect in confirmed else Outcome.CONFIRMED
                    judged.set(row, outcome, defect, sighting)
            return
        self._match(judged, confirmed)

    def _match(self, judged: "_Judged", confirmed: Collection[int]) -> None:
        frame, detections = judged.frame, judged.detections
        sightings = {sighting.defect.id: sighting for sighting in frame.sightings}
        candidates = self._candidates(frame)
        matches = match(frame, detections, candidates)
        new = set[int]()
        for row in np.flatnonzero(~detections.is_spurious).tolist():
            defect = candidates[matches.defect[row]].id if matches.defect[row] >= 0 else None
            sighting = None if defect is None else sightings.get(defect)
            is_known = defect in confirmed or defect in new
            outcome = self._outcome(
                detections.class_name[row],
                defect,
                sighting,
                is_known=is_known,
                is_first=bool(matches.is_first[row]),
            )
            if outcome is Outcome.CONFIRMED and defect is not None:
                new.add(defect)
            judged.set(row, outcome, defect, sighting)

    def _outcome(
        self, class_name: str, defect: int | None, sighting: Sighting | None, *, is_known: bool, is_first: bool
    ) -> Outcome:
        if class_name not in self._classes:
            return Outcome.IGNORED
        if defect is None:
            return Outcome.FALSE_ALARM
        if is_known:
            return Outcome.DUPLICATE
        if sighting is None:
            return Outcome.IGNORED
        return Outcome.CONFIRMED if is_first else Outcome.DUPLICATE  # the first of the frame may come later in the list

    @cached_property
    def _classes(self) -> frozenset[str]:
        return frozenset(DEFECT_CLASSES.names()) | {defect.kind for defect in self._defects}

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree([defect.polygon for defect in self._defects])

    def _candidates(self, frame: Frame) -> list[Defect]:
        """The defects in the image."""
        return [self._defects[index] for index in np.sort(self._tree.query(frame.footprint, "intersects"))]


@dataclass
class _Judged:
    """The detections of a capture and their judgement, a list entry a row."""

    frame: Frame
    detections: Detections
    segment: int
    on_revisit: bool
    outcome: list[Outcome] = field(init=False)
    defect: list[int | None] = field(init=False)
    sighting: list[Sighting | None] = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.detections)
        self.outcome = [Outcome.FALSE_ALARM] * count
        self.defect, self.sighting = [None] * count, [None] * count

    def set(self, row: int, outcome: Outcome, defect: int | None, sighting: Sighting | None) -> None:
        self.outcome[row], self.defect[row], self.sighting[row] = outcome, defect, sighting

    def placed(self) -> Detections:
        """The detections with their places on the ground and the columns of the judgement."""
        count, frame = len(self.detections), self.frame
        footprints = [
            self.frame.footprint_of(self.detections.box(row)) if outline is None else outline
            for row, outline in enumerate(self.detections.footprint)
        ]
        return self.detections.with_columns(
            footprint=footprints,
            capture=np.full(count, frame.number),
            time_s=np.full(count, frame.time_s),
            segment=np.full(count, self.segment),
            on_revisit=np.full(count, self.on_revisit),
            outcome=self.outcome,
            defect=[-1 if defect is None else defect for defect in self.defect],
            visible_fraction=[np.nan if each is None else each.visible_fraction for each in self.sighting],
            attempt=[0 if each is None else each.attempt + 1 for each in self.sighting],
        )
