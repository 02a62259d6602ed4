"""What the sensor makes of light: noise, blur of motion, falling off to the corners, rows read one after another."""

import gc
from dataclasses import replace
from math import hypot, pi

import numpy as np
import pytest
import wgpu

from pavetwin.render.frame import Exposure, meter, programme
from pavetwin.render.sensor import ImageProcessing, stored_image
from pavetwin.render.tile_cache import TileCache
from pavetwin.scene.light import Light, harmonics
from pavetwin.scene.view import View, look
from pavetwin.uav.cameras import Development, find_camera
from scenes.stage import Box, plane_renderer

LIGHT = Light(45.0, 180.0)
CAMERA = find_camera("phantom4pro")
ROLLING = find_camera("phantom4")
PLAIN = ImageProcessing(contrast=1.0, saturation=1.0, adaptation=0.0, sharpening=0.0, blur_px=0.0, vignetting=0.0)
PLAIN = replace(PLAIN, from_mosaic=False)
"""Nothing but light and electrons."""

LIGHTS = (LIGHT, Light(20.0, 90.0, cloud_cover=0.4))

ABOVE = look((0, 0, 10), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=(240, 160), vertical_fov_rad=1.0)


CROP = look((0, 0, 10), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=(240, 160), vertical_fov_rad=0.0436)
"""The middle of the sensor at its own resolution: pixels of 2.4 µm."""


def of(
    luminance: float, *, iso: float = 100.0, seed: int = 0, style: ImageProcessing = PLAIN, light_share: float = 0.2
):
    """The image of an even luminance; the shutter is such that 1 kcd/m² fills the given share at every ISO."""
    shutter = light_share / Exposure(1.0, 4.0, iso).share_per_light
    radiance = np.full((160, 240, 4), luminance, dtype=np.float16)
    settings = Exposure(shutter, 4.0, iso)
    return stored_image(radiance, view=CROP, camera=CAMERA, light=LIGHT, exposure=settings, seed=seed, style=style)


def linear(rgb: np.ndarray) -> np.ndarray:
    """Shares of saturation, from images of the plain style below its shoulder."""
    code = rgb / 255
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4) / 1.5


def test_noise_grows_with_the_light_as_the_square_root_and_with_the_iso() -> None:
    dim, bright = linear(of(0.4)), linear(of(1.6))
    assert bright.mean() / dim.mean() == pytest.approx(4, rel=0.02)
    # √4, less what rounding to 8 bits adds.
    assert bright.std() / dim.std() == pytest.approx(2, rel=0.25)
    # At four times the ISO the same image is made of a quarter of the electrons.
    grainy = linear(of(1.0, iso=1600.0))
    clean = linear(of(1.0, iso=400.0))
    assert grainy.mean() == pytest.approx(clean.mean(), rel=0.02)
    assert grainy.std() / clean.std() == pytest.approx(2, rel=0.15)


def test_the_seed_alone_decides_the_noise() -> None:
    assert np.array_equal(of(1.0, seed=0), of(1.0, seed=0))
    other = of(1.0, seed=1)
    assert (of(1.0, seed=0) != other).mean() > 0.3
    assert other.mean() == pytest.approx(of(1.0, seed=0).mean(), abs=0.3)


def shown(view: View, development: Development | None) -> np.ndarray:
    """An even grey with noise, as a camera with this development stores it."""
    radiance = np.full((160, 240, 4), 1.0, dtype=np.float16)
    camera = CAMERA.model_copy(update={"development": development})
    settings = Exposure(0.2 / Exposure(1.0, 4.0, 400.0).share_per_light, 4.0, 400.0)
    style = ImageProcessing(vignetting=0.0)
    return stored_image(radiance, view=view, camera=camera, light=LIGHT, exposure=settings, seed=0, style=style)


def test_a_mosaic_makes_neighbours_alike_and_noise_reduction_takes_noise_out() -> None:
    plain, mosaic, quiet = (
        shown(CROP, of) for of in (None, Development(lens_px=0.0), Development(lens_px=0.0, noise_reduction=6.0))
    )
    alike = [np.corrcoef(each[:, :-1, 0].ravel(), each[:, 1:, 0].ravel())[0, 1] for each in (plain, mosaic)]
    assert alike[0] < 0.2
    assert alike[1] > 0.3
    assert quiet[..., 1].std() < 0.6 * mosaic[..., 1].std()
    assert quiet.mean() == pytest.approx(plain.mean(), abs=1.0)


def test_images_of_fewer_pixels_than_the_sensor_have_nothing_of_its_mosaic() -> None:
    assert np.array_equal(shown(ABOVE, Development(noise_reduction=6.0)), shown(ABOVE, None))


