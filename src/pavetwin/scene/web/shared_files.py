"""Files that all tiles of a town share: models at three levels, textures of façades and leaves, and the light."""

from collections.abc import Iterable
from itertools import chain
from typing import Any, Final

import numpy as np
from PIL import Image

from pavetwin.scene.appearance import PARKED
from pavetwin.scene.coarser import FINEST_M, closed, coarser, foliage_px2
from pavetwin.scene.export.baking import jpeg, png
from pavetwin.scene.export.glb_models import leaves_image
from pavetwin.scene.foliage import CUT
from pavetwin.scene.light import LUMINANCE, Light, harmonics
from pavetwin.scene.models import SHADOW
from pavetwin.scene.scene import Scene
from pavetwin.scene.texture_cache import kept
from pavetwin.scene.values import Mesh
from pavetwin.scene.web.packing import CROWN_TRIANGLES, MODEL_TRIANGLES, PackedFile

_MOST_LEVELS: Final = 8
_MOST_STEPS: Final = 32
"""Sides of cells, four to each doubling, up to 3 m."""
_FACADE_PX: Final = 256
_SKY_STEPS: Final = (0, 3, 8, 18, 35, 60, 90)
"""Elevations at which the sky's colour is given [degrees]."""


def models_file(scene: Scene) -> bytes:
    """All models as one gzipped file, from the cache: it is the same in every world."""
    found = kept("web-models", lambda: {"packed": np.frombuffer(_models_file(scene), dtype=np.uint8)})
    return found["packed"].tobytes()


def _models_file(scene: Scene) -> bytes:
    """All models as one gzipped file: a node MODEL:PART:LEVEL each.

    A vehicle that has a version for parking is drawn by that, which has half the triangles. Vertices have `_LAYER`, the
    slot of the instance's colours, 0 for none; crowns have coordinates over the image of leaves.
    """
    file = PackedFile()
    for name, model in scene.models.items():
        for part, mesh in model.parts.items():
            if part == SHADOW or mesh.colours is None or mesh.surface is None:
                continue
            light = scene.models.get(f"{name}{PARKED}", model).parts.get(part, mesh)
            is_alike = light.surface is not None and light.surface[:, 2].max() == mesh.surface[:, 2].max()
            best = light if is_alike else mesh
            for level, most in enumerate(CROWN_TRIANGLES if mesh.uv is not None else MODEL_TRIANGLES):
                made = _within(best, most)
                assert made.colours is not None
                assert made.surface is not None
                uv = None if made.uv is None else made.uv * (1, -1) + (0, 1)
                zero = (0.0, 0.0, 0.0)
                layers = made.surface[:, 2]
                file.add(f"{name}:{part}:{level}", made, zero, zero, colours=made.colours, layers=layers, uv=uv)
    extras = {name: dict(model.extras) for name, model in scene.models.items() if "stride_m" in model.extras}
    return file.packed({"people": extras})


def _within(mesh: Mesh, most: int) -> Mesh:
    """The finest level of a mesh with no more triangles than that."""
    levels: Iterable[Mesh]
    if foliage_px2(mesh):
        levels = (coarser(mesh, level) for level in range(_MOST_LEVELS))
    else:
        levels = chain([mesh], (closed(mesh, FINEST_M * 2 ** (step / 4)) for step in range(_MOST_STEPS)))
    made = mesh
    for made in levels:
        if len(made.indices) <= most:
            break
    return made


def facades_file(scene: Scene) -> tuple[bytes, int]:
    """The textures of façades below each other as a JPEG file, the first on top, and their number. Row 0 is v = 1."""
    layers = []
    for texture in scene.facade_textures:
        image = Image.fromarray(np.ascontiguousarray(texture[::-1, :, :3]))
        layers.append(np.asarray(image.resize((_FACADE_PX, _FACADE_PX), Image.Resampling.BOX)))
    return jpeg(np.concatenate(layers), 82, "4:2:0"), len(layers)


def leaves_file() -> bytes:
    """The leaf atlas as a PNG file: sRGB, and alpha that cuts it out."""
    return png(leaves_image().transpose(Image.Transpose.FLIP_TOP_BOTTOM).quantize(256))


def light_values(light: Light) -> dict[str, Any]:
    """The light as a client needs it, in the files' axes; illuminances in klux, luminances in kcd/m², linear RGB.

    `irradiance` has the nine coefficients of the radiance whose irradiance is that of sky, houses and ground, as
    `THREE.LightProbe` takes them. `sky` has the mean of all directions at each elevation.
    """
    around = np.radians(np.arange(0, 360, 10))
    stops = []
    for elevation in _SKY_STEPS:
        up = np.full(len(around), np.sin(np.radians(max(elevation, 0.5))))
        flat = np.sqrt(1 - up**2)
        seen = light.sky(np.stack([flat * np.sin(around), flat * np.cos(around), up], axis=1)).mean(axis=0)
        stops.append([elevation, *_rounded(seen)])
    total = float(light.sun_klux @ LUMINANCE) * float(light.to_sun[2]) + light.sky_klux
    return {
        "to_sun": _rounded(light.to_sun[[1, 2, 0]]),
        "sun_klux": _rounded(light.sun_klux),
        "ground_klux": round(total, 3),
        "irradiance": [_rounded(row) for row in _turned(light.sky_irradiance)],
        "sky": stops,
        "haze_m": round(light.haze_m, 1),
    }


def _turned(coefficients: Any) -> Any:
    """(9, 3): irradiance in our axes as radiance in the files' axes."""
    rows = np.random.default_rng(1).standard_normal((64, 3))
    ours = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    values = harmonics(ours) @ coefficients
    turned = np.linalg.lstsq(harmonics(ours[:, [1, 2, 0]]), values, rcond=None)[0]
    bands = np.array([np.pi] + [2 * np.pi / 3] * 3 + [np.pi / 4] * 5)
    return turned / bands[:, None]


def _rounded(values: Iterable[float]) -> list[float]:
    return [round(float(value), 5) for value in values]


LEAVES_CUT: Final = CUT
