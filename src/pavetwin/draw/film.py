"""The frames of an animation: a mission from above, with the view following the UAV through the traffic."""

from collections.abc import Iterator

import numpy as np
import shapely
from PIL import Image, ImageDraw

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.draw.frame import DefectMark, MapView, MissionState
from pavetwin.draw.ground_raster import GroundRaster
from pavetwin.draw.marks import DefectOutcome, footprint_m, rectangles, start_of_interest_s
from pavetwin.draw.mission_style import agent_group, font, write
from pavetwin.draw.readings import HEIGHT_PX, Readings
from pavetwin.draw.shadows import SeenSurface, columns_near, shadows
from pavetwin.draw.street_names import shown_label
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import window_m
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline, TimelineState
from pavetwin.twin import Place

WIDTH_M = 70.0
"""Least width of street in the view; more where the camera's footprint is wide."""

SIZE_PX = (896, 504)
"""Size of the view; the strip of readings is below it."""

SOFTNESS_S = 2.0
"""The view follows the UAV's path averaged over this time to either side, for a smooth motion."""

TRAIL_S = 20.0


class Film:
    def __init__(self, result: MissionResult, start_s: float | None, duration_s: float, speed: float, fps: int) -> None:
        self.result, self.speed, self.fps = result, speed, fps
        self.timeline = Timeline(result)
        start = start_of_interest_s(self.timeline) if start_s is None else start_s
        if not 0 <= start < result.duration_s:
            raise PaveTwinError(
                f"The animation cannot start at {start:g} s: the mission lasts {result.duration_s:.0f} s."
            )
        shown = min(duration_s, result.duration_s - start)
        self.times_s: Float64Array = start + np.arange(max(1, round(shown / speed * fps))) * speed / fps
        footprint = footprint_m(result)
        self.width_m = max(WIDTH_M, 2.2 * max(footprint))
        scale = SIZE_PX[0] / self.width_m
        ground = GroundRaster(result.environment.world, scale)
        self.view = MapView(ground, SIZE_PX, window_m(result.settings), footprint)
        self._readings = Readings(SIZE_PX[0], result.policy, result.settings.visibility.threshold)
        self._places = np.array([(d.centre.x, d.centre.y) for d in result.environment.defects]).reshape(-1, 2)
        centres = np.array([self.centre(time) for time in self.times_s])
        self._low, self._high = centres.min(axis=0) - self.width_m, centres.max(axis=0) + self.width_m
        self._seen: SeenSurface | None = None

    def __len__(self) -> int:
        return len(self.times_s)

    def __iter__(self) -> Iterator[Image.Image]:
        self.rewind()
        for time_s in self.times_s:
            yield self.frame(float(time_s))

    @property
    def size_px(self) -> tuple[int, int]:
        return SIZE_PX[0], SIZE_PX[1] + HEIGHT_PX

    def rewind(self) -> None:
        """Before a frame that is earlier than the last one drawn."""
        self._seen = None

    def frame(self, time_s: float) -> Image.Image:
        """The picture at a time of the mission. Times must not fall, or else `rewind`."""
        scene, image = self.scene(time_s), Image.new("RGB", self.size_px, style.PAPER)
        image.paste(self.view.draw(scene, self.centre(time_s)), (0, 0))
        self._captions(image, time_s)
        self._readings.draw(image, SIZE_PX[1], scene)
        return image

    def centre(self, time_s: float) -> Place:
        """The centre of the view: the UAV's position, averaged over time."""
        around = time_s + np.linspace(-SOFTNESS_S, SOFTNESS_S, 17)
        return self.timeline.interpolated("x_m", around).mean(), self.timeline.interpolated("y_m", around).mean()

    def scene(self, time_s: float) -> MissionState:
        """D_t at a time of the mission, as far as it can be seen."""
        state, centre = self.timeline.at(time_s), self.centre(time_s)
        agents = state.agents_near(centre, 0.6 * self.width_m)
        parked = columns_near(self.timeline.parked, centre, 0.6 * self.width_m)
        sizes = (agents[name].tolist() for name in ("length_m", "height_m", "is_pedestrian"))
        uav = state.uav
        hidden: shapely.Geometry = shapely.Polygon()
        if state.visibility is not None:
            east, north = uav.position
            window = shapely.Polygon(rectangles(east, north, uav.yaw_rad, *self.view.window_m))
            eye = (east, north, uav.altitude_m)
            dark = shapely.union_all([*shadows(agents, eye), *shadows(parked, eye)])
            hidden = shapely.intersection(window, dark)
        if self._seen is None:
            self._seen = SeenSurface(self.timeline, self._concerns)
        return MissionState(
            time_s=time_s,
            uav=uav,
            visibility=state.visibility,
            agents=agents,
            parked=parked,
            groups=list(map(agent_group, *sizes)),
            hidden=hidden,
            seen=self._seen.until(time_s),
            defects=self._defects(state, centre),
            trail=np.vstack([self.timeline.trail(time_s, TRAIL_S), uav.position]),
        )

    def _concerns(self, east_m: float, north_m: float) -> bool:
        place = np.array([east_m, north_m])
        return bool(np.all(place > self._low) and np.all(place < self._high))

    def _defects(self, state: TimelineState, centre: Place) -> list[DefectMark]:
        near = np.hypot(*(self._places - centre).T) < 0.6 * self.width_m

        def mark(defect: int) -> DefectMark:
            x, y = self._places[defect].tolist()
            if (confirmation := state.found.get(defect)) is None:
                return DefectMark((x, y), None)
            outcome = DefectOutcome.RECOVERED if confirmation.on_revisit else DefectOutcome.CONFIRMED
            return DefectMark((x, y), outcome, (state.time_s - confirmation.time_s) / self.speed)

        return [mark(defect) for defect in np.flatnonzero(near).tolist()]

    def _captions(self, image: Image.Image, time_s: float) -> None:
        """The street's name above, a scale bar and the rate of time below."""
        pen, world = ImageDraw.Draw(image), self.result.environment.world
        segment = self.timeline.at(time_s).segment
        name = world.name if segment is None else shown_label(world, segment, by_pillow=True)
        rim = {"stroke_width": 3, "stroke_fill": style.PAPER}
        write(pen, (12, 24), name, 15, bold=True, fill=style.INK, anchor="ls", **rim)
        length_m = style.nice_length_m(self.width_m / 6)
        left, bottom = 12, SIZE_PX[1] - 12
        right = left + round(length_m * self.view.ground.scale)
        pen.rectangle((left - 1, bottom - 5, right + 1, bottom + 1), fill=style.PAPER)
        pen.rectangle((left, bottom - 4, right, bottom), fill=style.INK)
        for xy, words, anchor in (
            ((left, bottom - 9), f"{length_m:g} m", "ls"),
            ((SIZE_PX[0] - 12, bottom), f"{self.speed:g} × real time", "rs"),
        ):
            pen.text(xy, words, fill=style.INK, font=font(12), anchor=anchor, stroke_width=2, stroke_fill=style.PAPER)
