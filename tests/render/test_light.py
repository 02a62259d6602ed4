"""Brightness by exposure, sun, sky, shadows and lamps. All radiances are numbers."""

from dataclasses import dataclass, replace
from functools import cache
from math import cos, pi, radians, sin, tan

import numpy as np
import pytest
import shapely

from pavetwin.render.frame import Exposure
from pavetwin.render.nearby import looks_down
from pavetwin.render.renderer import Renderer
from pavetwin.render.sensor import ImageProcessing
from pavetwin.scene.agents import Actors, upright
from pavetwin.scene.light import LUMINANCE, Light, harmonics
from pavetwin.scene.models import library
from pavetwin.scene.scene import Scene
from pavetwin.scene.signals import VEHICLES as FOR_VEHICLES
from pavetwin.scene.signals import WALKERS, Head, instances
from pavetwin.scene.values import TINTS, Instance
from pavetwin.scene.view import View, look, nadir
from pavetwin.traffic.kinds import VEHICLES
from pavetwin.uav import find_camera
from scenes import built
from scenes.recordings import recording
from scenes.stage import GREY, Box, Plane, light_of, plane_renderer

CAMERA = find_camera("phantom4pro")
UP = np.array([0.0, 0.0, 1.0])
ABOVE = look((0, 0, 14), yaw_rad=pi / 2, pitch_rad=-pi / 2, size_px=(320, 240), vertical_fov_rad=1.0)
"""North is up."""

SUNS = [Light(60.0, 180.0), Light(35.0, 250.0), Light(15.0, 100.0)]


def radiance(light: Light, boxes: tuple[Box, ...] = (), view: View = ABOVE) -> np.ndarray:
    """(height, width, 3) kcd/m²."""
    seen = light_of(plane_renderer(), view, light=light, instances=[box.instance for box in boxes], truth=False)
    return seen.radiance[..., :3].astype(np.float64)


@pytest.mark.parametrize("light", [*SUNS, Light(40.0, 0.0, cloud_cover=1.0)], ids=str)
def test_a_grey_plane_sends_back_its_share_of_sun_and_sky(light: Light) -> None:
    falls = light.sun_klux * light.to_sun[2] + light.sky_irradiance.T @ harmonics(UP)
    seen = radiance(light).mean(axis=(0, 1))
    # Its surface mirrors a few percent besides, more of a low sun.
    assert np.allclose(seen, GREY / pi * falls, rtol=0.16)
    assert (seen > GREY / pi * falls * 0.99).all()


def test_the_image_is_as_bright_as_the_exposure_states() -> None:
    light = SUNS[0]
    exposure = Exposure(1 / 1000, 5.6, 100.0)
    plain = ImageProcessing(contrast=1.0, saturation=1.0, adaptation=0.0, sharpening=0.0, blur_px=0.0, vignetting=0.0)
    seen = plane_renderer().frame(ABOVE, light=light, camera=CAMERA, exposure=exposure, style=plain)
    share = radiance(light).mean(axis=(0, 1)) * exposure.share_per_light * 1.5
    assert 0.1 < share.max() < 0.5
    expected = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055) * 255
    assert np.allclose(seen.rgb.mean(axis=(0, 1)), expected, atol=1.5)


def test_an_automatic_exposure_makes_any_light_the_same_grey_and_compensation_changes_it() -> None:
    def tone(light: Light, stops: float = 0.0) -> float:
        seen = plane_renderer().frame(ABOVE, light=light, camera=CAMERA, compensation_ev=stops)
        return float((seen.rgb @ LUMINANCE).mean())

    tones = [tone(light) for light in (*SUNS, Light(40.0, 0.0, cloud_cover=1.0))]
    assert max(tones) - min(tones) < 12
    assert min(tones) > 100
    assert max(tones) < 160
    assert tone(SUNS[0], -1.0) < tones[0] - 25 < tones[0] + 20 < tone(SUNS[0], 0.7)


