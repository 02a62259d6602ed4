"""A mission as an animation: GIF by Pillow with one palette for all frames, MP4 by the program ffmpeg."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from pavetwin.draw import style
from pavetwin.draw.film import Film
from pavetwin.draw.mission_style import AGENT_COLOURS, OPEN_DEFECT, UAV, rgb, visibility_rgb
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.mission.result import MissionResult

SAMPLES = 12
"""Frames that the palette of a GIF is chosen from."""

COLOURS = 128
"""Colours of a GIF's palette: fewer make a smaller file, but banding in translucent areas."""


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
