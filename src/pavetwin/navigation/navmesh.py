"""The flight domain at an altitude, road corridors minus obstacles, and its baked NavMesh, cached."""

import itertools
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import shapely
from shapely import Geometry, Polygon

from pavetwin._core import NavMesh
from pavetwin.arrays import Float64Array, UInt32Array
from pavetwin.config.mission import VERTICAL_CLEARANCE_M, check_altitude
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.world.cache import cached
from pavetwin.world.layers import write_layer
from pavetwin.world.model import World
from pavetwin.world.solids import Solids, solids

CORRIDOR_MARGIN_M = 4.0
"""Width of the corridor beyond the carriageway and the junctions."""


@dataclass(frozen=True)
class FlightDomain:
    """The free plane at one altitude, in the world frame."""

    altitude_m: float
    surface: Geometry
    """Polygon or MultiPolygon, valid, not empty."""

    def triangles(self) -> tuple[Float64Array, UInt32Array]:
        """The surface as a triangle list: vertices (n, 2) in metres, triangles (m, 3) into them."""
        parts = shapely.get_parts(shapely.constrained_delaunay_triangles(self.surface))
        corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3].reshape(-1, 2)
        vertices, index = np.unique(corners, axis=0, return_inverse=True)
        return vertices, index.reshape(-1, 3).astype(np.uint32)


def corridors(world: World) -> Geometry:
    """Segments and junctions, widened by the corridor's margin."""
    surfaces = [segment.polygon for segment in world.segments] + [junction.polygon for junction in world.junctions]
    return shapely.union_all(shapely.buffer(surfaces, CORRIDOR_MARGIN_M, quad_segs=4))


def obstacles(standing: Solids, altitude_m: float) -> list[Polygon]:
    """The bases of all solids that reach into altitude ± clearance."""
    met = standing.between(altitude_m - VERTICAL_CLEARANCE_M, altitude_m + VERTICAL_CLEARANCE_M)
    return [Polygon(standing.base(int(index))) for index in met]


def flight_domain(world: World, altitude_m: float, standing: Solids | None = None) -> FlightDomain:
    """The flight domain of a world at an altitude.

    Raises:
        PaveTwinError: the altitude is outside the limits, or no free area is left.
    """
    check_altitude(altitude_m)
    blocked = obstacles(standing if standing is not None else solids(world), altitude_m)
    surface = shapely.difference(corridors(world), shapely.union_all(blocked)) if blocked else corridors(world)
    polygons = [part for part in shapely.get_parts(surface) if isinstance(part, Polygon) and part.area > 1.0]
    if not polygons:
        raise PaveTwinError(
            f"`altitude_m` {altitude_m:g}: no flight domain is left over '{world.name}'; "
            "every corridor is built over. Choose another altitude."
        )
    return FlightDomain(altitude_m, shapely.simplify(shapely.union_all(polygons), 0.02))


VOXEL_M = 0.25

_FORMAT = 1


def navmesh(world: World, altitude_m: float, agent_radius_m: float, standing: Solids | None = None) -> NavMesh:
    """The NavMesh at an altitude, baked by Recast, or read from the cache.

    Raises:
        PaveTwinError: no flight domain is left at this altitude.
    """
    place = _place(world, altitude_m, agent_radius_m)
    if place is not None and place.is_file() and (mesh := _load(place)) is not None:
        return mesh
    vertices, triangles = flight_domain(world, altitude_m, standing).triangles()
    mesh = NavMesh.bake(vertices, triangles, cell_size_m=VOXEL_M, agent_radius_m=agent_radius_m)
    if place is not None:
        _save(mesh, place)
    # Equal to the cached mesh: building it from polygons renumbers them, which decides between equal paths.
    return NavMesh.from_polygons(mesh.vertices(), mesh.offsets(), mesh.corners())


def polygons(mesh: NavMesh) -> list[shapely.Polygon]:
    """The convex polygons of a mesh, in the world frame."""
    vertices, corners, offsets = mesh.vertices(), mesh.corners(), mesh.offsets()
    return [shapely.Polygon(vertices[corners[a:b]]) for a, b in itertools.pairwise(offsets)]


def part_at(mesh: NavMesh, place: shapely.Point) -> int | None:
    """The connected part of a mesh that a place lies in or next to."""
    return mesh.component_of(*mesh.nearest(place.x, place.y))


def segments_in_reach(world: World, mesh: NavMesh) -> tuple[bool, ...]:
    """For each segment, True if a way leads from the base to its middle."""
    base = part_at(mesh, world.base)
    middles = (segment.centre_line.interpolate(0.5, normalized=True) for segment in world.segments)
    return tuple(base is not None and part_at(mesh, middle) == base for middle in middles)


def save_geopackage(mesh: NavMesh, world: World, path: Path) -> None:
    """Write the polygons as one georeferenced GeoPackage layer.

    Raises:
        PaveTwinError: it cannot be written.
    """
    shapes = polygons(mesh)
    with writing(path) as temporary:
        temporary.unlink()
        numbers = {"polygon": np.arange(len(shapes))}
        write_layer(temporary, "navmesh", "Polygon", shapes, numbers, world.georeference)


def _place(world: World, altitude_m: float, agent_radius_m: float) -> Path | None:
    """The mesh's file in the cache; None for a world that is not saved."""
    if world.folder is None or not world.content_hash:
        return None
    inputs = (_FORMAT, world.content_hash, altitude_m, agent_radius_m, VOXEL_M, CORRIDOR_MARGIN_M, VERTICAL_CLEARANCE_M)
    name = sha256(repr(inputs).encode()).hexdigest()[:12]
    return cached(world, f"navmesh/{altitude_m:g}m-{name}.npz")


def _save(mesh: NavMesh, path: Path) -> None:
    try:
        with writing(path) as temporary:
            np.savez_compressed(
                temporary, vertices=mesh.vertices(), offsets=mesh.offsets(), corners=mesh.corners(), allow_pickle=False
            )
    except PaveTwinError:
        return  # on a read-only disk the mesh is baked each time


def _load(path: Path) -> NavMesh | None:
    try:
        with np.load(path, allow_pickle=False) as cached:
            return NavMesh.from_polygons(cached["vertices"], cached["offsets"], cached["corners"])
    except Exception:  # NumPy, zip and zlib raise different errors for a damaged file: it is baked again
        return None
