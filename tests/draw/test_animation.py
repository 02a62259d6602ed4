"""The animation: what a frame shows, and the files."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from pavetwin.draw import animation, mission_style, style
from pavetwin.draw.animation import SIZE_PX, Film, save_animation
from pavetwin.draw.animation_frame import SeenSurface, shadows
from pavetwin.draw.ground_raster import ASPHALT, GroundRaster
from pavetwin.draw.mission_marks import DefectOutcome, start_of_interest_s
from pavetwin.draw.mission_style import UAV, agent_group, rgb, visibility_rgb
from pavetwin.errors import PaveTwinError
from pavetwin.mission.timeline import Timeline
from pavetwin.traffic.kinds import VEHICLES
from scenes import tiny
from scenes.parking import EMPTY, FULL, full_street


def film_of(scene: str, policy: str, start_s: float | None = None, duration_s: float = 20.0) -> Film:
    return Film(tiny.result(scene, policy), start_s, duration_s, 4.0, 12)


def inspection_times(film: Film) -> list[float]:
    track = film.result.track
    return [float(time_s) for time_s in track["t_s"][np.isfinite(track["visibility"])]]


def test_the_uav_is_where_the_track_has_it() -> None:
    film = film_of("lively_street", "hover")
    for time_s in inspection_times(film)[3:40:9]:
        scene = film.scene(time_s)
        frame = film.frame(time_s)
        uav = np.subtract(film.view.ground.pixel(*scene.uav.position), film.view.corner_px(film.centre(time_s)))
        assert frame.getpixel((int(uav[0]), int(uav[1]))) == rgb(UAV)
        assert scene.uav.position[0] == pytest.approx(
            np.interp(time_s, film.result.track["t_s"], film.result.track["x_m"])
        )


def test_the_window_takes_the_colour_of_visibility() -> None:
    film = film_of("lively_street", "baseline")
    seen: set[tuple[int, int, int]] = set()
    for time_s in inspection_times(film)[1::6]:
        scene = film.scene(time_s)
        assert scene.visibility is not None
        colour = visibility_rgb(scene.visibility)
        pixels = np.asarray(film.frame(time_s))[: SIZE_PX[1]]
        assert (pixels == colour).all(axis=-1).sum() > 100
        seen.add(colour)
    assert len(seen) > 3


def test_nothing_is_under_a_window_in_transit() -> None:
    film = film_of("empty_street", "baseline")
    assert film.scene(0.5).visibility is None
    assert film.scene(0.5).hidden.is_empty


def test_defects_turn_from_open_to_confirmed() -> None:
    film = film_of("empty_street", "baseline")
    (time_s,) = film.result.detections.time_s
    before, after = (film.scene(time_s + shift).defects for shift in (-0.1, 0.1))
    assert [mark.outcome for mark in before] == [None]
    assert [mark.outcome for mark in after] == [DefectOutcome.CONFIRMED]
    assert after[0].age_s == pytest.approx(0.1 / film.speed)


def test_it_begins_shortly_before_the_first_reaction() -> None:
    result = tiny.result("car_that_leaves", "hover")
    film = film_of("car_that_leaves", "hover")
    assert 0 < result.actions[0].time_s - start_of_interest_s(film.timeline) <= 4.0
    assert film.times_s[0] == start_of_interest_s(film.timeline)
    assert start_of_interest_s(film_of("empty_street", "baseline").timeline) >= 0


def test_a_shadow_grows_with_the_agents_height() -> None:
    scene = tiny.truck_beside_defects()
    agents = scene.traffic().trace().agents_at(0.0)
    areas = [shapely.area(shadows(agents, (20.0, 0.0, height)))[0] for height in (100.0, 10.0, 5.0, 2.0)]
    assert areas == sorted(areas)
    assert areas[0] == pytest.approx(9.0 * 2.5, rel=0.15)


def test_the_seen_pavement_agrees_with_the_kernels_surface_coverage() -> None:
    for scene, policy in (("lively_street", "baseline"), ("queue_at_light", "micro"), ("truck_beside_defects", "skip")):
        result = tiny.result(scene, policy)
        seen = SeenSurface(Timeline(result)).until(result.duration_s)
        (row,) = result.rows
        assert shapely.area(seen) / row.area_m2 == pytest.approx(row.surface_coverage, abs=0.03)


def test_a_parked_car_is_drawn_and_the_pavement_behind_it_stays_unseen() -> None:
    scene = full_street()
    films = [Film(scene.fly("baseline", parked), None, 20.0, 4.0, 12) for parked in (FULL, EMPTY)]
    (row,) = films[0].result.rows
    seen = SeenSurface(films[0].timeline).until(films[0].result.duration_s)
    assert shapely.area(seen) / row.area_m2 == pytest.approx(row.surface_coverage, abs=0.03)
    time_s = inspection_times(films[0])[8]
    counts = []
    for film in films:
        colour = rgb(mission_style.AGENT_COLOURS["parked"])
        counts.append(int((np.asarray(film.frame(time_s))[: SIZE_PX[1]] == colour).all(axis=-1).sum()))
    assert counts[0] > 500
    assert counts[1] < 50
    assert films[0].scene(time_s).hidden.area > 1.0
    assert films[1].scene(time_s).hidden.is_empty


def test_every_kind_of_vehicle_falls_into_its_group() -> None:
    groups = {kind.name: agent_group(kind.length_m, kind.height_m, pedestrian=False) for kind in VEHICLES}
    assert groups == {
        "hatchback": "car",
        "compact": "car",
        "saloon": "car",
        "suv": "car",
        "van": "van",
        "light_truck": "truck",
        "heavy_truck": "truck",
        "bus": "bus",
        "motorcycle": "motorcycle",
    }
    assert set(groups.values()) < set(mission_style.AGENT_COLOURS)


def test_tiles_fit_together() -> None:
    raster = GroundRaster(tiny.bent(), 8.0)
    whole = np.asarray(raster.crop(-100, -300, (1100, 700)))
    part = np.asarray(raster.crop(350, -50, (200, 150)))
    assert (whole[250:400, 450:650] == part).all()
    left, top = raster.pixel(20.0, 1.0)
    assert raster.crop(left, top, (1, 1)).getpixel((0, 0)) == rgb(ASPHALT)


def test_the_gif_is_small_and_the_same_every_time(tmp_path: Path) -> None:
    result, told = tiny.result("lively_street", "hover"), list[float]()
    for name in ("one.gif", "two.gif"):
        save_animation(result, tmp_path / name, duration_s=12.0, on_progress=told.append)
    assert (tmp_path / "one.gif").read_bytes() == (tmp_path / "two.gif").read_bytes()
    assert (tmp_path / "one.gif").stat().st_size < 12 / 60 * 8_000_000
    assert told[-1] == 1.0
    with Image.open(tmp_path / "one.gif") as gif:
        assert gif.n_frames == 36  # type: ignore[attr-defined]
        lasts = 0
        for frame in range(36):
            gif.seek(frame)
            lasts += gif.info["duration"]
    assert lasts == 3000


def test_the_palette_keeps_the_colours_that_carry_meaning() -> None:
    film = film_of("car_that_leaves", "hover")
    colours = np.reshape(animation._palette(film).getpalette() or [], (-1, 3)).tolist()
    for colour in (UAV, *style.OUTCOME_COLOURS.values(), *mission_style.AGENT_COLOURS.values()):
        assert list(rgb(colour)) in colours
    assert list(visibility_rgb(0.0)) in colours
    assert list(visibility_rgb(1.0)) in colours


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("mission.avi", {}, r"\.gif or \.mp4"),
        ("mission.gif", {"duration_s": 0.0}, "positive"),
        ("mission.gif", {"speed": -1.0}, "positive"),
        ("mission.gif", {"fps": 0}, "frames a second"),
        ("mission.gif", {"start_s": 1e6}, "mission lasts"),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, name: str, options: dict[str, float], message: str) -> None:
    result = tiny.result("empty_street", "baseline")
    with pytest.raises(PaveTwinError, match=message):
        save_animation(result, tmp_path / name, **options)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


def test_mp4_without_ffmpeg_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    result = tiny.result("empty_street", "baseline")
    with pytest.raises(PaveTwinError, match=r"ffmpeg.*\.gif"):
        save_animation(result, tmp_path / "mission.mp4")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="the program ffmpeg is not installed")
def test_mp4_by_ffmpeg(tmp_path: Path) -> None:
    result = tiny.result("empty_street", "baseline")
    save_animation(result, tmp_path / "mission.mp4", duration_s=4.0)
    assert (tmp_path / "mission.mp4").read_bytes()[4:8] == b"ftyp"
