"""NavMesh baking and path queries on a made-up square kilometre of streets."""

from collections.abc import Iterator
from math import cos, pi, sin

import numpy as np
import numpy.typing as npt

from benchmarks.measure import Kind, Line, Size, median_s
from pavetwin._core import NavMesh
from pavetwin.config.mission import UavSettings
from pavetwin.navigation.navmesh import VOXEL_M

SPACING_M, WIDTH_M = 100.0, 18.0
YAW_RAD = pi / 6
"""Streets at an angle to the voxels are the more expensive case."""


def bake(vertices: npt.NDArray[np.float64], triangles: npt.NDArray[np.uint32]) -> NavMesh:
    return NavMesh.bake(vertices, triangles, cell_size_m=VOXEL_M, agent_radius_m=UavSettings().radius_m)


def street_grid(size_m: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.uint32]]:
    """Vertices (n, 2) and triangles (m, 3) of streets 18 m wide and 100 m apart, both ways."""
    east = np.array([cos(YAW_RAD), sin(YAW_RAD)])
    north = np.array([-east[1], east[0]])
    corners: list[npt.NDArray[np.float64]] = []
    for middle in np.arange(SPACING_M / 2, size_m, SPACING_M):
        for along, across in ((east, north), (north, east)):
            low, high = middle - WIDTH_M / 2, middle + WIDTH_M / 2
            corners += [along * s + across * side for s, side in ((0, low), (size_m, low), (size_m, high), (0, high))]
    first = np.arange(0, len(corners), 4, dtype=np.uint32)
    triangles = np.concatenate([first[:, None] + [0, 1, 2], first[:, None] + [0, 2, 3]])
    return np.array(corners), triangles.astype(np.uint32)


def lines(size: Size) -> Iterator[Line]:
    """Bake and path on the first square, and a path on each other one."""
    first_m, *others_m = size.streets_m
    vertices, triangles = street_grid(first_m)
    bake_s = median_s(lambda: bake(vertices, triangles), size.runs)
    mesh = bake(vertices, triangles)
    streets, polygons = 2 * round(first_m / SPACING_M), len(mesh.offsets()) - 1
    yield Line(
        f"NavMesh of {_area(first_m)} of streets",
        bake_s,
        Kind.SECONDS,
        3.0,
        note=f"{streets} streets, {polygons} polygons",
    )
    runs = 100 * size.runs
    across_s = _across_s(mesh, first_m, runs)
    yield Line("path query on it, corner to corner", across_s, Kind.SECONDS, 0.2e-3)
    rng = np.random.default_rng(1)
    points = [tuple(point) for point in mesh.vertices()[rng.integers(0, len(mesh.vertices()), 2 * runs)]]
    pairs = iter(list(zip(points[::2], points[1::2], strict=True)) * 2)
    yield Line(
        "path query on it, any two places",
        median_s(lambda: mesh.path(*next(pairs)), runs, warm_up=10),
        Kind.SECONDS,
        0.2e-3,
    )
    for side_m in others_m:
        across_s = _across_s(bake(*street_grid(side_m)), side_m, 20 * size.runs)
        yield Line(f"path query on {_area(side_m)}, corner to corner", across_s, Kind.SECONDS)


def _area(side_m: float) -> str:
    return f"{side_m**2 / 1e6:g} km²"


def _across_s(mesh: NavMesh, size_m: float, runs: int) -> float:
    start, goal = _place(SPACING_M / 2, 25.0), _place(size_m - 25.0, size_m - SPACING_M / 2)
    return median_s(lambda: mesh.path(start, goal), runs, warm_up=3)


def _place(along_m: float, aside_m: float) -> tuple[float, float]:
    return along_m * cos(YAW_RAD) - aside_m * sin(YAW_RAD), along_m * sin(YAW_RAD) + aside_m * cos(YAW_RAD)
