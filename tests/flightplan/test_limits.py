"""Limits that a user states."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pyogrio
import pytest
import shapely

from pavetwin.errors import PaveTwinError
from pavetwin.flightplan import FlightPlan, PlanLimits, PlannedFlight, Waypoint, check_limits
from pavetwin.world.georeference import anchored
from pavetwin.world.model import Building

PLACE = anchored(52.47, 13.44)

HOUSE = Building("b1", shapely.box(40, 6, 60, 20), 8.0)
WORLD: Any = SimpleNamespace(name="town", georeference=PLACE, buildings=(HOUSE,))


def plan(height_m: float = 10.0, y_m: float = 0.0) -> FlightPlan:
    """Along y = `y_m` from x = 0 to 100."""
    lonlat = PLACE.to_wgs84([(0.0, y_m), (100.0, y_m)])
    waypoints = [Waypoint(float(x), float(y), height_m, 5.0, False, 0.0, None) for x, y in lonlat]
    return FlightPlan("m", None, (PlannedFlight(tuple(waypoints)),), 0.7, 3.5)


def test_a_plan_within_its_limits_passes() -> None:
    check_limits(plan(), WORLD, PlanLimits(highest_m=10.0, from_buildings_m=6.0))


def test_height() -> None:
    with pytest.raises(PaveTwinError, match=r"^`highest` 9.5: flight 1 goes up to 10 m above take-off"):
        check_limits(plan(), WORLD, PlanLimits(highest_m=9.5))


@pytest.mark.parametrize(
    ("height_m", "y_m", "away_m"),
    [(5.0, 0.0, 6.0), (10.0, 0.0, np.hypot(6, 2)), (10.0, 10.0, 2.0), (5.0, 10.0, 0.0), (8.0, 30.0, 10.0)],
)
def test_distance_to_buildings_is_that_in_space(height_m: float, y_m: float, away_m: float) -> None:
    flown = plan(height_m, y_m)
    if away_m > 0:
        check_limits(flown, WORLD, PlanLimits(from_buildings_m=away_m - 0.05))
    with pytest.raises(PaveTwinError, match=rf"flight 1 comes as near as {away_m:.1f} m to the building 'b1' at 52.47"):
        check_limits(flown, WORLD, PlanLimits(from_buildings_m=away_m + 0.05))


def test_a_plan_through_a_building_is_refused_without_any_limit() -> None:
    with pytest.raises(PaveTwinError, match=r"as near as 0\.0 m"):
        check_limits(plan(5.0, 10.0), WORLD, PlanLimits())


@pytest.mark.parametrize(("x_m", "away_m"), [(39.0, 1.0), (50.0, 0.0)])
@pytest.mark.parametrize("backwards", [False, True])
def test_climb_and_landing_keep_the_distance_from_the_ground_up(x_m: float, away_m: float, backwards: bool) -> None:
    """High above the house of 8 m, from next to it or from within it, and the other way round."""
    lonlat = PLACE.to_wgs84([(x_m, 10.0), (x_m, 200.0)])[:: -1 if backwards else 1]
    waypoints = [Waypoint(float(x), float(y), 30.0, 5.0, False, 0.0, None) for x, y in lonlat]
    flown = FlightPlan("m", None, (PlannedFlight(tuple(waypoints)),), 0.7, 3.5)
    with pytest.raises(PaveTwinError, match=rf"climbs or lands as near as {away_m:.1f} m to .* another `base`"):
        check_limits(flown, WORLD, PlanLimits(from_buildings_m=10.0))
    if away_m > 0:
        check_limits(flown, WORLD, PlanLimits(from_buildings_m=0.9))
    else:
        with pytest.raises(PaveTwinError, match=r"as near as 0\.0 m"):
            check_limits(flown, WORLD, PlanLimits())


def zones(path: Path, *shapes: shapely.Geometry | None, crs: str = "EPSG:4326", named: bool = True) -> Path:
    names = np.array([f"zone {number}" if named else None for number, _ in enumerate(shapes)], dtype=object)
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array(shapes, dtype=object)),
        field_data=[names],
        fields=np.array(["name"], dtype=object),
        geometry_type="Unknown",
        crs=crs,
    )
    return path


@pytest.mark.parametrize("suffix", [".geojson", ".gpkg"])
def test_no_fly_zones(tmp_path: Path, suffix: str) -> None:
    def at(y_m: float) -> shapely.Geometry:
        return shapely.transform(shapely.box(30, y_m, 40, y_m + 5), PLACE.to_wgs84)

    check_limits(plan(), WORLD, PlanLimits(no_fly=zones(tmp_path / f"far{suffix}", at(1.0), at(-7.0))))
    with pytest.raises(PaveTwinError, match=r"^`no_fly` .*: flight 1 enters 'zone 1' at 52.47"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=zones(tmp_path / f"near{suffix}", at(1.0), at(-2.0))))


def test_no_fly_zones_in_another_system(tmp_path: Path) -> None:
    projected = shapely.transform(shapely.box(30, -2, 40, 3), PLACE.to_projected)
    path = zones(tmp_path / "utm.gpkg", projected, crs=f"EPSG:{PLACE.epsg}")
    with pytest.raises(PaveTwinError, match="enters 'zone 0'"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=path))


def zone(x_m: float, y_m: float) -> shapely.Geometry:
    return shapely.transform(shapely.box(x_m, y_m, x_m + 5, y_m + 5), PLACE.to_wgs84)


def test_polygons_in_collections_are_zones(tmp_path: Path) -> None:
    near = shapely.GeometryCollection([shapely.MultiPolygon([zone(0, 50)]), zone(30, -2)])
    with pytest.raises(PaveTwinError, match="enters 'zone 1'"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=zones(tmp_path / "z.geojson", zone(0, 50), near)))


def test_a_zone_without_a_name_has_a_number(tmp_path: Path) -> None:
    path = zones(tmp_path / "z.gpkg", zone(0, 50), zone(30, -2), named=False)
    with pytest.raises(PaveTwinError, match="enters feature 2 of 'z' at"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=path))


@pytest.mark.parametrize(
    ("shape", "holds"),
    [
        (shapely.Point(13.44, 52.47), r"\(Point\) is not made of polygons alone"),
        (shapely.GeometryCollection([zone(0, 50), shapely.Point(13.44, 52.47)]), r"\(GeometryCollection\) is not"),
        (None, "has no geometry"),
    ],
)
def test_a_zone_that_is_no_polygon_is_refused(tmp_path: Path, shape: shapely.Geometry | None, holds: str) -> None:
    path = zones(tmp_path / "z.geojson", zone(0, 50), shape)
    with pytest.raises(PaveTwinError, match=rf"^`no_fly` .*: feature 2 of 'z' {holds}"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=path))


def test_files_without_polygons_are_refused(tmp_path: Path) -> None:
    none = zones(tmp_path / "none.gpkg")
    with pytest.raises(PaveTwinError, match=r"^`no_fly` .*: it holds no polygon"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=none))
    text = tmp_path / "text.geojson"
    text.write_text("north of the river")
    pl.DataFrame({"x_m": [1.0]}).write_parquet(tmp_path / "track.parquet")
    for other in (text, tmp_path / "track.parquet"):
        with pytest.raises(PaveTwinError, match=r"^`no_fly` .*: not a file of polygons that GDAL reads\.$"):
            check_limits(plan(), WORLD, PlanLimits(no_fly=other))
    with pytest.raises(PaveTwinError, match=r"^`no_fly` .*: it is a folder"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=tmp_path))
    with pytest.raises(PaveTwinError, match=r"^`no_fly` .*: there is no such file"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=tmp_path / "gone.gpkg"))


def test_zones_that_are_not_where_the_flights_are_are_refused(tmp_path: Path) -> None:
    """Across the flight on the map that was meant; nothing would be checked against them."""
    across = shapely.box(30, -2, 40, 3)
    lonlat = shapely.transform(across, PLACE.to_wgs84)
    swapped = shapely.transform(lonlat, lambda xy: xy[:, ::-1])
    with pytest.raises(PaveTwinError, match=r"no zone lies within 20 km of the flights.* the other way round\.$"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=zones(tmp_path / "swapped.geojson", swapped)))
    elsewhere = shapely.transform(lonlat, lambda xy: xy + (0.0, 0.2))
    with pytest.raises(PaveTwinError, match=r"within 20 km of the flights, so nothing .*; check its coordinates"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=zones(tmp_path / "elsewhere.geojson", elsewhere)))
    near = shapely.transform(lonlat, lambda xy: xy + (0.25, 0.0))
    check_limits(plan(), WORLD, PlanLimits(no_fly=zones(tmp_path / "near.geojson", near, elsewhere, swapped)))


def test_zones_in_metres_that_say_that_they_are_degrees_are_refused(tmp_path: Path) -> None:
    metres = shapely.transform(shapely.box(30, -2, 40, 3), PLACE.to_projected)
    path = zones(tmp_path / "metres.geojson", zone(0, 50), metres)
    with pytest.raises(PaveTwinError, match=r"feature 2 of 'metres' has a corner at .*, which are not a longitude and"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=path))
    nowhere = shapely.Polygon([(13.44, 52.46), (float("inf"), 52.46), (13.45, 52.48)])
    with pytest.raises(PaveTwinError, match=r"feature 1 of 'nowhere' has a corner at inf, 52.46, which are no"):
        check_limits(plan(), WORLD, PlanLimits(no_fly=zones(tmp_path / "nowhere.gpkg", nowhere)))