def shadow_px(view: View, box: Box, light: Light) -> shapely.Geometry:
    """Where the box's shadow lies in the image, by geometry."""
    thrown = box.corners[:, :2] - light.to_sun[:2] / light.to_sun[2] * box.corners[:, 2:]
    return shapely.MultiPoint(view.project(np.column_stack([thrown, np.zeros(8)]))).convex_hull


@pytest.mark.parametrize("azimuth_deg", [20.0, 135.0, 250.0])
@pytest.mark.parametrize("elevation_deg", [30.0, 55.0])
def test_a_posts_shadow_lies_where_the_sun_states(azimuth_deg: float, elevation_deg: float) -> None:
    light = Light(elevation_deg, azimuth_deg)
    post = Box(0.3, -0.2, 0.3, 0.3, 3.0, yaw_rad=0.5)
    bare, seen = radiance(light), radiance(light, (post,))
    share = (seen / bare)[..., 1]
    columns, rows = np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5)
    expected = shapely.contains_xy(shadow_px(ABOVE, post, light), columns, rows)
    standing = shapely.contains_xy(
        shapely.MultiPoint(ABOVE.project(post.corners)).convex_hull.buffer(1.5), columns, rows
    )
    dark = (share < 0.6) & ~standing
    expected &= ~standing
    assert expected.sum() > 150
    assert (dark & expected).sum() / (dark | expected).sum() > 0.8
    # The way from its foot to the farthest dark pixel: direction and length.
    y, x = np.nonzero(dark)
    tips = ABOVE.ground(np.stack([x + 0.5, y + 0.5], axis=1)) - (post.x, post.y)
    tip = tips[np.argmax(np.linalg.norm(tips, axis=1))]
    length = 3.0 / tan(radians(elevation_deg))
    assert np.linalg.norm(tip) == pytest.approx(length + 0.15, abs=0.3)
    towards = -np.array([sin(radians(azimuth_deg)), cos(radians(azimuth_deg))])
    assert tip @ towards / np.linalg.norm(tip) > 0.99


@pytest.mark.parametrize("azimuth_deg", [0.0, 20.0, 135.0])
def test_a_thin_arms_shadow_is_not_broken(azimuth_deg: float) -> None:
    """As of a street light's arm: two or three texels of the shadow map wide, far above the ground."""
    light = Light(62.0, azimuth_deg)
    view = nadir(find_camera("phantom4pro"), (0.0, 0.0, 15.0), yaw_rad=0.3, size_px=(640, 640))
    arm = Box(0.0, 0.0, 3.0, 0.06, 0.06, yaw_rad=0.9, z=7.0)
    renderer = plane_renderer()
    bare, seen = (
        light_of(renderer, view, light=light, instances=each, truth=False).radiance[..., 1].astype(float)
        for each in ((), (arm.instance,))
    )
    along = np.linspace(-1.3, 1.3, 200)[:, None] * [cos(arm.yaw_rad), sin(arm.yaw_rad)]
    ground = along - light.to_sun[:2] / light.to_sun[2] * 7.0
    at = view.project(np.column_stack([ground, np.zeros(200)]))
    columns, rows = np.floor(at).astype(int).T
    inside = (columns >= 0) & (columns < 640) & (rows >= 0) & (rows < 640)
    assert inside.sum() > 100
    share = (seen / bare)[rows[inside], columns[inside]]
    assert (share > 0.85).mean() < 0.02


def test_an_overcast_sky_throws_no_shadows() -> None:
    post = Box(0.0, 0.0, 0.3, 0.3, 3.0)
    overcast, clear = Light(35.0, 180.0, cloud_cover=1.0), Light(35.0, 180.0)
    north = ABOVE.project(np.array([0.0, 2.5, 0.0])).astype(int)

    def beside(light: Light) -> float:
        part = (slice(north[1] - 6, north[1] + 7), slice(north[0], north[0] + 1))
        return float((radiance(light, (post,)) / radiance(light))[part].min())

    assert beside(clear) < 0.5
    assert beside(overcast) > 0.97


