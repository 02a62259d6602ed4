"""The frames of an animation: a mission from above, the picture following the UAV through the traffic."""

from collections.abc import Iterator

import numpy as np
import shapely
from PIL import Image, ImageDraw

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.draw.frame import DefectMark, MapView, MissionState
from pavetwin.draw.ground_raster import GroundRaster
from pavetwin.draw.marks import Outcome, Place, doing, footprint_m, rectangles, telling_moment_s
from pavetwin.draw.mission_style import agent_group, font
from pavetwin.draw.readings import HEIGHT_PX, Readings
from pavetwin.draw.shadows import SeenSurface, shadows
from pavetwin.errors import PaveTwinError
from pavetwin.mission.environment import window_m
from pavetwin.mission.fly import MissionResult
from pavetwin.mission.mission import Traffic
from pavetwin.twin import Mode

WIDTH_M = 70.0
"""How much of the street the picture shows, at least; more where the camera's footprint is wide."""

SIZE_PX = (896, 504)
"""Of the view; the strip of readings comes below it."""

SOFTNESS_S = 2.0
"""The picture follows the UAV's path averaged over this much time to either side, so that it does not jerk."""

TRAIL_S = 20.0

_MODES = tuple(Mode)


class Film:
    """The frames of an animation, drawn on demand."""

    def __init__(
        self, result: MissionResult, traffic: Traffic, start_s: float | None, duration_s: float, speed: float, fps: int
    ) -> None:
        self.result, self.speed, self.fps = result, speed, fps
        start = telling_moment_s(result) if start_s is None else start_s
        if not 0 <= start < result.duration_s:
            raise PaveTwinError(
                f"The animation cannot start at {start:g} s: the mission lasts {result.duration_s:.0f} s."
            )
        shown = min(duration_s, result.duration_s - start)
        self.times_s: Float64Array = start + np.arange(max(1, round(shown / speed * fps))) * speed / fps
        self._track, self._trace = result.track, traffic.trace()
        footprint = footprint_m(result)
        self.width_m = max(WIDTH_M, 2.2 * max(footprint))
        scale = SIZE_PX[0] / self.width_m
        self.view = MapView(
            GroundRaster(result.environment.world, scale), SIZE_PX, window_m(result.settings), footprint
        )
        self._readings = Readings(SIZE_PX[0], result.policy, result.settings.visibility.threshold)
        self._confirmed = {detection.defect: detection for detection in reversed(result.detections)}
        self._places = np.array([(d.centre.x, d.centre.y) for d in result.environment.defects]).reshape(-1, 2)
        self._doing = doing(result)
        self._yaw = np.unwrap(self._track["yaw_rad"])
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
        """The middle of the picture: the UAV's place, averaged over a while."""
        around = time_s + np.linspace(-SOFTNESS_S, SOFTNESS_S, 17)
        return self._at(around, "x_m").mean(), self._at(around, "y_m").mean()

    def scene(self, time_s: float) -> MissionState:
        """D_t at a time of the mission, as far as it can be seen."""
        row = max(0, int(np.searchsorted(self._track["t_s"], time_s + 1e-9)) - 1)
        position = float(self._at(time_s, "x_m")), float(self._at(time_s, "y_m"))
        yaw = float(np.interp(time_s, self._track["t_s"], self._yaw))
        visibility = float(self._track["visibility"][row])
        centre = self.centre(time_s)
        agents = self._trace.agents_near(*centre, 0.6 * self.width_m, time_s)
        hidden: shapely.Geometry = shapely.Polygon()
        if np.isfinite(visibility) and len(agents["x_m"]):
            spots = (np.array([position[0]]), np.array([position[1]]), np.array([yaw]))
            window = shapely.Polygon(rectangles(*spots, *self.view.window_m)[0])
            dark = shapely.union_all(shadows(agents, (*position, float(self._at(time_s, "altitude_m")))))
            hidden = shapely.intersection(window, dark)
        if self._seen is None:
            self._seen = SeenSurface(self.result, self._trace, self._concerns)
        past = (self._track["t_s"] > time_s - TRAIL_S) & (self._track["t_s"] <= time_s)
        trail = np.column_stack([self._track["x_m"][past], self._track["y_m"][past]])
        return MissionState(
            time_s=time_s,
            position=position,
            altitude_m=float(self._at(time_s, "altitude_m")),
            yaw_rad=yaw,
            speed_mps=float(self._at(time_s, "speed_mps")),
            battery=float(self._at(time_s, "battery")),
            mode=_MODES[int(self._doing[row])],
            visibility=visibility if np.isfinite(visibility) else None,
            agents=agents,
            groups=[
                agent_group(float(length), float(height), pedestrian=bool(walks))
                for length, height, walks in zip(
                    agents["length_m"], agents["height_m"], agents["is_pedestrian"], strict=True
                )
            ],
            hidden=hidden,
            seen=self._seen.until(time_s),
            defects=self._defects(time_s, centre),
            trail=np.vstack([trail, position]),
        )

    def _at(self, time_s: float | Float64Array, column: str) -> Float64Array:
        return np.asarray(np.interp(time_s, self._track["t_s"], self._track[column]))  # type: ignore[literal-required]

    def _concerns(self, east_m: float, north_m: float) -> bool:
        place = np.array([east_m, north_m])
        return bool(np.all(place > self._low) and np.all(place < self._high))

    def _defects(self, time_s: float, centre: Place) -> list[DefectMark]:
        marks = []
        near = np.hypot(*(self._places - centre).T) < 0.6 * self.width_m
        for defect in np.flatnonzero(near):
            place = float(self._places[defect, 0]), float(self._places[defect, 1])
            detection = self._confirmed.get(int(defect))
            if detection is None or detection.time_s > time_s:
                marks.append(DefectMark(place, None))
            else:
                outcome = Outcome.RECOVERED if detection.on_revisit else Outcome.CONFIRMED
                marks.append(DefectMark(place, outcome, (time_s - detection.time_s) / self.speed))
        return marks

    def _captions(self, image: Image.Image, time_s: float) -> None:
        """The street's name above, a scale bar and the rate of time below."""
        pen, face = ImageDraw.Draw(image), font(15, bold=True)
        row = max(0, int(np.searchsorted(self._track["t_s"], time_s + 1e-9)) - 1)
        segment = int(self._track["segment"][row])
        world = self.result.environment.world
        name = f"{world.segments[segment].street} · {world.segments[segment].id}" if segment >= 0 else world.name
        pen.text((12, 24), name, fill=style.INK, font=face, anchor="ls", stroke_width=3, stroke_fill=style.PAPER)
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
