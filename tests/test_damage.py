"""`python -m benchmarks.damage`: its arithmetic on made-up defects, and that what `survey` places is as its sources."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import shapely
from benchmarks.damage import __main__ as command
from benchmarks.damage import statistics as stats
from benchmarks.damage.placed import Placed, placed
from benchmarks.damage.plot import save_plot
from benchmarks.damage.sources import Photographs, rdd2022, uav_pdd2023
from benchmarks.damage.widths import crack_widths
from PIL import Image
from shapely import Point

from pavetwin.defects import DefectOptions, place
from pavetwin.errors import PaveTwinError
from pavetwin.world.model import Defect, Segment, Severity

BOX = "<object><name>{}</name><bndbox><xmin>{}</xmin><ymin>{}</ymin><xmax>{}</xmax><ymax>{}</ymax></bndbox></object>"


def strip(number: int, street: str, length_m: float = 50.0, width_m: float = 7.0) -> Segment:
    """A street to the east."""
    line = shapely.LineString([(0, 20.0 * number), (length_m, 20.0 * number)])
    area = line.buffer(width_m / 2, cap_style="flat")
    return Segment(f"s{number:04d}", street, (f"e{number}",), line, area, width_m, 2)


def defect(
    kind: str, x: float, y: float, box: tuple[float, float], yaw_rad: float = 0.0, width_m: float = 0.01
) -> Defect:
    """One whose outline is a box of a length and a width, turned."""
    outline = shapely.affinity.rotate(
        shapely.box(-box[0] / 2, -box[1] / 2, box[0] / 2, box[1] / 2), yaw_rad, (0, 0), True
    )
    polygon = shapely.affinity.translate(outline, x, y)
    return Defect(
        id=0, segment="s0000", kind=kind, centre=Point(x, y), polygon=polygon, seed=0, yaw_rad=yaw_rad,
        severity=Severity.LOW, width_m=width_m, depth_m=0.05, length_m=box[0], volume_m3=0.0,
    )  # fmt: skip


def cracks_at(places: np.ndarray) -> Placed:
    """Cracks on one street of 200 m."""
    segment = strip(0, "a", 200.0)
    return placed([("t", [segment], [defect("single_crack", x, y, (0.2, 0.05)) for x, y in places.tolist()])])


def test_defects_are_measured_in_the_frame_of_their_street() -> None:
    found = [defect("single_crack", 10, 2.0, (2.0, 0.1)), defect("single_crack", 20, -1.0, (2.0, 0.1), -math.pi / 2)]
    rows = placed([("t", [strip(0, "a")], found)]).defects.to_dicts()
    assert [(row["station_m"], row["offset_m"]) for row in rows] == [(10.0, 2.0), (20.0, -1.0)]
    assert [row["turn_deg"] for row in rows] == pytest.approx([0.0, 90.0])
    assert [(row["along_m"], row["across_m"]) for row in rows] == [pytest.approx((2.0, 0.1)), pytest.approx((0.1, 2.0))]


def test_a_fit_knows_that_cut_boxes_are_larger_than_they_look() -> None:
    rng = np.random.default_rng(2)
    sizes = np.exp(rng.normal(math.log(150.0), 0.7, 3000))
    border = rng.uniform(100, 400, 3000)
    shown = np.minimum(sizes, border)
    fit = stats.fitted(shown, sizes > border)
    assert (fit.median, fit.sigma) == (pytest.approx(150, rel=0.06), pytest.approx(0.7, rel=0.08))
    assert stats.fitted(shown).median < 135


def test_pairs_are_as_at_random_or_closer() -> None:
    rng = np.random.default_rng(4)
    random = rng.uniform([0, -3.5], [200, 3.5], (900, 2))
    some = rng.uniform([0, 0, 0, 0], [200, 7, 200, 7], (200_000, 4))
    distances = np.hypot(some[:, 0] - some[:, 2], some[:, 1] - some[:, 3])
    close, *others, _ = stats.random_distances(200.0, 7.0, np.array([0.5, 3.0, 9.0, 10.0]))
    assert close == pytest.approx(math.pi * 0.5**2 / 1400, rel=0.05)
    assert others == pytest.approx([(distances < below).mean() for below in (3.0, 9.0)], rel=0.05)
    near = stats.pairs(cracks_at(random))
    assert near.on_streets[1:].tolist() == pytest.approx([1.0] * 19, abs=0.2)
    assert near.near == pytest.approx(near.near_random, rel=0.1)
    middles = np.repeat(rng.uniform([5, -2], [195, 2], (40, 2)), 10, axis=0)
    close = stats.pairs(cracks_at(middles + rng.normal(0, 0.5, middles.shape)))
    assert close.on_streets[1] > 5
    assert close.near > 2 * close.near_random


def test_cracks_in_wheel_paths_at_joints_and_at_edges_are_told_apart() -> None:
    lanes = stats.from_lane_centres(cracks_at(np.array([[5, 1.75 + 0.82], [9, -0.1], [15, 3.4]])))
    assert lanes["from_centre_m"].to_list() == pytest.approx([0.82, 1.65, 1.65])
    assert lanes["to_joint_m"].to_list() == pytest.approx([0.93, 0.1, 0.1])
    assert lanes["to_edge_m"].to_list() == pytest.approx([0.93, 3.4, 0.1])


def test_potholes_beside_networks_and_boxes_in_one_view_are_counted() -> None:
    damage = [
        defect("crocodile_crack", 10, 1.0, (2.0, 1.0)),
        defect("pothole", 11.6, 1.0, (0.4, 0.4)),
        defect("pothole", 30, 1.0, (0.4, 0.4)),
    ]
    found = placed([("t", [strip(0, "a", width_m=4.0)], damage)])
    assert stats.beside_networks(found) == 0.5
    assert stats.within_networks(found) == 0.0
    notched = [replace(damage[0], notch=((0.0, 0.0), (0.4, 0.0), (0.4, 0.4))), *damage[1:]]
    assert stats.within_networks(placed([("t", [strip(0, "a", width_m=4.0)], notched)])) == 0.5
    assert stats.boxes_in_view(found, 5.0).tolist() == pytest.approx([3 / 4, 1 / 4, 0, 0, 0])
    assert stats.per_km(found, "pothole", by="town")["per_km"].to_list() == [40.0]


@pytest.fixture(scope="module")
def rdd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs in the form of RDD2022: a crack, a network and a pothole in each, a second crack in the first half, a
    crack cut by the border in the first, and one without boxes."""
    folder, rng = tmp_path_factory.mktemp("rdd"), np.random.default_rng(3)
    for part in ("images", "annotations/xmls"):
        (folder / part).mkdir(parents=True)
    for number in range(13):
        boxes = []
        if number < 12:
            sides = np.exp(rng.normal(np.log([150, 120, 60]), 0.4)).round()
            boxes = [("D00", 240, 30, 270, 30 + sides[0]), ("D20", 20, 300, 20 + sides[1], 300 + sides[1] / 2)]
            boxes += [("D40", 380, 380, 380 + sides[2], 430), ("Repair", 1, 2, 3, 4)]
        boxes += [("D10", 300, 20, 400, 40)] * (number < 6) + [("D00", 480, 20, 511, 90)] * (number == 0)
        text = "".join(BOX.format(*box) for box in boxes)
        (folder / "annotations" / "xmls" / f"{number:03d}.xml").write_text(f"<annotation>{text}</annotation>")
        Image.fromarray(road(rng, 0.0)).save(folder / "images" / f"{number:03d}.jpg")
    return folder


