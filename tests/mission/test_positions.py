"""The WGS 84 positions of results, projected back, lie where the mission flew and where the defects are."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from pyproj import Transformer

from pavetwin.config import load_settings
from pavetwin.mission import choose_targets, fly_over, prepare, replay_of
from pavetwin.mission.result import MissionResult
from pavetwin.mission.saving import detections_geojson, track_table
from pavetwin.world.store import load_world, save_world
from scenes import damaged


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> MissionResult:
    folder = tmp_path_factory.mktemp("positions") / "cross"
    save_world(damaged("cross", 14), folder)
    world, settings = load_world(folder), load_settings()
    environment = prepare(world, settings)
    return fly_over(
        environment, replay_of(world, "low", 1), settings, choose_targets(environment, count=2, seed=1), seed=1
    )


def in_world(result: MissionResult, longitude: object, latitude: object) -> tuple[np.ndarray, np.ndarray]:
    """World coordinates by the EPSG code and the offset in `world.yaml`, without the code that made the positions."""
    place = result.environment.world.georeference
    back = Transformer.from_crs("EPSG:4326", f"EPSG:{place.epsg}", always_xy=True)
    east, north = back.transform(np.asarray(longitude), np.asarray(latitude))
    return east - place.offset_east_m, north - place.offset_north_m


def test_the_track_lies_where_it_was_flown(result: MissionResult, tmp_path: Path) -> None:
    track_table(result).write_parquet(tmp_path / "track.parquet")
    track = pl.read_parquet(tmp_path / "track.parquet")
    x, y = in_world(result, track["longitude"], track["latitude"])
    np.testing.assert_allclose(x, track["x_m"], atol=0.01)
    np.testing.assert_allclose(y, track["y_m"], atol=0.01)
    assert np.ptp(track["x_m"].to_numpy()) > 10


def test_a_finding_lies_on_its_defect_and_its_camera_above_the_window(result: MissionResult) -> None:
    features = detections_geojson(result)["features"]
    assert len(features) > 10
    x, y = in_world(result, *np.array([feature["geometry"]["coordinates"] for feature in features]).T)
    centres = np.array(
        [
            (result.environment.defects[it["id"]].centre.x, result.environment.defects[it["id"]].centre.y)
            for it in features
        ]
    )
    np.testing.assert_allclose(np.column_stack([x, y]), centres, atol=0.01)
    cameras = [(it["properties"]["camera_longitude"], it["properties"]["camera_latitude"]) for it in features]
    camera_x, camera_y = in_world(result, *np.array(cameras).T)
    positions = np.array([result.log.frames[capture].position for capture in result.detections.capture.tolist()])
    np.testing.assert_allclose(np.column_stack([camera_x, camera_y]), positions, atol=0.01)
    assert np.hypot(camera_x - x, camera_y - y).max() < 10
