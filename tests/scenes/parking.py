"""Parking places of tiny streets, and the cars that stand in them."""

from dataclasses import replace
from itertools import count
from pathlib import Path

from shapely import Point

from pavetwin.config.conditions import Conditions
from pavetwin.config.mission import ParkingSettings
from pavetwin.traffic.parked import parked_vehicles
from pavetwin.world.model import World
from pavetwin.world.parking import ParkingOrientation, ParkingPlace, ParkingPosition, ParkingSource, StreetSide
from pavetwin.world.store import save_world
from scenes import damaged
from scenes.tiny import Scene, straight

FULL, EMPTY = "parking.occupancy=1", "parking.enabled=false"


def kerb_place(
    x: float,
    y: float,
    *,
    name: str = "p",
    length_m: float = 5.2,
    width_m: float = 2.0,
    yaw_rad: float = 0.0,
    segment: str = "street",
) -> ParkingPlace:
    """A place at (x, y); its id is numbered so that what parks there under seed 0 is a car."""
    for number in count():
        place = ParkingPlace(
            id=f"{name}{number}",
            street=segment,
            segment=segment,
            side=StreetSide.LEFT,
            position=ParkingPosition.LANE,
            orientation=ParkingOrientation.PARALLEL,
            centre=Point(x, y),
            yaw_rad=yaw_rad,
            length_m=length_m,
            width_m=width_m,
            source=ParkingSource.TAGGED,
        )
        stands = parked_vehicles(with_places(straight(), place), ParkingSettings(occupancy=1.0), Conditions(), 0)
        if stands.length_m[0] > 3.5:
            return place
    raise AssertionError


def with_places(world: World, *places: ParkingPlace) -> World:
    """The world with these places and no others."""
    return replace(world, parking=places)


def save_cross_with_rows(folder: Path, per_segment: int) -> Path:
    """The cross with `per_segment` defects and a row of four places on the carriageway of every segment."""
    bare = damaged("cross", per_segment)
    places = [
        kerb_place(at.x, at.y, name=f"{segment.id}-{number}-", segment=segment.id, length_m=6.0, width_m=2.4)
        for segment in bare.world.segments
        for number in range(4)
        for at in [segment.centre_line.interpolate((number + 1) / 5, normalized=True)]
    ]
    save_world(replace(bare, world=with_places(bare.world, *places)), folder)
    return folder


def narrow_street() -> Scene:
    """A car is parked on defect 0 and takes half of a street 4 m wide; defect 1 lies free."""
    return Scene(with_places(straight((30, 0.8), (45, 0), width_m=4.0), kerb_place(30, 0.8)))


def full_street() -> Scene:
    """Cars stand at both kerbs from end to end of a street of 12 m."""
    places = [
        kerb_place(3.0 + 6.0 * k, y, name=f"{k}{side}") for k in range(10) for side, y in (("l", 4.8), ("r", -4.8))
    ]
    return Scene(with_places(straight((27, 4.8), (30, 0), width_m=12.0), *places), altitude_m=10.0)
