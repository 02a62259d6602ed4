"""The shaders and their bind group layouts, compiled once."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Final

import wgpu

from pavetwin.render.gpu import Gpu, mean_linear
from pavetwin.render.instances import LAYOUT
from pavetwin.render.meshes import LAYOUTS, POSITIONS
from pavetwin.render.nearby import CLEAR_SHARE
from pavetwin.render.tile_cache import TileLayouts, texture_layout
from pavetwin.scene.buildings import FACADE_REPEAT_M
from pavetwin.scene.foliage import CUT
from pavetwin.scene.ground.materials import compose
from pavetwin.scene.ground.materials.sampling import LEVEL_SLOPE
from pavetwin.scene.light import SUN_RADIUS_RAD
from pavetwin.scene.values import MAP_MARGIN_M, SIGNED_DISTANCE_M, TILE_M, Detail, GroundKind

LIGHT_FORMAT: Final = "rgba16float"
DEPTH_FORMAT: Final = "depth32float"
LABEL_FORMAT: Final = "r32uint"
DISTANCE_FORMAT: Final = "r32float"

_SHADED: Final = wgpu.ShaderStage.VERTEX | wgpu.ShaderStage.FRAGMENT
_FRAME: Final = {"binding": 0, "visibility": _SHADED, "buffer": {"type": "uniform"}}
_LIGHT: Final = [
    {"binding": 1, "visibility": _SHADED, "texture": {"sample_type": "depth", "view_dimension": "2d"}},
    {"binding": 2, "visibility": _SHADED, "sampler": {"type": "comparison"}},
    {"binding": 3, "visibility": _SHADED, "texture": {"sample_type": "float", "view_dimension": "2d"}},
    {"binding": 4, "visibility": _SHADED, "sampler": {"type": "filtering"}},
    {"binding": 5, "visibility": _SHADED, "sampler": {"type": "filtering"}},
    {"binding": 6, "visibility": _SHADED, "sampler": {"type": "non-filtering"}},
]

ByCulling = tuple[Any, Any, Any]  # In the order of `FaceCulling`


@dataclass(frozen=True)
class LitPipelines:
    """Pipelines with lighting and haze."""

    ground: Any
    patch: Any
    near: ByCulling
    far: ByCulling
    facade: Any


@dataclass(frozen=True)
class Pipelines:
    """All compiled pipelines and layouts."""

    lit: tuple[LitPipelines, LitPipelines]
    """For any view, and for those that `nearby.looks_down` accepts."""
    shade: Any
    strip: Any
    sky: Any
    shadow: ByCulling
    amodal: Any
    amodal_culled: Any
    amodal_patch: Any
    frame_layout: Any
    """The frame only: for shadows and amodal pixels."""
    light_layout: Any
    """The frame, the shadow map, the sky and their samplers."""
    detail_layout: Any
    facade_layout: Any
    leaf_layout: Any
    tiles: TileLayouts


def compile_pipelines(gpu: Gpu, details: dict[GroundKind, Detail]) -> Pipelines:
    """Compile all pipelines. The ground's constants come from its NumPy formula, so that the two stay the same."""
    frame_layout = gpu.device.create_bind_group_layout(entries=[_FRAME])
    light_layout = gpu.device.create_bind_group_layout(entries=[_FRAME, *_LIGHT])
    tiles = TileLayouts(
        maps=texture_layout(gpu, "2d", "2d"),
        patch=texture_layout(gpu, "2d", "2d"),
        mask=texture_layout(gpu, "2d", filtered=False),
    )
    detail_layout = texture_layout(gpu, "2d-array", "2d-array", samplers=1)
    facade_layout = texture_layout(gpu, "2d-array", samplers=1)
    leaf_layout = texture_layout(gpu, "2d", samplers=1)
    lit, numbers = ["common", "lighting"], _ground_numbers(details)

    def amodal(parts: list[str], layouts: list[Any], buffers: list[Any], *, cull: str = "none") -> Any:
        """Labels without occlusion."""
        code, targets = _source(["common", "amodal", *parts]), [{"format": LABEL_FORMAT}]
        return _pipeline(gpu, code, [frame_layout, *layouts], buffers, targets=targets, cull=cull, depth=None)

    def shadow(parts: list[str], layouts: list[Any], buffers: list[Any], cull: str = "none") -> Any:
        code = _source(["common", *parts])
        return _pipeline(gpu, code, [frame_layout, *layouts], buffers, targets=[], cull=cull, depth=("less", True))

    def lit_for(*, looks_down: bool) -> LitPipelines:
        def shaded(
            parts: list[str], layouts: list[Any], buffers: list[Any], extra: str = "", cull: str = "none"
        ) -> Any:
            code, constants = extra + _source([*lit, *parts]), {"looks_down": looks_down}
            return _pipeline(gpu, code, [light_layout, *layouts], buffers, targets=_LIT, cull=cull, constants=constants)

        def models(part: str) -> ByCulling:
            parts = ["solid", "model", part]
            return _by_skin(lambda cull: shaded(parts, [], _buffers("model"), cull=cull), leaves)

        repeat = f"const FACADE_REPEAT_M = {FACADE_REPEAT_M};\n"
        leaves = shaded(["solid", "model", "leaf", "leaf_light"], [leaf_layout], _buffers("leaf"))
        maps, holed = [detail_layout, tiles.maps], [detail_layout, tiles.maps, tiles.patch]
        return LitPipelines(
            ground=shaded(["ground_surface", "ground"], maps, _buffers("ground"), numbers),
            patch=shaded(["ground_surface", "patch", "mask"], holed, _buffers("patch"), numbers),
            near=models("model_near"),
            far=models("model_far"),
            facade=shaded(["solid", "facade"], [facade_layout], _buffers("facade"), repeat),
        )

    dimmed, stripped = _source([*lit, "shade"]), _source([*lit, "strip"])
    return Pipelines(
        lit=(lit_for(looks_down=False), lit_for(looks_down=True)),
        shade=_pipeline(gpu, dimmed, [light_layout], [LAYOUT], targets=_DIMMED, depth=("greater-equal", False)),
        strip=_pipeline(gpu, stripped, [light_layout], [LAYOUT], targets=_DIMMED, depth=("greater-equal", False)),
        sky=_pipeline(gpu, _beyond(details) + _source([*lit, "sky"]), [light_layout], [], targets=_BEHIND),
        shadow=_by_skin(
            lambda cull: shadow(["shadow"], [], [LAYOUT, POSITIONS], cull),
            shadow(["leaf", "shadow_leaf"], [leaf_layout], _buffers("leaf")),
        ),
        amodal=amodal(["amodal_solid"], [], [LAYOUT, POSITIONS]),
        amodal_culled=amodal(["amodal_solid"], [], [LAYOUT, POSITIONS], cull="back"),
        amodal_patch=amodal(["mask", "amodal_patch"], [tiles.mask], _buffers("patch")),
        frame_layout=frame_layout,
        light_layout=light_layout,
        detail_layout=detail_layout,
        facade_layout=facade_layout,
        leaf_layout=leaf_layout,
        tiles=tiles,
    )


