"""`python -m benchmarks.damage`: its arithmetic on made-up defects, and that what `survey` places is as its sources."""

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from benchmarks.damage import statistics as stats
from benchmarks.damage.placed import Placed, placed
from benchmarks.damage.sources import photographs
from shapely import Point

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
    assert stats.boxes_in_view(found, 5.0).tolist() == pytest.approx([3 / 4, 1 / 4, 0, 0, 0])
    assert stats.per_km(found, "pothole", by="town")["per_km"].to_list() == [40.0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three photographs: two boxes, one of them cut; a patch; nothing."""
    (tmp_path / "annotations" / "xmls").mkdir(parents=True)
    boxes = (
        BOX.format("D00", 100, 100, 130, 400) + BOX.format("D40", 480, 20, 511, 60),
        BOX.format("D20", 10, 10, 110, 60) + BOX.format("Repair", 1, 2, 3, 4),
        "",
    )
    for number, text in enumerate(boxes):
        (tmp_path / "annotations" / "xmls" / f"{number}.xml").write_text(f"<annotation>{text}</annotation>")
    return tmp_path


def test_boxes_of_photographs_are_read_with_what_their_border_cuts(folder: Path) -> None:
    seen = photographs(folder)
    assert seen.images == 3
    assert seen.boxes["kind"].to_list() == ["single_crack", "pothole", "crocodile_crack"]
    assert seen.boxes["cut"].to_list() == [False, True, False]
    sizes, cut = stats.photograph_sizes(seen.boxes, "single_crack")
    assert (sizes.tolist(), cut.tolist()) == ([pytest.approx(math.hypot(30, 300))], [False])
    assert stats.boxes_in_photographs(seen).tolist() == [0.5, 0.5, 0, 0, 0]
    with pytest.raises(PaveTwinError, match="annotations"):
        photographs(folder / "annotations")
