"""Sun and sky: positions that almanacs give, light that adds up."""

import math
from datetime import UTC, date, datetime, time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pavetwin.config import Conditions
from pavetwin.errors import PaveTwinError
from pavetwin.scene.light import LUMINANCE, Light, harmonics, sun_position

heights = st.floats(1, 89)
covers = st.floats(0, 1)


@pytest.mark.parametrize(
    ("when", "latitude", "longitude", "elevation", "azimuth"),
    [
        # Meeus, Astronomical Algorithms, example 25.a: on 1992 October 13.0 TD the sun's declination is -7.78507°, its
        # right ascension 198.38083°; where it culminates south of Greenwich's north pole it stands that much lower.
        (datetime(1992, 10, 13, tzinfo=UTC), 90.0, 0.0, -7.785, None),
        # Noon of an equinox on the equator, and midsummer's noon on the tropic: the sun is overhead.
        (datetime(2024, 3, 20, 12, 7, tzinfo=UTC), 0.0, 0.0, 90.0, None),
        (datetime(2024, 6, 20, 12, 2, tzinfo=UTC), 23.44, 0.0, 90.0, None),
        # Midwinter in Berlin: low in the south.
        (datetime(2024, 12, 21, 11, 4, tzinfo=UTC), 52.52, 13.405, 90 - 52.52 - 23.44, 180.0),
    ],
)
def test_the_sun_stands_where_almanacs_put_it(
    when: datetime, latitude: float, longitude: float, elevation: float, azimuth: float | None
) -> None:
    seen = sun_position(when, latitude_deg=latitude, longitude_deg=longitude)
    assert seen[0] == pytest.approx(elevation, abs=0.5 if elevation == 90 else 0.02)
    assert azimuth is None or seen[1] == pytest.approx(azimuth, abs=0.5)


def test_the_morning_sun_is_in_the_east() -> None:
    morning, evening = (
        sun_position(datetime(2024, 3, 20, hour, tzinfo=UTC), latitude_deg=50, longitude_deg=0) for hour in (8, 16)
    )
    assert 90 < morning[1] < 180 < evening[1] < 270


def test_a_light_is_that_of_its_conditions() -> None:
    """At 30° east mean solar time is two hours ahead of UTC."""
    ours = Conditions(date=date(2024, 3, 20), time=time(10), clouds=0.4, turbidity=5.0)
    light = Light.of(ours, latitude_deg=50, longitude_deg=30)
    elevation, azimuth = sun_position(datetime(2024, 3, 20, 8, tzinfo=UTC), latitude_deg=50, longitude_deg=30)
    assert light == Light(elevation, azimuth, cloud_cover=0.4, turbidity=5.0)
    with pytest.raises(PaveTwinError, match="below the horizon"):
        Light.of(ours.model_copy(update={"time": time(1)}), latitude_deg=50, longitude_deg=30)


def test_a_moment_without_a_time_zone_is_refused() -> None:
    with pytest.raises(PaveTwinError, match="time zone"):
        sun_position(datetime(2024, 3, 20, 8), latitude_deg=50, longitude_deg=0)


@given(heights, covers)
def test_the_sky_lights_level_ground_with_what_it_states(height: float, cover: float) -> None:
    light = Light(height, 123.0, cover, enclosure=0.0)
    level = light.sky_irradiance.T @ harmonics(np.array([0.0, 0.0, 1.0]))
    assert level @ LUMINANCE == pytest.approx(light.sky_klux, rel=0.06)  # order 2 alone
    assert (light.sky(np.array([[0.3, 0.1, 0.7], [1, 0, 0], [0, -1, 0.01]])) > 0).all()


@given(heights)
def test_clouds_take_the_sun_and_whiten_the_sky(height: float) -> None:
    clear, half, overcast = (Light(height, 0.0, cover) for cover in (0.0, 0.5, 1.0))
    beams = [LUMINANCE @ light.sun_klux for light in (clear, half, overcast)]
    assert beams[0] > beams[1] > beams[2] == 0
    up = np.array([0.0, 0.0, 1.0])
    blue = [light.sky(up)[2] / light.sky(up)[0] for light in (clear, half, overcast)]
    assert blue[0] > blue[1] > blue[2] == pytest.approx(1)


def test_a_low_sun_is_redder() -> None:
    high, low = (Light(height, 0.0).sun_klux for height in (60.0, 5.0))
    assert low[0] / low[2] > 1.5 * high[0] / high[2]


def test_the_sun_points_where_its_azimuth_states() -> None:
    east = Light(30.0, 90.0).to_sun
    np.testing.assert_allclose(east, [math.cos(math.radians(30)), 0, 0.5], atol=1e-12)


@pytest.mark.parametrize(("height", "cover"), [(0.0, 0.0), (-3.0, 0.0), (40.0, 1.2)])
def test_light_that_cannot_be_is_refused(height: float, cover: float) -> None:
    with pytest.raises(ValueError, match=r"horizon|cloud"):
        Light(height, 0.0, cover)


def test_houses_warm_the_shade() -> None:
    up = harmonics(np.array([0.0, 0.0, 1.0]))
    open_sky, street = (Light(45.0, 0.0, enclosure=share).sky_irradiance.T @ up for share in (0.0, 0.4))
    assert street[2] / street[0] < 0.9 * open_sky[2] / open_sky[0]