def road(rng: np.random.Generator, crack_px: float) -> np.ndarray:
    """A photograph of pavement with an upright crack of a width at column 255."""
    grey = rng.normal(150, 4, (512, 512))
    grey[:, 255] *= 1 - 0.65 * crack_px
    return np.clip(grey, 0, 255).astype(np.uint8)


def test_boxes_of_photographs_are_read_with_what_their_border_cuts(rdd: Path, tmp_path: Path) -> None:
    seen = rdd2022(rdd)
    assert seen.images == 13
    assert dict(seen.boxes.group_by("kind").len().iter_rows()) == {
        "single_crack": 19, "crocodile_crack": 12, "pothole": 12
    }  # fmt: skip
    assert stats.touching_networks(seen) == (0, 12)
    wide = seen.boxes.with_columns(ymax=pl.when(kind="crocodile_crack").then(500.0).otherwise("ymax"))
    assert (
        stats.touching_networks(replace(seen, boxes=wide))[0]
        == (wide.filter(kind="crocodile_crack")["xmax"] > 380).sum()
    )
    assert seen.boxes.filter("cut")["xmin"].to_list() == [480.0]
    assert stats.boxes_in_photographs(seen).tolist() == pytest.approx([0, 0, 6 / 12, 5 / 12, 1 / 12])
    with pytest.raises(PaveTwinError, match="has no annotations/xmls"):
        rdd2022(tmp_path)
    with pytest.raises(PaveTwinError, match="UAV-PDD2023"):
        uav_pdd2023(tmp_path)