def _by_skin(make: Callable[[str], Any], leaves: Any) -> ByCulling:
    return make("none"), make("back"), leaves


def _buffers(material: str) -> list[Any]:
    return [LAYOUT, POSITIONS, LAYOUTS[material]]


def _source(parts: list[str]) -> str:
    folder = files("pavetwin.render") / "wgsl"
    known = {"LEAF_CUT": CUT, "CLEAR_SHARE": CLEAR_SHARE, "LEVEL_SLOPE": LEVEL_SLOPE}
    known["SUN_TAN"] = math.tan(SUN_RADIUS_RAD)
    numbers = "".join(f"const {name}: f32 = {float(value)};\n" for name, value in known.items())
    return numbers + "\n".join((folder / f"{part}.wgsl").read_text(encoding="utf-8") for part in parts)


def _beyond(details: dict[GroundKind, Detail]) -> str:
    """The reflectance of the ground beyond a world, as WGSL: that of the lawns at its border."""
    lawn = mean_linear(details[GroundKind.GRASS].reflectance)
    return f"const BEYOND = vec3f({', '.join(f'{value:.4f}' for value in lawn)});\n"


def _ground_numbers(details: dict[GroundKind, Detail]) -> str:
    """Constants of the ground's formula, as WGSL."""
    numbers = {
        "SIGNED_DISTANCE_M": SIGNED_DISTANCE_M,
        "RAGGED_M": compose.RAGGED_M,
        "PAINT_EDGE_M": compose.PAINT_EDGE_M,
        "BITUMEN_EDGE_M": compose.BITUMEN_EDGE_M,
        "KEPT_SOFT": compose.KEPT_SOFT,
        "GRAINS_SEEN_M": compose.GRAINS_SEEN_M,
        "GRAINS_MELTED_M": compose.GRAINS_MELTED_M,
        "MEAN_HEIGHT": compose.MEAN_HEIGHT,
        "FIRST_PLANT": compose.FIRST_PLANT,
        "SECOND_COS": math.cos(compose.SECOND_TURN_RAD),
        "SECOND_SIN": math.sin(compose.SECOND_TURN_RAD),
        "SECOND_SCALE": compose.SECOND_SCALE,
        "GRAIN_M": compose.GRAIN_M,
        "MAP_MARGIN_M": MAP_MARGIN_M,
        "MAP_SIDE_M": TILE_M + 2 * MAP_MARGIN_M,
    }
    lines = [f"const {name}: f32 = {float(value)};" for name, value in numbers.items()]
    colours = {
        "WARMING": compose.WARMING,
        "DUST": compose.DUST,
        "BITUMEN": compose.BITUMEN,
    }
    lines += [f"const {name} = vec3f({', '.join(map(str, rgb))});" for name, rgb in colours.items()]
    paints = ", ".join(f"vec3f({', '.join(map(str, rgb))})" for rgb in compose.PAINTS.values())
    lines.append(f"const PAINTS = array<vec3f, {len(compose.PAINTS)}>({paints});")
    lines.append(f"const LAST_PAINT = {len(compose.PAINTS) - 1}u;")
    lines.append(f"const LOOSE_KINDS = {sum(1 << int(kind) for kind in compose.LOOSE)}u;")
    sizes = ", ".join(str(float(details[kind].size_m)) for kind in GroundKind)
    lines.append(f"const DETAIL_SIZES = array<f32, {len(GroundKind)}>({sizes});")
    means = ", ".join(
        f"vec3f({', '.join(f'{value:.5f}' for value in mean_linear(details[kind].reflectance))})" for kind in GroundKind
    )
    lines.append(f"const DETAIL_MEANS = array<vec3f, {len(GroundKind)}>({means});")
    lines.append("fn mean_reflectance(kind: u32) -> vec3f { var means = DETAIL_MEANS; return means[kind]; }")
    lines.append("fn detail_size(kind: u32) -> f32 { var sizes = DETAIL_SIZES; return sizes[kind]; }")
    return "\n".join(lines) + "\n"


