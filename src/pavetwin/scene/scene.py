"""The scene of a world: its tiles, made on demand and kept in the cache, and its moving objects."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property, lru_cache
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt
from shapely import Polygon

from pavetwin.arrays import Float64Array, UInt8Array
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.memory import keep_freed
from pavetwin.scene import furniture, signals, values
from pavetwin.scene.agents import Actors, ParkedInstances, upright
from pavetwin.scene.appearance import tints
from pavetwin.scene.branches import FORMS as BARE_FORMS
from pavetwin.scene.branches import bare_tree_of, bare_trees
from pavetwin.scene.buildings import Buildings, HouseDetail, facade_textures
from pavetwin.scene.furniture import StreetObject, StreetObjects
from pavetwin.scene.ground import (
    GroundPlan,
    details,
    fixture_models,
    fixtures,
    ground_maps,
    ground_pieces,
    heights,
    plan_ground,
)
from pavetwin.scene.ground.distractors.fixtures import Fixture
from pavetwin.scene.ground.distractors.segment_marks import Repairs
from pavetwin.scene.ground.ground_plan import LAST_PART, made
from pavetwin.scene.ground.layout.paved import PavedSurface
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.styles import DEFAULT_STYLE, street_style, style_sha256
from pavetwin.scene.models import BODY, library
from pavetwin.scene.patches import holes_of, part_on, patch_of
from pavetwin.scene.shafts import shafts
from pavetwin.scene.values import (
    TILE_M,
    DefectPatch,
    Detail,
    FacadePiece,
    GroundKind,
    GroundMaps,
    GroundPiece,
    Instance,
    Model,
    Tile,
    TileKey,
    tile_at,
    tile_bounds,
    tile_origin,
)
from pavetwin.scene.wires import Wires, shaded_strips, wire_instances, wires_of
from pavetwin.traffic.parked import ParkedVehicles
from pavetwin.traffic.recording import Recording
from pavetwin.world.cache import ValueStore, cache_folder, made_by, mark_used, short_sha256
from pavetwin.world.ground import Bounds
from pavetwin.world.model import Furniture, FurnitureKind, World

MADE_BY: Final = ("scene", "defects", "world")
"""The folders of the package whose code and data decide what is kept here."""

Value = TypeVar("Value")

_STORE: Final = ValueStore(
    "tiles of the ground",
    (
        *(values.Tile, values.GroundPiece, values.FacadePiece, values.Instance, values.Mesh, values.Finish),
        *(values.GroundKind, values.GroundMaps, values.DefectPatch, values.Model),
        *(Fixture, Paint, PavedSurface, Repairs, StreetObject),
    ),
)


class SceneCache:
    """The cached values of one scene."""

    def __init__(self, world: World, *, seed: int, style: str) -> None:
        """Args:
        world: with its defects. Of one that was never built or loaded, and so has no content hash, nothing is kept.
        style: of its streets: a name, or a YAML file.
        """
        self._folder: Path | None = None
        if world.content_hash:
            beside_hash = [(street.latin_name, street.bridges) for street in world.streets]
            inputs = (
                world.content_hash,
                world.defects_hash,
                beside_hash,
                seed,
                style_sha256(style),
                street_style(style),
            )
            self._folder = cache_folder("tiles") / short_sha256(f"{inputs!r} {made_by(*MADE_BY)}")

    def kept(self, name: str, make: Callable[[], Value], /) -> Value:
        """A value: from its file, else made and written.

        Args:
            name: of the value in this scene; a path where there are many.
            make: gives one of the classes that are listed in this module, or a container of such.
        """
        return made(name, make) if self._folder is None else _STORE.kept(self._folder / name, make)

    @property
    def keeps(self) -> bool:
        """Whether values of this scene are cached; False where the cache cannot be written."""
        if self._folder is None:
            return False
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=self._folder):
                return True
        return False

    def lacks(self, name: str) -> bool:
        """Whether a value of a scene with a content hash is not there; one that is counts as used now."""
        if self._folder is None:
            return False
        mark_used(self._folder / name)
        return not (self._folder / name).exists()


def kept_of_all(name: str, make: Callable[[], Value]) -> Value:
    """A value that is the same in every scene, as `SceneCache.kept` keeps others."""
    return _STORE.kept(cache_folder("tiles") / short_sha256(made_by(*MADE_BY)) / name, make)


SCENE_SEED: Final = 0
"""Seed of what a world leaves open, such as colours of cars and stains of roads: a world looks the same in every
dataset and mission."""

TILES_KEPT: Final = 8  # Tiles in memory; renderers keep their own copies on the device
PATCHES_KEPT: Final = 96
"""Whole patches in memory, some MB each at most, since the other parts of one lie on the next tiles."""

THIN_KEPT: Final = 512
"""Tiles whose wires and twigs are in memory, some KB each: they are needed again under every light."""

EAVES_M: Final = 0.35
"""Greatest overhang of roofs beyond walls."""


class Scene:
    """Everything visible of a world. The same world and seed give the same scene, tile by tile, in any order."""

    def __init__(self, world: World, *, seed: int, style: str = DEFAULT_STYLE, tiles_kept: int = TILES_KEPT) -> None:
        """Args:
        style: of the streets: a name, or a YAML file.

        Raises:
            PaveTwinError: there is no such style.
        """
        keep_freed()
        self.style, self._street_style = style, street_style(style)
        self.world = world
        self.seed = seed
        self._cache = SceneCache(world, seed=seed, style=style)
        self._kept = self._cache.kept
        self._tile = lru_cache(tiles_kept)(lambda key: self._kept(_name(key, "tile"), lambda: self._make(key)))
        self._patch = lru_cache(PATCHES_KEPT)(self._patch_of)
        self._thin = lru_cache(THIN_KEPT)(self._thin_of)
        self._actors: Actors | None = None

    def tile(self, key: TileKey) -> Tile:
        """One tile; made if it is not in the cache."""
        return self._tile(key)

    def maps(self, key: TileKey) -> GroundMaps:
        """The weathering and marking maps of a tile's ground; not held in memory."""
        return self._kept(_name(key, "maps"), lambda: ground_maps(self._plan, key))

    def holes_on(self, key: TileKey) -> Mapping[int, Bounds]:
        """The holes in a tile's ground that defects fill, by the defects' places in the world's list."""
        return {number: self._holes[number].bounds for number in self._defects.get(key, [])}

    def hole(self, number: int) -> Polygon:
        """The hole in the ground that a defect fills, by the defect's place in the world's list; world frame."""
        return self._holes[number]

    def patch_on(self, key: TileKey, number: int) -> DefectPatch | None:
        """The part of a defect's patch that lies on a tile; None if there is none."""
        return part_on(self._patch(number), key)

    def patches_on(self, key: TileKey) -> Iterator[DefectPatch]:
        """All patches that fill the holes in a tile's ground."""
        parts = (self.patch_on(key, number) for number in self._defects.get(key, []))
        return (part for part in parts if part is not None)

    def make_plan(self, *, ahead: bool = False) -> None:
        """Put the plan of the ground, which all tiles need, into the cache, unless it is there.

        Args:
            ahead: another process makes it at the same time, and they begin with different parts.
        """
        if self._cache.lacks(LAST_PART):
            if ahead:
                _ = self._plan.repairs, self._plan.gutters, self._extras
            _ = self._plan.markings, self._plan.paint

    def make_missing(self, key: TileKey, defects: Iterable[int], *, ground: bool) -> None:
        """Add the missing values of a tile to the cache.

        Args:
            defects: whose patches are wanted, by their places in the world's list.
            ground: whether the maps of its ground are wanted.
        """
        for number in defects:
            if self._ships(number) and self._cache.lacks(self._patch_name(number)):
                self._patch(number)
        if ground and self._cache.lacks(_name(key, "maps")):
            self.maps(key)
        if self._cache.lacks(_name(key, "tile")):
            self.tile(key)

    def keys_near(self, x_m: float, y_m: float, radius_m: float) -> tuple[TileKey, ...]:
        """The tiles with any part within a disc, also of a house that extends beyond its tile; nearest first."""
        reach = radius_m + self._furthest_reach
        around = keys_of((x_m - reach, y_m - reach, x_m + reach, y_m + reach))
        distances = {key: _distance(self._boxes.get(key, tile_bounds(key)), x_m, y_m) for key in around}
        near = [key for key, distance in distances.items() if distance <= radius_m]
        return tuple(sorted(near, key=lambda key: (distances[key], key)))

    @cached_property
    def models(self) -> Mapping[str, Model]:
        """All instanced models, by name."""
        return kept_of_all("models", lambda: {**library(), **shafts(), **bare_trees(), **fixture_models()})

    @cached_property
    def details(self) -> Mapping[GroundKind, Detail]:
        """The detail textures of each kind of ground."""
        return details()

    @cached_property
    def facade_textures(self) -> UInt8Array:
        """(layers, k, k, 4): sRGB-coded reflectance, and roughness; repeats every `FACADE_REPEAT_M`. Row 0 is v = 0."""
        return facade_textures(self.seed)

    def agents(
        self, recording: Recording | None, time_s: float, near: tuple[float, float, float] | None = None
    ) -> tuple[Instance, ...]:
        """The dynamic objects at a time: agents with their labels, and signal heads with their lamps.

        Args:
            recording: None for empty streets and dark signals.
            time_s: of the recording.
            near: x, y, radius of a disc in metres; only objects within it are returned.
        """
        heads = [
            head for head in self._heads if near is None or math.dist(near[:2], (head.x_m, head.y_m)) < near[2] + 1
        ]
        shown = tuple(signals.instances(heads, recording, time_s))
        if recording is None:
            return shown
        if self._actors is None or self._actors.recording is not recording:
            self._actors = Actors(recording, seed=self.seed, models=self.models, ground=self.heights)
        return (*self._actors.at(time_s, near), *shown)

    def parked(self, vehicles: ParkedVehicles, near: tuple[float, float, float] | None = None) -> tuple[Instance, ...]:
        """Parked vehicles with their labels; `near` as in `agents`."""
        return self._parked.of(vehicles if near is None else vehicles.near(*near))

    def heights(self, xy: npt.ArrayLike) -> Float64Array:
        """Height of the ground [m] at points (n, 2) in the world frame."""
        return heights(self._plan, xy)

    def strips_on(self, key: TileKey, to_sun: Float64Array) -> Float64Array:
        """(n, 8): the strips of ground that a tile's wires and twigs shade (`thin.shaded_strips`), for a sun (3,)."""
        thin = self._thin(key)
        return shaded_strips(thin, to_sun, self.heights) if len(thin) else np.zeros((0, 8))

    def level_ground(self, key: TileKey) -> tuple[GroundPiece, ...]:
        """The ground of a tile without the holes that defects fill."""
        return ground_pieces(self._plan, key, has_holes=False)

    def houses_on(self, key: TileKey, detail: HouseDetail) -> tuple[FacadePiece, ...]:
        """The houses of a tile at a level of detail, in its frame."""
        made = [self._builder.pieces(number, tile_origin(key), detail) for number in self._buildings.get(key, [])]
        return tuple(piece for pieces in made for piece in pieces)

    def standing_on(self, key: TileKey) -> tuple[Instance, ...]:
        """The furniture, objects, wires and covers of a tile."""
        return (*self._standing(key), *self._wire_instances.get(key, ()), *fixtures(self._plan, key))

    def extent(self, key: TileKey) -> Bounds:
        """The bounds of all that a tile holds: its square, and what stands beyond it."""
        return self._boxes.get(key, tile_bounds(key))

    def buildings_on(self, key: TileKey) -> Sequence[int]:
        """Places in the world's list of the buildings that a tile holds."""
        return self._buildings.get(key, [])

    @cached_property
    def _parked(self) -> ParkedInstances:
        return ParkedInstances(seed=self.seed, models=self.models, ground=self.heights)

    # --- Objects by tile --------------------------------------------------------------------------------------------

    @cached_property
    def _buildings(self) -> Mapping[TileKey, list[int]]:
        """Places in the world's list, by the tile in which a building's middle lies; it is drawn there whole."""
        return _by_tile(
            [(building.polygon.centroid.x, building.polygon.centroid.y) for building in self.world.buildings]
        )

    @cached_property
    def _furniture(self) -> Mapping[TileKey, list[int]]:
        return _by_tile([(item.position.x, item.position.y) for item in self.world.furniture])

    @cached_property
    def _holes(self) -> list[Polygon]:
        return self._kept("holes", lambda: holes_of(self.world.defects))

    @cached_property
    def _defects(self) -> Mapping[TileKey, list[int]]:
        """Places in the world's list of all whose hole may reach into a tile."""
        found: defaultdict[TileKey, list[int]] = defaultdict(list)
        for index, hole in enumerate(self._holes):
            for key in keys_of(hole.bounds):
                found[key].append(index)
        return dict(found)

    @cached_property
    def _walker_poles(self) -> Mapping[TileKey, list[tuple[float, float]]]:
        """Positions of poles with pedestrian signal heads."""
        places = [(head.x_m, head.y_m) for head in self._heads if head.model == signals.WALKERS]
        return {key: [places[index] for index in indices] for key, indices in _by_tile(places).items()}

    @cached_property
    def _extras(self) -> Mapping[TileKey, list[StreetObject]]:
        extras = self._kept("extras", StreetObjects(self.world, seed=self.seed).extras)
        places = [(extra.x_m, extra.y_m) for extra in extras]
        return {key: [extras[index] for index in indices] for key, indices in _by_tile(places).items()}

    @cached_property
    def _wires(self) -> Wires:
        return wires_of(self.world, self._street_style.overhead, self.seed)

    @cached_property
    def _wire_pieces(self) -> Mapping[TileKey, list[int]]:
        return _by_tile([((row[0] + row[3]) / 2, (row[1] + row[4]) / 2) for row in self._wires.pieces.tolist()])

    @cached_property
    def _wire_instances(self) -> Mapping[TileKey, list[Instance]]:
        found = list(wire_instances(self._wires))
        by_tile = _by_tile([place for place, _ in found])
        return {key: [found[index][1] for index in indices] for key, indices in by_tile.items()}

    def _is_bare_tree(self, number: int) -> bool:
        """Whether a piece of furniture is a tree without leaves."""
        is_tree = self.world.furniture[number].kind is FurnitureKind.TREE
        return is_tree and self._plan.chance(f"bare {number}") < self._street_style.overhead.bare_trees

    @cached_property
    def _heads(self) -> tuple[signals.Head, ...]:
        return signals.heads_of(self.world, self.world.carriageway)

    @cached_property
    def _boxes(self) -> Mapping[TileKey, Bounds]:
        """The bounds of every tile with parts beyond its square."""
        boxes: dict[TileKey, Bounds] = {}
        for key, houses in self._buildings.items():
            _widen(boxes, key, [_wider(self.world.buildings[house].polygon.bounds, EAVES_M) for house in houses])
        for key, items in self._furniture.items():
            _widen(boxes, key, [_around(self.world.furniture[item]) for item in items])
        return boxes

    @cached_property
    def _furthest_reach(self) -> float:
        """Greatest distance of any part beyond its tile's square [m]."""
        reaches = [0.0]
        for key, (west, south, east, north) in self._boxes.items():
            x, y = key[0] * TILE_M, key[1] * TILE_M
            reaches += [x - west, y - south, east - x - TILE_M, north - y - TILE_M]
        return max(reaches)

    # --- Making a tile ----------------------------------------------------------------------------------------------

    @cached_property
    def _plan(self) -> GroundPlan:
        return plan_ground(self.world, self.seed, holes=self._holes, style=self._street_style, kept=self._kept)

    def _patch_of(self, number: int) -> DefectPatch:
        if not self._ships(number):
            return self._make_patch(number)
        return self._kept(self._patch_name(number), lambda: self._make_patch(number))

    def _ships(self, number: int) -> bool:
        """Whether a defect's class is ours: the code of a user's own class may have changed."""
        return DEFECT_CLASSES.get(self.world.defects[number].kind).ships

    def _patch_name(self, number: int) -> str:
        middle = self.world.defects[number].centre
        (key,) = keys_of((middle.x, middle.y, middle.x, middle.y))
        return _name(key, f"patch-{number}")

    def _make_patch(self, number: int) -> DefectPatch:
        defect = self.world.defects[number]
        paved = self._plan.paved_in(number)
        return patch_of(defect, paved.kind, paved.finish, self._holes[number])

    @cached_property
    def _builder(self) -> Buildings:
        return Buildings(self.world, seed=self.seed)

    def _make(self, key: TileKey) -> Tile:
        return Tile(
            key=key,
            ground=ground_pieces(self._plan, key),
            facades=self.houses_on(key, HouseDetail.FULL),
            instances=self.standing_on(key),
            thin=self._thin(key),
        )

    def _thin_of(self, key: TileKey) -> Float64Array:
        """(n, 7): wires and twigs on a tile."""
        return self._kept(_name(key, "thin"), lambda: self._make_thin(key))

    def _make_thin(self, key: TileKey) -> Float64Array:
        twigs = [segments for _, segments in self._bare_trees(key)]
        return np.concatenate([self._wires.pieces[self._wire_pieces.get(key, [])], *twigs])

    def _bare_trees(self, key: TileKey) -> Iterator[tuple[Instance, Float64Array]]:
        """The trees without leaves on a tile, each with its segments (n, 7)."""
        for number in self._furniture.get(key, []):
            item = self.world.furniture[number]
            if self._is_bare_tree(number):
                form = int(BARE_FORMS * self._plan.chance(f"form {number}"))
                ground_m = float(self.heights([(item.position.x, item.position.y)])[0])
                turn = math.tau * self._plan.chance(f"turn {number}")
                place, segments = bare_tree_of(item, ground_m, form, turn)
                yield Instance(f"bare_{form}", BODY, place, tints()), segments

    def _standing(self, key: TileKey) -> Iterator[Instance]:
        """The furniture and objects on a tile as instances."""
        yield from (tree for tree, _ in self._bare_trees(key))
        numbers = [number for number in self._furniture.get(key, []) if not self._is_bare_tree(number)]
        items = [self.world.furniture[number] for number in numbers]
        feet = self.heights(np.array([(item.position.x, item.position.y) for item in items]).reshape(-1, 2))
        for number, item, ground_m in zip(numbers, items, feet, strict=True):
            yield from furniture.stand(item, number, float(ground_m), self.seed, self.models)
        for x, y in self._walker_poles.get(key, []):
            low = float(self.heights([(x, y)])[0])
            yield furniture.pole(x, y, low, signals.WALKER_POLE_M, 0.05)
        for extra in self._extras.get(key, []):
            low = float(self.heights([(extra.x_m, extra.y_m)])[0])
            place = upright(extra.x_m, extra.y_m, extra.yaw_rad, z_m=low)
            yield Instance(extra.model, BODY, place, extra.tints)