def test_corners_are_darker_by_what_the_style_states() -> None:
    seen = linear(of(1.0, style=replace(PLAIN, vignetting=0.3)))
    corners = np.concatenate([seen[:8, :8], seen[-8:, -8:], seen[:8, -8:], seen[-8:, :8]]).mean()
    assert corners / seen[76:84, 116:124].mean() == pytest.approx(0.7 + 0.3 * 0.05, abs=0.03)


def test_light_beyond_what_half_floats_hold_blackens_no_image() -> None:
    radiance = np.full((160, 240, 4), 1.0, dtype=np.float16)
    radiance[5, 7], radiance[9, 9] = np.nan, np.inf
    settings = Exposure(1 / 1000, 4.0, 100.0)
    seen = stored_image(
        radiance, view=ABOVE, camera=CAMERA, light=LIGHT, exposure=settings, seed=0, style=ImageProcessing()
    )
    radiance[5, 7] = radiance[9, 9] = 1.0
    defect_free = stored_image(
        radiance, view=ABOVE, camera=CAMERA, light=LIGHT, exposure=settings, seed=0, style=ImageProcessing()
    )
    assert np.array_equal(seen[20:], defect_free[20:])
    assert seen[20:].mean() > 20


def chroma(rgb: np.ndarray) -> float:
    """CIE 1976 a*b* chroma of the mean of sRGB pixels, white point D65."""
    code = rgb.reshape(-1, 3).mean(axis=0) / 255
    red_green_blue = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ red_green_blue
    x, y, z = np.cbrt(xyz / (0.9505, 1.0, 1.089))
    return hypot(500 * (x - y), 200 * (y - z))


@pytest.mark.parametrize("sunlit", [0.4, 0.5, 0.7])
@pytest.mark.parametrize("elevation_deg", [25.0, 45.0, 60.0])
def test_sunlit_grey_stays_grey_where_much_of_the_image_is_in_shade(elevation_deg: float, sunlit: float) -> None:
    light, edge = Light(elevation_deg, 180.0), round(240 * sunlit)
    shade = light.sky_irradiance.T @ harmonics(np.array([0.0, 0.0, 1.0]))
    radiance = np.zeros((160, 240, 4), dtype=np.float16)
    radiance[:, :edge, :3] = 0.2 / pi * (light.sun_klux * light.to_sun[2] + shade)
    radiance[:, edge:, :3] = 0.2 / pi * 0.7 * shade
    exposure = programme(CAMERA, meter(radiance))
    seen = stored_image(
        radiance, view=ABOVE, camera=CAMERA, light=light, exposure=exposure, seed=0, style=ImageProcessing()
    )
    assert chroma(seen[:, 10 : edge - 10]) < 8
    # The rest of the difference is the shade's, which is bluer but no paint.
    assert chroma(seen[:, edge + 10 : -10]) < 14


# With the renderer.


def edge_profile(speed_mps: float, shutter_s: float) -> np.ndarray:
    """Tones across the edge of a white plate below a camera that flies east; the image's right is east."""
    view = replace(ABOVE, velocity_mps=np.array([speed_mps, 0.0, 0.0]))
    plate = Box(-5.0, 0.0, 10.0, 30.0, 0.01, reflectance=0.8)
    exposure = Exposure(shutter_s, 32.0, 100.0)
    camera = CAMERA.model_copy(update={"readout_s": 0.0})
    seen = plane_renderer().frame(
        view, light=LIGHT, camera=camera, instances=[plate.instance], exposure=exposure, style=PLAIN
    )
    tones = linear(seen.rgb)[40:120].mean(axis=(0, 2))
    return (tones - tones[-20:].mean()) / (tones[:20].mean() - tones[-20:].mean())


@pytest.mark.parametrize(("speed_mps", "shutter_s"), [(8.0, 1 / 60), (4.0, 1 / 60), (10.0, 1 / 100)])
def test_a_moving_camera_blurs_by_its_speed_times_the_exposure(speed_mps: float, shutter_s: float) -> None:
    expected = speed_mps * shutter_s * ABOVE.focal_px / 9.99
    still, moved = edge_profile(0.0, shutter_s), edge_profile(speed_mps, shutter_s)

    def length(profile: np.ndarray) -> float:
        """Of a straight ramp that passes 15 and 85 % where the profile does."""
        at = [np.interp(share, profile[::-1], np.arange(len(profile))[::-1]) for share in (0.85, 0.15)]
        return float(at[1] - at[0]) / 0.7

    assert length(still) < 1.5
    assert length(moved) == pytest.approx(expected, rel=0.1, abs=1.0)


