"""Parking places along the streets: from tags and areas of OpenStreetMap, or by a stated rule by type of street.

`place` holds the values of a world. The other modules are needed only while a world is built.
"""

from pavetwin.world.parking.place import ParkingOrientation, ParkingPlace, ParkingPosition, ParkingSource, StreetSide

__all__ = ["ParkingOrientation", "ParkingPlace", "ParkingPosition", "ParkingSource", "StreetSide"]
