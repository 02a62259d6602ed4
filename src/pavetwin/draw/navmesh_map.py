"""The map of a NavMesh: its convex polygons over a pale world, and the obstacles at that altitude."""

from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import shapely
from shapely import Geometry, Polygon

from pavetwin._core import NavMesh
from pavetwin.draw import shapes, style
from pavetwin.draw.extent import credit, world_bounds
from pavetwin.draw.style import LegendEntry
from pavetwin.draw.world_map import EVERYTHING, MapLayer, draw_world
from pavetwin.navigation.navmesh import navmesh, obstacles, part_at, polygons, segments_in_reach
from pavetwin.world.model import World
from pavetwin.world.solids import solids

FREE, FREE_EDGE = "#9CC7E3", "#3C7FA8"
CUT_OFF, CUT_OFF_EDGE = "#F2B977", "#B8741A"
BLOCKED, BLOCKED_EDGE = "#9A7A72", "#5E4640"
UNREACHABLE = "#B2182B"


@dataclass(frozen=True)
class NavMeshReport:
    """A NavMesh and the facts shown with it."""

    world: World
    altitude_m: float
    mesh: NavMesh
    polygons: tuple[Polygon, ...]
    connected: tuple[bool, ...]
    """For each polygon, whether the base lies in the same part of the mesh."""
    obstacles: tuple[Geometry, ...]
    """Objects that reach this altitude; those that touch are merged."""
    reachable: tuple[bool, ...]
    """For each segment, whether its middle can be reached from the base."""
    seconds: float
    """Time to bake it, including the flight domain."""

    @property
    def share_reachable(self) -> float:
        return sum(self.reachable) / len(self.reachable)


def bake(world: World, altitude_m: float, agent_radius_m: float) -> NavMeshReport:
    """Bake the mesh (identical to the one that missions cache with the world) and find what can be reached.

    Raises:
        PaveTwinError: there is no free airspace at this altitude.
    """
    standing = solids(world)
    start = perf_counter()
    mesh = navmesh(replace(world, folder=None), altitude_m, agent_radius_m, standing)
    seconds = perf_counter() - start
    home, cells = part_at(mesh, world.base), tuple(polygons(mesh))
    return NavMeshReport(
        world=world,
        altitude_m=altitude_m,
        mesh=mesh,
        polygons=cells,
        connected=tuple(part_at(mesh, cell.representative_point()) == home for cell in cells),
        obstacles=tuple(shapely.get_parts(shapely.union_all(obstacles(standing, altitude_m), grid_size=0.01))),
        reachable=segments_in_reach(world, mesh),
        seconds=seconds,
    )


def save_navmesh_map(baked: NavMeshReport, path: Path) -> None:
    """Write the map of a NavMesh as an image.

    Raises:
        PaveTwinError: it cannot be written.
    """
    world, layers = baked.world, EVERYTHING - {MapLayer.FURNITURE, MapLayer.MARKINGS, MapLayer.TREES}
    bounds = world_bounds(world)
    words = f"{len(baked.polygons)} convex polygons, {baked.mesh.area_m2():.0f} m²"
    share = f"{sum(baked.reachable)} of {len(baked.reachable)} segments within reach of the base"
    with style.styled():
        figure_ = style.map_figure(
            bounds,
            title=f"{world.name}: NavMesh at {baked.altitude_m:g} m",
            subtitle=f"{words}  ·  {share}",
            credit=credit(world),
            legend=_legend(baked),
        )
        draw_world(figure_.axes, world, bounds=bounds, layers=layers, defects=False, muted=True)
        fine = min(0.5, max(0.12, 0.25 * shapes.points_per_m(figure_.axes)))
        for connected, face, edge in ((True, FREE, FREE_EDGE), (False, CUT_OFF, CUT_OFF_EDGE)):
            cells = [cell for cell, joined in zip(baked.polygons, baked.connected, strict=True) if joined is connected]
            shapes.fill(figure_.axes, cells, 20, face, alpha=0.62)
            rings = [shapely.get_coordinates(cell.exterior) for cell in cells]
            shapes.strokes(figure_.axes, rings, 21, edge, fine)
        shapes.fill(figure_.axes, baked.obstacles, 22, BLOCKED, BLOCKED_EDGE, 0.3, alpha=0.8)
        lost = [s.centre_line for s, ok in zip(world.segments, baked.reachable, strict=True) if not ok]
        shapes.strokes(figure_.axes, [shapely.get_coordinates(line) for line in lost], 23, UNREACHABLE, 1.6)
        style.save_figure(figure_.figure, path)


def _legend(baked: NavMeshReport) -> list[LegendEntry]:
    entries = (
        (True, LegendEntry("polygon, joined with the base", "patch", FREE, FREE_EDGE)),
        (not all(baked.connected), LegendEntry("polygon, cut off", "patch", CUT_OFF, CUT_OFF_EDGE)),
        (baked.obstacles, LegendEntry("obstacle at this altitude", "patch", BLOCKED, BLOCKED_EDGE)),
        (not all(baked.reachable), LegendEntry("segment out of reach", "line", UNREACHABLE, size_pt=1.6)),
        (True, LegendEntry("base", "o", style.BASE, size_pt=5.5)),
    )
    return [entry for shown, entry in entries if shown]
