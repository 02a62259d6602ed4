"""The camera database and a user's own cameras."""

from math import atan, degrees
from pathlib import Path

import pytest

from pavetwin.errors import PaveTwinError
from pavetwin.uav import find_camera
from pavetwin.uav.cameras import Camera


def refused(model: str) -> str:
    with pytest.raises(PaveTwinError) as caught:
        find_camera(model)
    reported = str(caught.value)
    assert "\n" not in reported
    return reported


def test_the_papers_camera_covers_60_degrees_along_the_track() -> None:
    camera = find_camera("paper")
    assert camera.image_px == (1270, 950)
    assert camera.fov_deg == pytest.approx(60.0)
    across, along = camera.footprint_m(10.0)
    assert along == pytest.approx(11.547, abs=1e-3)
    assert across == pytest.approx(15.437, abs=1e-3)


@pytest.mark.parametrize(("altitude_m", "millimetres"), [(6.0, 1.6), (10.0, 2.7), (15.0, 4.1)])
def test_the_ground_resolution_of_the_phantom_4_pro(altitude_m: float, millimetres: float) -> None:
    camera = find_camera("phantom4pro")
    assert 1000 * camera.footprint_m(altitude_m)[1] / camera.image_px[1] == pytest.approx(millimetres, abs=0.05)


@pytest.mark.parametrize(
    ("name", "sensor_mm", "focal_mm", "image_px", "shutter"),
    [
        ("phantom4", (6.17, 4.55), 3.61, (4000, 3000), "rolling"),
        ("phantom4pro", (13.2, 8.8), 8.8, (5472, 3648), "mechanical"),
        ("mavic3e", (17.3, 13.0), 12.3, (5280, 3956), "mechanical"),
    ],
)
def test_the_data_sheets(
    name: str, sensor_mm: tuple[float, float], focal_mm: float, image_px: tuple[int, int], shutter: str
) -> None:
    camera = find_camera(name)
    assert (camera.sensor_mm, camera.focal_length_mm) == (sensor_mm, focal_mm)
    assert (camera.image_px, camera.shutter) == (image_px, shutter)
    assert camera.fov_deg == pytest.approx(degrees(2 * atan(sensor_mm[1] / 2 / focal_mm)))
    across, along = camera.footprint_m(10.0)
    assert along == pytest.approx(10 * sensor_mm[1] / focal_mm)
    assert across == pytest.approx(10 * sensor_mm[0] / focal_mm, rel=0.02)  # square pixels
    assert camera.source


def test_an_unknown_camera_is_refused_with_the_nearest_name() -> None:
    assert "did you mean 'phantom4pro'?" in refused("phantom4prp")
    assert "paper" in refused("zzz")


OWN = """
mine: {title: Mine, image_px: [1000, 500], vertical_fov_deg: 40}
"""
TWO = OWN + "other: {title: Other, image_px: [100, 100], sensor_mm: [8, 6], focal_length_mm: 4}\n"


def test_a_users_own_camera_is_found_by_its_file(tmp_path: Path) -> None:
    one, two = tmp_path / "one.yaml", tmp_path / "two.yml"
    one.write_text(OWN, encoding="utf-8")
    two.write_text(TWO, encoding="utf-8")
    assert find_camera(str(one)).title == find_camera(f"{one}:mine").title == "Mine"
    assert find_camera(f"{two}:other").fov_deg == pytest.approx(degrees(2 * atan(6 / 8)))
    reported = refused(str(two))
    assert "mine, other" in reported
    assert f"{two}:NAME" in reported
    assert "mine" in refused(f"{one}:yours")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "expected a mapping"),
        ("{}", "holds no camera"),
        ("a: 3", "expected a mapping"),
        ("a: {", "not valid YAML"),
        ("a: {}\nb: {}\na: {}", "line 3: 'a' is given twice"),
        ("a: {title: x, image_px: [10, 10]}", "give either vertical_fov_deg or both"),
        ("a: {title: x, image_px: [10, 10], vertical_fov_deg: 60, sensor_mm: [8, 6], focal_length_mm: 4}", "either"),
        ("a: {title: x, image_px: [10, 10], vertical_fov_deg: 180}", "vertical_fov_deg"),
        ("a: {title: x, image_px: [10, 0], vertical_fov_deg: 60}", "image_px"),
        ("a: {title: x, image_px: [10, 10], vertical_fov_dge: 60}", "did you mean 'vertical_fov_deg'"),
        ("a: {title: x, image_px: [10, 10], vertical_fov_deg: 60, shutter: slow}", "shutter"),
    ],
)
def test_a_bad_camera_file_is_one_plain_line(text: str, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text, encoding="utf-8")
    reported = refused(str(path))
    assert complaint in reported
    assert "bad.yaml" in reported


def test_a_camera_file_that_cannot_be_read_is_one_plain_line(tmp_path: Path) -> None:
    assert "cannot read" in refused(str(tmp_path / "absent.yaml"))
    (tmp_path / "folder.yaml").mkdir()
    assert "cannot read" in refused(str(tmp_path / "folder.yaml"))
    (tmp_path / "latin.yaml").write_bytes("a: {title: caf\xe9}".encode("latin-1"))
    assert "latin.yaml" in refused(str(tmp_path / "latin.yaml"))
    (tmp_path / "zero.yaml").write_bytes(b"a: \x00")
    assert "zero.yaml" in refused(str(tmp_path / "zero.yaml"))


def test_the_camera_of_the_documentation_is_one(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "files.md").read_text(encoding="utf-8")
    section = page.partition("## A camera\n")[2]
    (tmp_path / "mine.yaml").write_text(section.partition("```yaml\n")[2].partition("```")[0], encoding="utf-8")
    assert find_camera(str(tmp_path / "mine.yaml:survey")).fov_deg == pytest.approx(find_camera("phantom4pro").fov_deg)
    assert [name for name in Camera.model_fields if name not in section] == []
