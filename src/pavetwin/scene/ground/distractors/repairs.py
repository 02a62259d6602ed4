"""Repairs, sealed cracks, oil stains and tyre marks on a world's carriageways: distractors that are not defects.

Each segment draws its own from a child of the seed keyed by the segment, so that they stay when others change.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import shapely
from shapely import Polygon

from pavetwin.arrays import Float64Array
from pavetwin.scene.ground.distractors.crack_features import SlabCracks, lane_joints_cracked, patch_bars
from pavetwin.scene.ground.distractors.fixtures import Fixture, plugs
from pavetwin.scene.ground.distractors.patching import Patching, junction_repairs
from pavetwin.scene.ground.distractors.segment_marks import (
    SEAL_HALF_M,
    SEALED_GAPS,
    SEAM_HALF_M,
    Repairs,
    SegmentMarks,
    wander,
    wavering,
)
from pavetwin.scene.ground.layout.paved import PavedSurface
from pavetwin.scene.ground.layout.surfaces import SurfaceLayout
from pavetwin.scene.ground.styles import pavement
from pavetwin.scene.ground.styles.values import pick
from pavetwin.seeds import Stream, child
from pavetwin.world.model import Lane
from pavetwin.world.pavement_joints import joints_across, joints_along
from pavetwin.world.segments import polygons_of, surface_of

PUDDLES_M: Final = 28.0  # Mean distance along a street between marks of puddles, both sides together; ours
RUNNELS_M: Final = 90.0
"""Mean distance along a street between damp courses of water along a kerb, both sides together; ours."""

APART_TONE: Final = 0.06  # Lanes that were paved apart differ in reflectance by up to this share; ours
SEALED_APART: Final = 0.6  # Share of streets paved apart whose joint was sealed where it opened; ours
CLEAR_OF_JOINT_M: Final = 0.35
"""Sealed cracks along slabs keep this far from the joints: nearer ones end there, as corner breaks do. Ours."""

WHEELS_M: Final = 0.78
"""Half the track of a car."""


def repairs(plan: SurfaceLayout, fixtures: Sequence[Fixture]) -> Repairs:
    """The marks of all segments and lanes, and around manholes and gullies."""
    found = Repairs()
    for street in plan.streets:
        for segment in street.segments:
            _OnSegment(plan, street, segment, found).draw()
        for lane in street.lanes:
            _drips(plan, lane, found)
    for junction in plan.world.junctions:
        patches, lines = junction_repairs(plan, junction)
        found.patches += patches
        for number, line in enumerate(lines):
            draw = plan.chance(f"seal {junction.id} {number}")
            width = SEAL_HALF_M[0] + 0.6 * (SEAL_HALF_M[1] - SEAL_HALF_M[0]) * draw
            found.seal(plan, line, width, SEALED_GAPS[0] + (SEALED_GAPS[1] - SEALED_GAPS[0]) * draw)
    found.patches += patch_bars(plan)
    for fixture in fixtures:
        _around(plan, fixture, found)
    for patch, edges in plugs(plan):
        found.patches.append(patch)
        for line in edges:
            found.seal(plan, line, SEAM_HALF_M[1], SEALED_GAPS[0])
    return found


def _around(plan: SurfaceLayout, fixture: Fixture, found: Repairs) -> None:
    """Repairs and seals around a cover, and the damp around a grate."""
    rng = child(plan.seed, Stream.SCENE, 6, plan.name_hash(f"{fixture.x:.2f} {fixture.y:.2f}"))
    at = np.array([fixture.x, fixture.y])
    if fixture.model.startswith("grate"):
        for _ in range(3):
            x, y = at + rng.normal(0.0, 0.22, 2)
            found.spots.append((float(x), float(y), float(rng.uniform(0.06, 0.22)), float(rng.uniform(0.1, 0.35))))
    elif fixture.model in ("cover_iron", "cover_filled"):
        if rng.random() < 0.4:
            half = float(rng.uniform(0.48, 0.7))
            found.patches.append((fixture.x, fixture.y, fixture.yaw_rad, half, half, float(rng.uniform(0.68, 0.95))))
        if rng.random() < 0.6:
            turn = np.linspace(0.0, 2 * np.pi, 25)
            found.seals.append(at + 0.41 * np.column_stack([np.cos(turn), np.sin(turn)]))
            found.seal_halves_m.append(float(rng.uniform(*SEAM_HALF_M)))
            found.seal_gaps.append(0.15)


class _OnSegment(SegmentMarks):
    """The marks of one segment."""

    def draw(self) -> None:
        self._stretch()
        self._joint()
        self._slab_joints()
        rates = self.pavement.repairs
        for _ in range(self.count(self.plan.style.dirt.water * self.length / PUDDLES_M)):
            self._puddle()
        for _ in range(self.count(self.plan.style.dirt.water * self.length / RUNNELS_M)):
            self._runnel()
        Patching(self).draw()
        for _ in range(self.count(rates.sealed_cracks * self.cracked * self.length / 20)):
            self._crack_across()
        for _ in range(self.count(rates.sealed_cracks * self.cracked * self.length / 70)):
            self._crack_along()

    def _stretch(self) -> None:
        stretches = self.plan.style.stretches
        if self.length < 45 or self.rng.random() > stretches.share:
            return
        start = self.between(0.0, self.length * 0.6)
        end = min(self.length, start + self.between(18.0, self.length * 0.7))
        later = pavement(pick(stretches.pavements, float(self.rng.random())))
        reflectance = later.reflectance.at(later.age.at(self.between(0.0, 0.7)), float(self.rng.random()))
        surface = PavedSurface.of(later, reflectance, *(float(self.rng.random()) for _ in range(2)))
        self.found.stretches[self.segment.id] = [(start, end, surface)]
        for station in (start, end):
            if 2.0 < station < self.length - 2.0 and self.rng.random() < 0.7:
                self._across(station, 0.006, self.between(*SEAM_HALF_M))

    def _across(self, station: float, sway: float, half_m: float) -> None:
        ends = self.world([station, station], [-self.half + 0.05, self.half - 0.05])
        self.seal(wavering(self.rng, ends[0], ends[1], sway), half_m)

    def _joint(self) -> None:
        """The sealed joint between the paver's two passes, the same all along a street.

        Unsealed ones are not drawn: some millimetres are finer than the maps resolve, and would alias into dots.
        """
        name = self.street.name
        share = self.pavement.repairs.joint_share
        if self._paved_apart() or self.plan.chance(f"joint {name}") > share or self.length < 4.0:
            return
        left = 0.5 * self.plan.chance(f"beside {name}") - 0.25
        stations = np.arange(0.0, self.length, 0.45)
        self._seal_joint(self.world(stations, left + wander(self.rng, stations, 0.014)))

    def _seal_joint(self, line: Float64Array) -> None:
        half, worn = (
            low + (high - low) * self.plan.chance(f"joint's {what} {self.street.name}")
            for what, (low, high) in (("width", SEAM_HALF_M), ("wear", SEALED_GAPS))
        )
        self.found.seal(self.plan, line, half, worn)

    def _paved_apart(self) -> bool:
        """Lanes of slightly different tones, and the sealed joints between them where cracks opened along them; whether
        there are any."""
        lefts = lane_joints_cracked(self.plan, self.segment)
        if not lefts or self.pavement.slabs is not None:
            return False
        surface, polygon = self.plan.surface_of(self.street), self.segment.polygon
        ends = np.array([-1.0, self.length + 1.0])
        stations = np.unique(np.concatenate([ends, np.arange(0.0, self.length, 0.45)]))
        for number, left in enumerate(lefts):
            line = self.world(stations, left + wander(self.rng, stations, 0.008))
            if self.plan.chance(f"joint {self.street.name}") < SEALED_APART:
                self._seal_joint(line[1:-1])
            tone = 1.0 + (self.plan.chance(f"lane {self.street.name} {number}") - 0.5) * 2 * APART_TONE
            aside = Polygon([*line, *self.world(stations[::-1], np.full(len(stations), self.half + 2.0))])
            strip = surface_of(polygons_of(shapely.intersection(shapely.make_valid(aside), polygon)))
            self.found.lanes.setdefault(self.segment.id, []).append((strip, replace(surface, shade=tone)))
        return True

    def _puddle(self) -> None:
        """The damp that a puddle leaves: a few overlapping rounds, most of them along a kerb."""
        away = min(float(self.rng.exponential(0.6)) + 0.25, 2 * self.half - 0.3)
        left = (self.half - away) * float(self.rng.choice([-1.0, 1.0]))
        along, strength = self.between(0.0, self.length), self.between(0.12, 0.5)
        for _ in range(int(self.rng.integers(2, 7))):
            offset = self.rng.normal(0.0, (0.55, 0.14))
            x, y = self.world(along + offset[0], np.clip(left + offset[1], -self.half, self.half))
            self.found.spots.append((float(x), float(y), self.between(0.12, 0.5), strength))

    def _runnel(self) -> None:
        """The damp course of water that ran along a kerb."""
        reach, strength = self.between(3.0, 12.0), self.between(0.15, 0.45)
        side = float(self.rng.choice([-1.0, 1.0]))
        stations = np.arange(0.0, reach, 0.22) + self.between(0.0, max(0.1, self.length - reach))
        away = 0.2 + 0.10 * np.abs(wander(self.rng, stations, 0.6))
        widths = np.linspace(self.between(0.05, 0.1), self.between(0.14, 0.26), len(stations))
        inside = (stations > 0) & (stations < self.length)
        for (x, y), width in zip(self.world(stations, side * (self.half - away))[inside], widths[inside], strict=True):
            self.found.spots.append((float(x), float(y), float(width), strength))

    def _slab_joints(self) -> None:
        """Between slabs: across the carriageway, and along it between lanes."""
        slabs = self.pavement.slabs
        if slabs is None or self.length < slabs.every_m:
            return
        cracked = SlabCracks.of(self.plan, self.segment)
        across = np.linspace(-self.half - 0.3, self.half + 0.3, 2 + round(4 * self.half))
        for number, station in enumerate(cracked.across(joints_across(self.segment, slabs.every_m))):
            expands = slabs.expansion_every is not None and number % slabs.expansion_every == slabs.expansion_every // 2
            half_m = slabs.expansion_half_width_m if expands else slabs.half_width_m
            line = self.world(station + wander(self.rng, across, 0.004), across)
            self.found.seal(self.plan, line, half_m, slabs.lost)
        stations = np.arange(0.0, self.length, 0.9)
        for left in cracked.along(joints_along(self.segment)):
            line = self.world(stations, left + wander(self.rng, stations, 0.004))
            self.found.seal(self.plan, line, slabs.half_width_m, slabs.lost)

    def _crack_across(self) -> None:
        """A sealed crack across the carriageway or a part of it, irregular, with occasional offsets."""
        if self.length < 4.0:
            return
        low, high = -self.half + 0.1, self.half - 0.1
        if self.rng.random() < 0.5:
            low, high = (low, self.between(-0.5, 0.8)) if self.rng.random() < 0.5 else (self.between(-0.8, 0.5), high)
        steps = max(4, int((high - low) / 0.28))
        left = np.linspace(low, high, steps)
        along = self.between(2.0, self.length - 2.0) + np.cumsum(self.rng.normal(0.0, 0.07, steps))
        along = along + np.cumsum(self.rng.normal(0.0, 0.30, steps) * (self.rng.random(steps) < 0.08))
        self.seal(self.world(along, left), self.between(*SEAL_HALF_M))

    def _crack_along(self) -> None:
        reach = self.between(2.5, 16.0)
        steps = max(5, int(reach / 0.4))
        along = self.between(0.0, max(0.1, self.length - reach)) + np.linspace(0.0, reach, steps)
        left = self.between(-self.half + 0.8, self.half - 0.8) + np.cumsum(self.rng.normal(0.0, 0.045, steps))
        joints = np.empty(0) if self.pavement.slabs is None else joints_along(self.segment)
        beside = np.abs(left[:, None] - joints).min(axis=1, initial=np.inf) > CLEAR_OF_JOINT_M
        inside = (along < self.length) & (np.abs(left) < self.half - 0.5) & beside
        if inside.sum() > 3:
            self.seal(self.world(along[inside], left[inside]), self.between(*SEAL_HALF_M))


def _drips(plan: SurfaceLayout, lane: Lane, found: Repairs) -> None:
    """Oil along the middle of a lane, thickest where vehicles wait, and the marks of tyres that locked."""
    rng = child(plan.seed, Stream.SCENE, 3, plan.name_hash(lane.id))
    length = lane.length_m
    stations = list(rng.uniform(0.0, length, rng.poisson(plan.style.dirt.oil * length / 5.0)))
    stations += list(length - rng.exponential(6.0, rng.poisson(9.0 if length > 15 else 2.0)))
    for station in stations:
        if 0.5 < station < length:
            point = lane.centre_line.interpolate(station)
            radius = float(np.clip(rng.lognormal(-3.3, 0.6), 0.015, 0.16))
            x, y = np.array([point.x, point.y]) + rng.normal(0.0, 0.22, 2)
            found.spots.append((float(x), float(y), radius, float(rng.uniform(0.2, 0.75))))
    for _ in range(rng.poisson(plan.style.dirt.tyre_marks * length / 75)):
        found.skids += list(_skid(rng, lane))


def _skid(rng: np.random.Generator, lane: Lane) -> Iterator[tuple[Float64Array, float]]:
    """Both tyres' marks, one often fainter; most of them before the lane's end."""
    reach = float(rng.uniform(3.0, 11.0))
    end = lane.length_m - min(float(rng.exponential(12.0)), max(0.0, lane.length_m - reach - 0.1))
    if end - reach < 0.0:
        return
    stations = np.linspace(end - reach, end, 6)
    points = np.array([lane.centre_line.interpolate(station).coords[0] for station in stations])
    unit = (points[-1] - points[0]) / max(float(np.hypot(*(points[-1] - points[0]))), 1e-6)
    drift = np.linspace(0.0, float(rng.normal(0.0, 0.25)), 6)[:, None] + float(rng.normal(0.0, 0.2))
    for side in (-1.0, 1.0):
        yield points + np.array([-unit[1], unit[0]]) * (side * WHEELS_M + drift), float(rng.uniform(0.12, 0.45))