@pytest.mark.parametrize("crack_px", [0.0, 0.5, 0.9])
@pytest.mark.parametrize("pixel_m", [None, 0.01])
def test_the_width_of_a_crack_is_what_it_darkens(tmp_path: Path, crack_px: float, pixel_m: float | None) -> None:
    """Of clear cracks a little less: the darkness that noise alone would have is subtracted."""
    Image.fromarray(road(np.random.default_rng(1), crack_px)).save(tmp_path / "a.png")
    rows = [(str(tmp_path / "a.png"), "single_crack", 240.0, 40.0, 270.0, 440.0, False, pixel_m)]
    columns = ["image", "kind", "xmin", "ymin", "xmax", "ymax", "cut", "pixel_m"]
    boxes = pl.DataFrame(rows, schema=columns, orient="row")
    scale = pixel_m or 0.005
    width_m = pytest.approx(scale * crack_px, abs=scale * 0.17)
    assert crack_widths(Photographs("a", 1, boxes.cast({"pixel_m": pl.Float64}), 512), 0.005).tolist() == [width_m]


def test_only_photographs_of_known_resolution_tell_sizes(tmp_path: Path) -> None:
    (tmp_path / "annotations").mkdir()
    for name, side_px in (("sample_01_a", 100), ("sample_02_b", 200), ("sample_05_c", 400)):
        text = BOX.format("Pothole", 10, 10, 10 + side_px, 10 + side_px)
        (tmp_path / "annotations" / f"{name}_annotation.xml").write_text(f"<annotation>{text}</annotation>")
    seen, nothing = uav_pdd2023(tmp_path), placed([("t", [strip(0, "a")], [])])
    sizes_m, cut = stats.photographed(nothing, seen, "pothole")
    assert sizes_m.tolist() == pytest.approx([1.1, 1.56])
    assert not cut.any()
    assert stats.resolutions(nothing, seen) == "7.8 and 11.0 mm"


@pytest.fixture(scope="module")
def surveyed() -> Placed:
    """Ten streets of three segments."""
    streets = [strip(number, f"street {number // 3}") for number in range(30)]
    return placed([("t", streets, place(streets, 2, DefectOptions()))])


def test_a_survey_places_what_its_sources_found(surveyed: Placed) -> None:
    cracks, networks, potholes = stats.mix(surveyed)
    assert 0.80 < cracks < 0.95
    assert 0.03 < networks < 0.18
    assert 0.005 < potholes < 0.06
    along, across, _ = stats.directions(surveyed)
    assert 0.38 < along < 0.64
    assert 0.28 < across < 0.52
    diagonals, sides = (stats.fitted(stats.box_sizes(surveyed, kind)) for kind in ("single_crack", "crocodile_crack"))
    assert 1.15 < diagonals.median < 1.65
    assert 0.55 < diagonals.sigma < 0.9
    assert 0.75 < sides.median < 1.5
    assert 4.0 < 1000 * surveyed.of("single_crack")["width_m"].median() < 7.2  # type: ignore[operator]
    low, medium, high = stats.severities(surveyed, "single_crack")
    assert 0.08 < medium < 0.35
    assert high < 0.02
    assert low + medium + high == pytest.approx(1)
    near, lanes = stats.pairs(surveyed), stats.from_lane_centres(surveyed)
    assert near.near > 1.3 * near.near_random
    assert 0.35 < lanes["from_centre_m"].is_between(*stats.WHEEL_PATH_M).mean() < 0.7  # type: ignore[operator]
    streets = stats.per_km(surveyed)["per_km"].to_numpy()
    assert 0.4 < stats.fitted(streets[streets > 0]).sigma < 1.9


def test_the_command_prints_the_table(
    surveyed: Placed, rdd: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "towns", lambda *_: [])
    monkeypatch.setattr(command, "placed", lambda _: surveyed)
    assert command.main(["--rdd", str(rdd)]) == 0
    said = capsys.readouterr().out
    assert f"at {1000 * stats.pixel_m(surveyed, rdd2022(rdd)):.1f} mm a pixel" in said
    assert "| box of potholes, longer side: median, σ (number) | " in said
    assert "RDD2022 88 : 9.6 : 2.8; UAV-PDD2023 93 : 5.5 : 1.8" in said
    assert all(line.count("|") == 4 for line in said.splitlines() if line)
    assert command.main(["--rdd", str(tmp_path)]) == 2


@pytest.mark.slow
def test_the_distributions_are_drawn(surveyed: Placed, rdd: Path, tmp_path: Path) -> None:
    for number, seen in enumerate(([], [rdd2022(rdd)])):
        save_plot(surveyed, seen, tmp_path / f"{number}.png")
    with Image.open(tmp_path / "0.png") as alone, Image.open(tmp_path / "1.png") as both:
        assert alone.width == both.width > 1500
        assert alone.tobytes() != both.tobytes()