def _name(key: TileKey, what: str) -> str:
    """Name of a value of a tile in the scene's cache."""
    return f"{key[0]}_{key[1]}/{what}"


def _by_tile(places: Sequence[tuple[float, float]]) -> Mapping[TileKey, list[int]]:
    """Indices of places by the tile that they lie in."""
    found: defaultdict[TileKey, list[int]] = defaultdict(list)
    for index, (x, y) in enumerate(places):
        found[tile_at(x, y)].append(index)
    return dict(found)


def keys_of(bounds: Bounds) -> Iterator[TileKey]:
    """The tiles that a box meets, row by row."""
    west, south, east, north = (math.floor(value / TILE_M) for value in bounds)
    return ((column, row) for row in range(south, north + 1) for column in range(west, east + 1))


def _wider(bounds: Bounds, by_m: float) -> Bounds:
    west, south, east, north = bounds
    return west - by_m, south - by_m, east + by_m, north + by_m


def _around(item: Furniture) -> Bounds:
    reach = max(item.radius_m, item.arm_m) + 1.0
    x, y = item.position.x, item.position.y
    return x - reach, y - reach, x + reach, y + reach


def _widen(boxes: dict[TileKey, Bounds], key: TileKey, bounds: list[Bounds]) -> None:
    corners = np.array([boxes.get(key, tile_bounds(key)), *bounds])
    low, high = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
    boxes[key] = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def _distance(box: Bounds, x_m: float, y_m: float) -> float:
    west, south, east, north = box
    return math.hypot(max(west - x_m, 0.0, x_m - east), max(south - y_m, 0.0, y_m - north))
