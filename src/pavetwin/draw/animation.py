"""A mission as an animation, with the view following the UAV: GIF by Pillow, MP4 by ffmpeg."""

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import shapely
from PIL import Image, ImageDraw

from pavetwin.arrays import Float64Array
from pavetwin.draw import style
from pavetwin.draw.animation_frame import DefectMark, MapView, MissionState, SeenSurface, columns_near, shadows
from pavetwin.draw.fonts import shown_label
from pavetwin.draw.ground_raster import GroundRaster
from pavetwin.draw.mission_marks import DefectOutcome, footprint_m, rectangles, start_of_interest_s
from pavetwin.draw.mission_style import AGENT_COLOURS, OPEN_DEFECT, UAV, agent_group, font, rgb, visibility_rgb, write
from pavetwin.draw.readings import HEIGHT_PX, Readings
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.environment import window_m
from pavetwin.mission.result import MissionResult
from pavetwin.mission.timeline import Timeline, TimelineState
from pavetwin.twin import Place

WIDTH_M = 70.0  # Least width of street in the view; more where the camera's footprint is wide
SIZE_PX = (896, 504)  # Size of the view; the strip of readings is below it
SOFTNESS_S = 2.0  # The view follows the UAV's path averaged over this time to either side, for a smooth motion
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
        """The image at a time of the mission. Times must not fall, or else `rewind`."""
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


SAMPLES = 12  # Frames that the palette of a GIF is chosen from
COLOURS = 128  # Colours of a GIF's palette: fewer make a smaller file, but banding in translucent areas


def save_animation(
    result: MissionResult,
    path: Path,
    *,
    start_s: float | None = None,
    duration_s: float = 60.0,
    speed: float = 4.0,
    fps: int = 12,
    on_progress: Callable[[float], None] | None = None,
) -> None:
    """Write a part of a mission as a `.gif`, or as an `.mp4` where the program `ffmpeg` is installed.

    Args:
        start_s: mission time of the first frame; shortly before the policy's first reaction when not given.
        duration_s: how much mission time is shown; less where the mission ends before.
        speed: mission seconds per second of the animation.
        fps: frames per second.
        on_progress: called with the share done.

    Raises:
        PaveTwinError: a number does not fit, the suffix is another, ffmpeg is missing, or the file cannot be written.
    """
    kind = path.suffix.lower()
    if kind not in (".gif", ".mp4"):
        raise PaveTwinError(f"An animation cannot be written as '{path.name}'; end its name in .gif or .mp4.")
    if kind == ".mp4" and shutil.which("ffmpeg") is None:
        raise PaveTwinError(
            f"'{path.name}' needs the program ffmpeg (Debian: `apt-get install ffmpeg`); or end its name in .gif."
        )
    if not (duration_s > 0 and speed > 0 and 1 <= fps <= 50):
        raise PaveTwinError("An animation needs a positive duration and speed, and 1 to 50 frames a second.")
    film = Film(result, start_s, duration_s, speed, fps)
    save = _save_gif if kind == ".gif" else _save_mp4
    with writing(path) as temporary:
        save(temporary, film, on_progress or (lambda _: None))


def _save_gif(path: Path, film: Film, on_progress: Callable[[float], None]) -> None:
    palette = _palette(film)
    frames = []
    for number, frame in enumerate(film):
        frames.append(frame.quantize(palette=palette, dither=Image.Dither.NONE))
        on_progress((number + 1) / (len(film) + 1))
    ends_cs = np.round(np.arange(len(film) + 1) * 100 / film.fps).astype(int)
    lasts_ms = [10 * int(lasts) for lasts in np.diff(ends_cs)]
    first, *rest = frames
    first.save(path, "GIF", save_all=True, append_images=rest, duration=lasts_ms, loop=0, optimize=False)
    on_progress(1.0)


def _palette(film: Film) -> Image.Image:
    """One palette for all frames: colours that carry meaning are kept exactly, the others are taken from some
    frames."""
    meaning = [rgb(colour) for colour in (UAV, OPEN_DEFECT, style.PAPER, style.INK, style.INK_SOFT, style.CASING)]
    meaning += [rgb(colour) for colour in (*AGENT_COLOURS.values(), *style.OUTCOME_COLOURS.values())]
    meaning += [visibility_rgb(step / 20) for step in range(21)]
    meaning = list(dict.fromkeys(meaning))
    chosen = film.times_s[np.unique(np.linspace(0, len(film) - 1, SAMPLES).round().astype(int))]
    samples = [np.asarray(film.frame(float(time_s)))[::2, ::2] for time_s in chosen]
    film.rewind()
    found = Image.fromarray(np.concatenate(samples)).quantize(COLOURS - len(meaning), Image.Quantize.MEDIANCUT)
    colours = [part for colour in meaning for part in colour] + (found.getpalette() or [])
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours[: 3 * COLOURS])
    return palette


def _save_mp4(path: Path, film: Film, on_progress: Callable[[float], None]) -> None:
    width, height = film.size_px
    command = ["ffmpeg", "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
    command += ["-r", str(film.fps), "-i", "-", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-threads", "1"]
    command += ["-fflags", "+bitexact", "-flags:v", "+bitexact", "-map_metadata", "-1", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as ffmpeg:
        assert ffmpeg.stdin is not None
        assert ffmpeg.stderr is not None
        try:
            for number, frame in enumerate(film):
                ffmpeg.stdin.write(frame.tobytes())
                on_progress((number + 1) / len(film))
            ffmpeg.stdin.close()
        except BrokenPipeError:
            pass
        said = ffmpeg.stderr.read().decode(errors="replace").strip()
    if ffmpeg.returncode:
        raise PaveTwinError(f"ffmpeg could not write the animation: {said.splitlines()[-1] if said else 'no reason'}.")