def test_glowing_lamps_send_what_they_should() -> None:
    light = Light(20.0, 180.0)
    view = look((-6, 0, 0.6), yaw_rad=0.0, pitch_rad=0.0, size_px=(160, 120), vertical_fov_rad=0.5)

    def face(glow: float) -> np.ndarray:
        seen = radiance(light, (Box(0.0, 0.0, 0.5, 1.0, 1.0, glow=glow),), view)
        return seen[50:70, 70:90].mean(axis=(0, 1))

    # `Instance.tints`: g × colour × the radiance of a white surface in full sun, 100 klx / π; through 6 m of clear air.
    assert np.allclose(face(1.5) - face(0.0), 1.5 * 0.4 * 100 / pi, rtol=0.03)


# A whole town.


@cache
def town() -> Scene:
    return Scene(built("town").world, seed=0)


@pytest.fixture(scope="module")
def town_renderer() -> Renderer:
    return Renderer(town())


def random_views(count: int) -> list[tuple[View, Light]]:
    """About one crossing: from the air and from the road, in any light, the sun also just above the horizon."""
    rng = np.random.default_rng(11)
    street = max(town().world.segments, key=lambda segment: segment.area_m2)
    x, y = street.centre_line.interpolate(0.5, normalized=True).coords[0]
    found = []
    for number in range(count):
        at = (x + rng.uniform(-12, 12), y + rng.uniform(-12, 12), (1.3, 3.0, 6.0, 15.0)[number % 4])
        pitch = -pi / 2 if number % 3 == 0 else rng.uniform(-1.5, 0.15)
        view = look(at, yaw_rad=rng.uniform(-pi, pi), pitch_rad=float(pitch), size_px=(120, 80), vertical_fov_rad=1.1)
        low = number % 5 == 0
        light = Light(
            float(rng.uniform(0.5, 5) if low else rng.uniform(5, 65)),
            float(rng.uniform(0, 360)),
            cloud_cover=float(rng.uniform(0, 0.5) if low else rng.uniform(0, 1)),
        )
        found.append((view, light))
    return found


@pytest.mark.slow
def test_every_radiance_of_a_town_is_a_number(town_renderer: Renderer) -> None:
    for view, light in random_views(60):
        seen = light_of(town_renderer, view, light=light, truth=False).radiance
        assert np.isfinite(seen).all()
        assert (seen >= 0).all()
        assert np.median(seen[..., 1]) > 0.005 * float(light.sky_klux) / pi


@pytest.mark.slow
def test_visible_pixels_are_at_most_amodal_pixels(town_renderer: Renderer) -> None:
    """Whatever is far away is drawn coarser: both ways alike."""
    rng = np.random.default_rng(2)
    lines = [segment.centre_line for segment in town().world.segments]
    line = max(lines, key=lambda each: each.interpolate(0).distance(each.interpolate(each.length)))
    names = ("hatchback", "saloon", "bus", "van", "motorcycle", "suv")
    cars = []
    for number, at in enumerate(np.linspace(15.0, line.length, 24)):
        place = line.interpolate(at)
        x, y = place.x + rng.uniform(-2, 2), place.y + rng.uniform(-2, 2)
        stand_in = Box(x, y, 1, 1, 1, rng.uniform(-pi, pi), label=1 + number, reflectance=1.0).instance
        cars.append(replace(stand_in, model=names[number % len(names)]))
    start, end = line.interpolate(0), line.interpolate(line.length)
    yaw = float(np.arctan2(end.y - start.y, end.x - start.x))
    shown = 0
    for height, pitch in ((1.4, -0.1), (12.0, -0.5), (25.0, -1.2)):
        view = look((start.x, start.y, height), yaw_rad=yaw, pitch_rad=pitch, size_px=(480, 320), vertical_fov_rad=0.9)
        seen = light_of(town_renderer, view, light=SUNS[0], instances=cars, amodal=True)
        assert seen.labels is not None
        for label in np.unique(seen.labels[seen.labels > 0]).tolist():
            shown += 1
            assert (seen.labels == label).sum() <= seen.amodal_px[label]
    assert shown > 20