def test_what_keeps_up_with_the_camera_stays_sharp() -> None:
    view = replace(ABOVE, velocity_mps=np.array([30.0, 0.0, 0.0]))
    boxes = [Box(0.5, y, 1.0, 2.0, 1.0, label=label, reflectance=0.8) for label, y in ((1, 2.0), (2, -2.0))]
    seen = plane_renderer().frame(
        view,
        light=Light(45.0, 180.0, cloud_cover=1.0),
        camera=CAMERA,
        instances=[box.instance for box in boxes],
        exposure=Exposure(1 / 60, 22.0, 100.0),
        style=PLAIN,
        velocities={1: (30.0, 0.0, 0.0)},
    )
    tones = linear(seen.rgb).mean(axis=2)

    def steepest(label: int) -> float:
        rows = np.flatnonzero((seen.labels == label).any(axis=1))
        return float(np.abs(np.diff(tones[rows[0] + 4 : rows[-1] - 4].mean(axis=0))).max())

    assert steepest(1) > 2.5 * steepest(2)


def slant(view: View, camera: str, velocities: dict[int, tuple[float, float, float]]) -> float:
    """Columns that an upright bar in the image leans from its first row to its last."""
    bar = Box(0.0, 0.0, 0.3, 9.0, 0.01, label=5)
    seen = plane_renderer().frame(
        view, light=LIGHT, camera=find_camera(camera), instances=[bar.instance], velocities=velocities
    )
    assert seen.labels is not None
    rows, columns = np.nonzero(seen.labels == 5)
    slope = float(np.polyfit(rows, columns, 1)[0])
    return slope * view.size_px[1]


@pytest.mark.parametrize("velocity", [12.0, -8.0])
def test_a_rolling_shutter_shears_what_moves(velocity: float) -> None:
    expected = velocity * ROLLING.readout_s * ABOVE.focal_px / 9.99
    assert abs(expected) > 3
    moves = {5: (velocity, 0.0, 0.0)}
    assert slant(ABOVE, "phantom4", moves) == pytest.approx(expected, rel=0.1)
    result = replace(ABOVE, velocity_mps=np.array([-velocity, 0.0, 0.0]))
    assert slant(result, "phantom4", {}) == pytest.approx(expected, rel=0.1)
    assert abs(slant(ABOVE, "phantom4pro", moves)) < 0.5
    assert abs(slant(ABOVE, "phantom4", {})) < 0.5


def test_visible_and_amodal_pixels_agree_under_a_rolling_shutter() -> None:
    bar = Box(0.0, 0.0, 1.0, 1.0, 0.5, label=5)
    moves = {5: (12.0, 3.0, 0.0)}
    seen = plane_renderer().frame(ABOVE, light=LIGHT, camera=ROLLING, instances=[bar.instance], velocities=moves)
    assert (seen.labels == 5).sum() == seen.amodal_px[5] > 200


def test_memory_stays_what_it_is_over_a_hundred_places(monkeypatch: pytest.MonkeyPatch) -> None:
    renderer = plane_renderer()
    monkeypatch.setattr("pavetwin.render.tile_cache.PAVEMENTS_HELD", 12)
    monkeypatch.setattr("pavetwin.render.tile_cache.TILES_HELD", 30)
    taken = []
    for step in range(100):
        at = (7.0 * step - 350.0, 90.0 * (step % 7) - 300, 10.0)
        view = look(at, yaw_rad=0.1 * step, pitch_rad=-pi / 2, size_px=(64, 48), vertical_fov_rad=1.0)
        boxes = [Box(at[0] + k, at[1], 1.0, 1.0, 1.0, label=1 + k).instance for k in range(step % 4)]
        renderer.frame(view, light=LIGHTS[step // 10 % 2], camera=CAMERA, instances=boxes)
        if step in (30, 99):
            gc.collect()
            taken.append((renderer.gpu.held_bytes, len(renderer._gpu_scene.tiles), _textures_alive()))
    (bytes_then, _, textures_then), (bytes_now, tiles_now, textures_now) = taken
    assert isinstance(renderer._gpu_scene.tiles, TileCache)
    assert tiles_now <= 12
    assert bytes_now <= 1.1 * bytes_then
    assert textures_now <= textures_then + 8


def _textures_alive() -> int:
    """That the driver's library holds, whoever made them."""
    counts = wgpu.diagnostics.wgpu_native_counts.get_dict()
    return int(counts["Texture"]["hub"]["hub"]["a"])