def _pipeline(
    gpu: Gpu,
    code: str,
    layouts: list[Any],
    buffers: list[Any],
    *,
    targets: list[dict[str, Any]],
    cull: str = "none",
    depth: tuple[str, bool] | None = ("greater-equal", True),
    constants: dict[str, bool] | None = None,
) -> Any:
    """A render pipeline; code without a fragment stage draws all of its triangles.

    `depth`: the comparison and whether depth is written; None without a depth buffer. Depth falls with distance: nearly
    even precision from 0.1 m to the horizon.
    """
    stage = {"module": gpu.device.create_shader_module(code=code), "constants": constants or {}}
    fragment = {"fragment": stage | {"entry_point": "fragment", "targets": targets}} if "@fragment" in code else {}
    return gpu.device.create_render_pipeline(
        layout=gpu.device.create_pipeline_layout(bind_group_layouts=layouts),
        vertex=stage | {"entry_point": "vertex", "buffers": buffers},
        primitive={"topology": "triangle-list", "cull_mode": cull},
        depth_stencil=depth and {"format": DEPTH_FORMAT, "depth_compare": depth[0], "depth_write_enabled": depth[1]},
        **fragment,
    )


_TRUTH: Final = [{"format": LABEL_FORMAT}, {"format": DISTANCE_FORMAT}]
_UNTOUCHED: Final[list[dict[str, Any]]] = [{**each, "write_mask": 0} for each in _TRUTH]
_LIT: Final[list[dict[str, Any]]] = [{"format": LIGHT_FORMAT}, *_TRUTH]
_MULTIPLIED: Final = {"src_factor": "dst", "dst_factor": "zero", "operation": "add"}
_KEPT: Final = {"src_factor": "zero", "dst_factor": "one", "operation": "add"}
_DIMMED: Final[list[dict[str, Any]]] = [
    {"format": LIGHT_FORMAT, "blend": {"color": _MULTIPLIED, "alpha": _KEPT}},
    *_UNTOUCHED,
]
"""Light that is multiplied with what is drawn."""
_BEHIND: Final[list[dict[str, Any]]] = [{"format": LIGHT_FORMAT}, *_UNTOUCHED]  # Light without a label at no distance