def test_views_from_above_look_the_same_without_what_they_have_none_of(
    town_renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They have pipelines of their own, without haze and what mirrors at a slant."""
    light = SUNS[1]
    street = max(town().world.segments, key=lambda segment: segment.area_m2)
    (place,) = street.centre_line.interpolate(0.5, normalized=True).coords
    view = look((*place[:2], 12), yaw_rad=0.3, pitch_rad=-pi / 2, size_px=(320, 320), vertical_fov_rad=0.9)

    def seen(*, down: bool) -> np.ndarray:
        monkeypatch.setattr("pavetwin.render.gpu_scene.looks_down", lambda *_: down)
        drawn = town_renderer.frame(view, light=light, camera=CAMERA, exposure=Exposure(1 / 1000, 5.6, 100.0))
        return drawn.rgb.astype(int)

    assert looks_down(view, light)
    off = np.abs(seen(down=True) - seen(down=False))
    assert np.quantile(off, 0.99) <= 2


@pytest.mark.parametrize(
    ("altitude_m", "pitch_deg", "visibility_m"), [(60.0, -90, 12_000), (10.0, -55, 12_000), (10.0, -90, 2_000)]
)
def test_haze_and_slants_are_drawn_where_they_may_be_seen(
    altitude_m: float, pitch_deg: float, visibility_m: float
) -> None:
    view = look((0, 0, altitude_m), yaw_rad=0, pitch_rad=radians(pitch_deg), size_px=(320, 320), vertical_fov_rad=0.9)
    assert not looks_down(view, Light(40.0, 150.0, visibility_m=visibility_m))


@pytest.mark.parametrize("tree", ["tree_oval", "tree_round", "tree_spreading", "tree_young"])
def test_boughs_high_up_hide_little_sky_from_the_ground_below(tree: str) -> None:
    """They are not cars whose underside is near the ground: only the trunk's foot shades what is right next to it."""
    overcast = Light(40.0, 0.0, cloud_cover=1.0)
    renderer = Renderer(Plane(models={tree: library()[tree]}))
    trunk = Instance(tree, "trunk", np.eye(4), np.tile(np.float32([1, 1, 1, 0]), (TINTS, 1)))
    view = look((0, -6, 3.0), yaw_rad=pi / 2, pitch_rad=-0.45, size_px=(320, 240), vertical_fov_rad=0.6)
    bare, seen = (
        light_of(renderer, view, light=overcast, instances=instances, truth=True) for instances in ((), (trunk,))
    )
    share = seen.radiance[..., 1].astype(np.float64) / bare.radiance[..., 1]
    ground = view.ground(np.stack(np.meshgrid(np.arange(320) + 0.5, np.arange(240) + 0.5), axis=-1).reshape(-1, 2))
    away = np.hypot(*ground.T).reshape(240, 320)
    beside = np.isclose(seen.depth_m, bare.depth_m, rtol=1e-4) & (away < 2.0)
    assert beside.sum() > 2000
    assert np.quantile(share[beside], 0.01) > 0.45
    assert np.median(share[beside]) > 0.9


LIGHT = Light(45.0, 200.0)
RED, AMBER, GREEN = 1, 2, 3
"""Slots of signal heads."""
REAR_LAMPS = 2
"""Slot of vehicles."""


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(Plane(models=library()))


def towards(x: float, y: float, z: float, *, from_yaw_rad: float, distance_m: float) -> View:
    """A level view of a point, from a direction."""
    place = (x + distance_m * cos(from_yaw_rad), y + distance_m * sin(from_yaw_rad), z)
    return look(place, yaw_rad=from_yaw_rad + pi, pitch_rad=0.0, size_px=(240, 180), vertical_fov_rad=0.5)


def change(renderer: Renderer, view: View, off: Instance, on: Instance) -> np.ndarray:
    """(height, width, 3) by how much the image of one thing gets brighter [kcd/m²]."""
    before, after = (
        light_of(renderer, view, instances=[each], light=LIGHT, truth=False).radiance[..., :3].astype(float)
        for each in (off, on)
    )
    return np.asarray(after - before)


def lamp_px(view: View, instance: Instance, slot: int) -> np.ndarray:
    """(height, width) where a slot's triangles lie in the image, and a pixel around them."""
    mesh = library()[instance.model].parts[instance.part]
    assert mesh.surface is not None
    mine = mesh.indices[(mesh.surface[mesh.indices, 2] == slot).any(axis=1)]
    corners = mesh.positions[mine].astype(float) @ instance.transform[:3, :3].T + instance.transform[:3, 3]
    shapes = shapely.buffer(shapely.polygons(view.project(corners)), 1.0, quad_segs=2)
    width, height = view.size_px
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.asarray(shapely.contains_xy(shapely.union_all(shapes), columns, rows))


# Vehicles.


def vehicle(kind: str, braking: bool) -> Instance:
    """A vehicle of a recording, at the origin, heading east."""
    made = recording([kind], lambda _, t: (0.0, 0.0, 0.0, 12.0 - (2.0 * t if braking else 0.0)), frames=8)
    (drawn,) = Actors(made, seed=0, models=library(), ground=lambda xy: np.zeros(len(xy))).at(1.2)
    return drawn


@pytest.mark.parametrize("kind", VEHICLES, ids=lambda kind: kind.name)
def test_brake_lamps_light_up_at_the_rear_and_nowhere_else(renderer: Renderer, kind) -> None:
    off, on = vehicle(kind.name, False), vehicle(kind.name, True)
    behind = towards(-kind.length_m / 2, 0, kind.height_m / 2, from_yaw_rad=pi, distance_m=6.0)
    brighter, lamp = change(renderer, behind, off, on), lamp_px(behind, off, REAR_LAMPS)
    lit = brighter[..., 0] > 0
    assert lit.sum() >= 12
    assert not (brighter.any(axis=2) & ~lamp).any()
    # What is seen of them is red, and bright next to sunlit paint: white paper in full sun sends 32 kcd/m².
    assert brighter[lit][:, 0].mean() > 5.0
    assert brighter[lit][:, 0].mean() > 5 * brighter[lit][:, 1:].mean()
    # As much on the left as on the right.
    sides = [lit[:, :120].sum(), lit[:, 120:].sum()]
    assert min(sides) > 0.6 * max(sides)
    ahead = towards(kind.length_m / 2, 0, kind.height_m / 2, from_yaw_rad=0.0, distance_m=6.0)
    assert not change(renderer, ahead, off, on).any()


# Signals.


@dataclass(frozen=True)
class Signals:
    """A controller's states, a letter every half second."""

    letters: str
    step_s: float = 0.5

    @property
    def signals(self) -> dict[str, tuple[tuple[int, str], ...]]:
        return {"c": tuple((step, letter) for step, letter in enumerate(self.letters))}


SHOWN = {"r": {RED}, "u": {RED, AMBER}, "y": {AMBER}, "g": {GREEN}, "G": {GREEN}, "O": set()}
COLOURS = {RED: [True, False], AMBER: [True, True], GREEN: [False, True]}
"""Which of a lamp's red and green are bright."""


@pytest.mark.parametrize(("model", "letters"), [(FOR_VEHICLES, "ruGyg"), (WALKERS, "rG")])
def test_a_head_shows_its_links_letter(renderer: Renderer, model: str, letters: str) -> None:
    head = Head(model, upright(0.0, 0.0, pi, z_m=3.0), "c", 0)
    (off,) = instances([head], None, 0.0)
    view, back = (towards(0, 0, 3.0, from_yaw_rad=yaw, distance_m=3.0) for yaw in (pi, 0.0))
    for step, letter in enumerate(letters):
        (on,) = instances([head], Signals(letters), 0.5 * step + 0.1)  # type: ignore[arg-type]
        brighter = change(renderer, view, off, on)
        expected = {slot: lamp_px(view, off, slot) for slot in SHOWN[letter]}
        assert not (brighter.any(axis=2) & ~np.logical_or.reduce(list(expected.values()))).any()
        for slot, where in expected.items():
            lit = brighter[where & brighter.any(axis=2)]
            assert len(lit) > 0.4 * where.sum() > 40
            assert (lit.mean(axis=0)[:2] > 0.25 * lit.mean(axis=0).max()).tolist() == COLOURS[slot]
        assert not change(renderer, back, off, on).any()
