"""Judgement of a mission's detections by the defects of the world."""

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np
import shapely

from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import MissionEnvironment
from pavetwin.sensing import Detection, Frame, JudgedDetection, Outcome, Sighting, match, unknown_class
from pavetwin.world.model import Defect

_Judgement = tuple[Outcome, int | None, Sighting | None]
"""The outcome of a detection, the id of its defect, and the sighting of that defect."""


class DetectionLog:
    """Log of detections, judged capture by capture.

    `pavetwin.sensing.match` assigns detections to the defects in the image. A detection confirms a defect that the
    capture sees. It is a duplicate if the defect is confirmed already, in this capture or before. It is ignored if the
    capture does not see the matched defect (outside the inspection window, or too much of it hidden) or if it is an
    object of another class. All other detections are false alarms.
    """

    def __init__(
        self, environment: MissionEnvironment, *, sensor: str = "", other_classes: Collection[str] = ()
    ) -> None:
        """Args:
        sensor: name of the sensor, for messages.
        other_classes: classes that the sensor reports and that are not defects.
        """
        self._defects = environment.defects
        self._sensor, self._other_classes = sensor, other_classes
        self._batches: list[_Batch] = []
        self._listed: list[JudgedDetection] = []
        self._listed_batches = self._counted_batches = 0
        self._outcomes = Counter[Outcome]()

    @property
    def all(self) -> list[JudgedDetection]:
        """All detections in the order of time, created on request: many missions only count them."""
        self._listed += chain.from_iterable(map(_listed, self._batches[self._listed_batches :]))
        self._listed_batches = len(self._batches)
        return self._listed

    @property
    def outcomes(self) -> Counter[Outcome]:
        """Number of detections by outcome."""
        for batch in self._batches[self._counted_batches :]:
            self._outcomes.update(outcome for outcome, _, _ in batch.judged)
            self._outcomes[Outcome.FALSE_ALARM] += len(batch.detections) - len(batch.judged)
        self._counted_batches = len(self._batches)
        return self._outcomes.copy()

    def latest(self) -> list[JudgedDetection]:
        """Detections of the last capture with any."""
        return _listed(self._batches[-1]) if self._batches else []

    def judge(
        self,
        frame: Frame,
        detections: Sequence[Detection],
        confirmed: Collection[int],
        *,
        segment: int,
        on_revisit: bool,
    ) -> list[int]:
        """Judge the detections of a capture, and return the ids of the defects that it confirms.

        Args:
            confirmed: ids of the defects that are confirmed already.
            segment: index of the segment under inspection.

        Raises:
            PaveTwinError: a detection's class is not known.
        """
        if not detections:
            return []
        self._check(detections)
        if frame.source is not None:
            frame = replace(frame, source=None)
        places = [at for at, each in enumerate(detections) if not each.means_nothing]
        judged = self._judged(frame, [detections[at] for at in places], confirmed) if places else []
        self._batches.append(_Batch(frame, detections, segment, on_revisit, places, judged))
        return [defect for outcome, defect, _ in judged if outcome is Outcome.CONFIRMED and defect is not None]

    def _check(self, detections: Sequence[Detection]) -> None:
        kinds = {detection.kind for detection in detections}
        if kinds <= self._classes:
            return
        for kind in sorted(kinds - self._classes):
            if unknown := unknown_class(kind, self._classes, self._other_classes):
                raise PaveTwinError(f"The sensor '{self._sensor}' reports {unknown}.")

    def _judged(self, frame: Frame, detections: Sequence[Detection], confirmed: Collection[int]) -> "list[_Judgement]":
        """The judgement of each detection."""
        seen = {id(sighting.defect.polygon): sighting for sighting in frame.sightings}
        judged: list[_Judgement] = []
        for each in detections:
            sighting = seen.pop(id(each.footprint), None)
            if sighting is None or sighting.defect.kind != each.kind:
                return [*self._matched(frame, detections, confirmed)]
            # The outline of a defect that the capture sees, reported once: nothing needs to be matched.
            defect = sighting.defect.id
            judged.append((Outcome.DUPLICATE if defect in confirmed else Outcome.CONFIRMED, defect, sighting))
        return judged

    def _matched(
        self, frame: Frame, detections: Sequence[Detection], confirmed: Collection[int]
    ) -> "Iterator[_Judgement]":
        sightings = {sighting.defect.id: sighting for sighting in frame.sightings}
        outlines = {id(sighting.defect.polygon) for sighting in frame.sightings}
        candidates = self._candidates(frame, are_outlines=all(id(each.footprint) in outlines for each in detections))
        new = set[int]()
        for detection, (index, is_first) in zip(detections, match(frame, detections, candidates), strict=True):
            defect = None if index is None else candidates[index].id
            sighting = None if defect is None else sightings.get(defect)
            is_known = defect in confirmed or defect in new
            outcome = self._outcome(detection, defect, sighting, is_known=is_known, is_first=is_first)
            if outcome is Outcome.CONFIRMED and defect is not None:
                new.add(defect)
            yield outcome, defect, sighting

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

    def _candidates(self, frame: Frame, *, are_outlines: bool) -> list[Defect]:
        """The defects in the image; the sighted ones suffice if every detection is the outline of one."""
        if are_outlines:
            return [sighting.defect for sighting in frame.sightings]
        return [self._defects[index] for index in np.sort(self._tree.query(frame.footprint, "intersects"))]


class _Batch(NamedTuple):
    """The detections of a capture and their judgements."""

    frame: Frame
    detections: Sequence[Detection]
    segment: int
    on_revisit: bool
    places: Sequence[int]
    """Indices of the detections that are not deliberate false alarms."""
    judged: Sequence[_Judgement]
    """Judgements of the detections at `places`."""


def _listed(batch: _Batch) -> list[JudgedDetection]:
    judgements: list[_Judgement] = [(Outcome.FALSE_ALARM, None, None)] * len(batch.detections)
    for at, judgement in zip(batch.places, batch.judged, strict=True):
        judgements[at] = judgement
    return [
        JudgedDetection(outcome, detection, batch.frame, defect, sighting, batch.segment, batch.on_revisit)
        for detection, (outcome, defect, sighting) in zip(batch.detections, judgements, strict=True)
    ]
