"""The detections of a mission, each compared with the defects that are there."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import shapely

from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.sensing import Detection, Frame, JudgedDetection, Outcome, Sighting, match, unknown_class
from pavetwin.world.model import Defect


class DetectionLog:
    """Judges what a sensor reports, capture by capture, and keeps it.

    A detection is matched by `pavetwin.sensing.match` to the defects in the image. It confirms a defect that the
    capture sees; it is a duplicate when that defect is confirmed already, in this capture or before; it is ignored
    when the capture does not see the defect that it matches (outside the inspection window, or too much of it hidden)
    and when it is an object of another class. What is left is a false alarm.
    """

    def __init__(
        self, environment: MissionEnvironment, *, sensor: str = "", other_classes: Collection[str] = ()
    ) -> None:
        """Args:
        sensor: its name, for messages.
        other_classes: what it reports that is not a defect.
        """
        self._defects = environment.defects
        self._sensor, self._other_classes = sensor, other_classes
        self.all: list[JudgedDetection] = []

    def judge(
        self,
        frame: Frame,
        detections: Sequence[Detection],
        confirmed: Collection[int],
        *,
        segment: int,
        on_revisit: bool,
    ) -> list[JudgedDetection]:
        """Args:
        confirmed: ids of the defects that are confirmed already.
        segment: index of the segment under inspection.

        Raises:
            PaveTwinError: a detection's class is not known.
        """
        if not detections:
            return []
        for kind in sorted({detection.kind for detection in detections} - self._classes):
            if unknown := unknown_class(kind, self._classes, self._other_classes):
                raise PaveTwinError(f"The sensor '{self._sensor}' reports {unknown}.")
        sightings = {sighting.defect.id: sighting for sighting in frame.sightings}
        outlines = {id(sighting.defect.polygon) for sighting in frame.sightings}
        candidates = self._candidates(
            frame, all(each.means_nothing or id(each.footprint) in outlines for each in detections)
        )
        if frame.source is not None:
            frame = replace(frame, source=None)
        new, judged = set[int](), []
        for detection, (index, is_first) in zip(detections, match(frame, detections, candidates), strict=True):
            defect = None if index is None else candidates[index].id
            sighting = None if defect is None else sightings.get(defect)
            is_known = defect in confirmed or defect in new
            outcome = self._outcome(detection, defect, sighting, is_known=is_known, is_first=is_first)
            if outcome is Outcome.CONFIRMED and defect is not None:
                new.add(defect)
            judged.append(
                JudgedDetection(
                    outcome=outcome,
                    detection=detection,
                    frame=frame,
                    defect=defect,
                    sighting=sighting,
                    segment=segment,
                    on_revisit=on_revisit,
                )
            )
        self.all += judged
        return judged

    def _outcome(
        self, detection: Detection, defect: int | None, sighting: Sighting | None, *, is_known: bool, is_first: bool
    ) -> Outcome:
        if detection.kind not in self._classes:
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

    def _candidates(self, frame: Frame, are_outlines: bool) -> list[Defect]:
        """The defects in the image; the sighted ones are enough where every detection is the outline of one."""
        if are_outlines:
            return [sighting.defect for sighting in frame.sightings]
        return [self._defects[index] for index in np.sort(self._tree.query(frame.footprint, "intersects"))]
