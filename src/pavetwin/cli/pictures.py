"""The pictures of missions whose numbers are written: maps, animations, labelled frames."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from pavetwin.cli.console import note_fonts, out, progress
from pavetwin.errors import PaveTwinError
from pavetwin.memory import give_back

if TYPE_CHECKING:
    from pavetwin.capture.mission_images import MissionImages
    from pavetwin.mission.result import MissionResult

MISSION_FILES = (
    "streets.csv, defects.gpkg, defects.csv, captures.geojson, "
    "mission.parquet, track.parquet, detections.parquet, mission.yaml"
)

SHEET = "detections.jpg"

Drawing = Callable[["MissionResult", Path], None]
"""Draws a mission into a file, whole or not at all."""


def draw(
    results: Sequence["MissionResult"],
    folder: Path,
    *,
    several: bool,
    maps: bool = True,
    animated: Callable[["MissionResult"], bool] = lambda _: False,
    frames: Drawing | None = None,
    sheet: Drawing | None = None,
    title: str = "Drawing",
) -> None:
    """Draw missions into the folder of their numbers.

    Args:
        several: there is a folder for each policy, and the maps have a comparison beside them.
        animated: whether a mission is shown moving as well.
        frames: takes the frames of a mission's captures; none are saved unless given.
        sheet: draws what the sensor found, missed and reported falsely.

    Raises:
        PaveTwinError: a picture failed; the first that did is named once all others are drawn.
    """
    drawings: list[tuple[str, Callable[[MissionResult], bool], Drawing]] = []
    if maps:
        drawings.append(("map.png", lambda _: True, partial(_draw_map, title)))
    drawings.append(("mission.gif", animated, partial(_draw_animation, title)))
    if frames is not None:
        drawings.append(("frames", lambda _: True, frames))
    if sheet is not None:
        drawings.append((SHEET, lambda _: True, sheet))
    failures: list[PaveTwinError] = []
    give_back()  # what recording traffic took; drawing takes as much
    for result in results:
        place = folder / result.policy if several else folder
        for name, wanted, drawing in drawings:
            if wanted(result):
                failures += _failures(partial(drawing, result), place / name)
    if several and maps:
        failures += _failures(partial(_draw_comparison, results), folder / "comparison.png")
    if failures:
        raise failures[0]


def drawing_sheet(images: "MissionImages") -> Drawing:
    """Draws the contact sheet of a mission whose sensor looked at images."""

    def draw_sheet(mission: "MissionResult", path: Path) -> None:
        from pavetwin.capture.sheets import save_mission_sheet
        from pavetwin.sensing import load_sensor

        with progress(f"Drawing what was found: {mission.policy}"):
            sensor = load_sensor(mission.settings.sensing, mission.seed)
            save_mission_sheet(mission, images, sensor, path)

    return draw_sheet


def taking_frames(images: "MissionImages", *, every: bool) -> Drawing:
    """Takes the frames of a mission's captures.

    Args:
        every: of all; else of those that confirmed a defect.

    Raises:
        PaveTwinError: there is no adapter to draw with.
    """
    from pavetwin.capture.mission_frames import save_frames
    from pavetwin.render.adapter import find_adapter

    adapter = str(find_adapter())

    def take(mission: "MissionResult", path: Path) -> None:
        with progress(f"Taking frames: {mission.policy}") as tell:
            save_frames(mission, images, path.parent, every=every, adapter=adapter, on_progress=tell)

    return take


def tell_files(
    results: Sequence["MissionResult"], folder: Path, *, maps: bool, animate: bool, frames: bool, sheet: bool = False
) -> None:
    """Print which files are where, and which package helps where a picture could not show names."""
    pictures = {"map.png": maps, "mission.gif": animate, "frames/": frames, SHEET: sheet}
    if any(pictures.values()):
        note_fonts(results[0].environment.world)
    each = ", ".join([*(name for name, drawn in pictures.items() if drawn), MISSION_FILES])
    if len(results) > 1:
        comparison = "comparison.png, " if maps else ""
        each = f"{comparison}mission.parquet, streets.csv, and a folder for each policy with {each}"
    out.print(f"Results in {folder}/: {each}", markup=False, soft_wrap=True)


def _draw_map(title: str, result: "MissionResult", path: Path) -> None:
    with progress(f"{title}: {result.policy}"):
        from pavetwin.draw.mission_map import save_mission_map

        save_mission_map(result, path)


def _draw_animation(title: str, result: "MissionResult", path: Path) -> None:
    from pavetwin.draw.animation import save_animation

    with progress(f"{title}: {result.policy}, moving") as tell:
        save_animation(result, path, on_progress=tell)


def _draw_comparison(results: Sequence["MissionResult"], path: Path) -> None:
    from pavetwin.draw.mission_map import save_comparison_map

    save_comparison_map(results, path)


def _failures(draw: Callable[[Path], None], path: Path) -> list[PaveTwinError]:
    """Draw one picture. Whatever is wrong with it must not cost the next one."""
    try:
        draw(path)
    except PaveTwinError as error:
        return [PaveTwinError(f"'{path}' was not drawn: {error} The numbers are in '{path.parent}'.")]
    except Exception as error:
        failure = PaveTwinError(
            f"'{path}' could not be drawn ({type(error).__name__}: {error}); the numbers are in '{path.parent}'. "
            "Please report this."
        )
        failure.__cause__ = error
        return [failure]
    return []
