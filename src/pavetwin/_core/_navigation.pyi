"""Where the UAV may fly, and what its airframe can do."""

from typing import Final

from pavetwin.arrays import Float64Array, UInt32Array

Point = tuple[float, float]
"""East and north, metres."""

class NavMesh:
    """Where the UAV may fly at one altitude: convex polygons baked by Recast."""

    @staticmethod
    def bake(vertices: Float64Array, triangles: UInt32Array, *, cell_size_m: float, agent_radius_m: float) -> NavMesh:
        """From a flight domain: vertices (n, 2), triangles (m, 3) of any winding."""

    @staticmethod
    def from_polygons(vertices: Float64Array, offsets: UInt32Array, corners: UInt32Array) -> NavMesh:
        """From saved polygons: polygon i is vertices[corners[offsets[i]:offsets[i + 1]]]."""

    def vertices(self) -> Float64Array:
        """(n, 2)."""

    def offsets(self) -> UInt32Array:
        """(polygons + 1,) into `corners`."""

    def corners(self) -> UInt32Array:
        """Indices of vertices, polygon after polygon, counter-clockwise."""

    def area_m2(self) -> float: ...
    def contains(self, east_m: float, north_m: float) -> bool: ...
    def nearest(self, east_m: float, north_m: float) -> Point:
        """The closest point of the mesh."""

    def component_of(self, east_m: float, north_m: float) -> int | None:
        """The connected part that a point lies in; none outside the mesh."""

    def path(self, start: Point, goal: Point) -> Float64Array:
        """The shortest way (k, 2), both ends included."""

class Limits:
    """What the airframe can do."""

    def __init__(
        self,
        *,
        speed_mps: float,
        acceleration_mps2: float,
        yaw_rate_rad_s: float,
        airspeed_mps: float | None = None,
        wind_mps: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """
        Args:
            speed_mps: cruise speed over the ground.
            acceleration_mps2: acceleration, braking and centripetal acceleration.
            yaw_rate_rad_s: angular speed about the vertical.
            airspeed_mps: highest speed through the air; None for an airframe that the wind does not slow down.
            wind_mps: velocity of the air over the ground, (east, north).

        Raises:
            PaveTwinError: a value is not above 0, or the airspeed is not above the wind's speed.
        """

    speed_mps: Final[float]
    acceleration_mps2: Final[float]
    yaw_rate_rad_s: Final[float]
    airspeed_mps: Final[float | None]
    wind_mps: Final[tuple[float, float]]

    def speed_towards(self, yaw_rad: float) -> float:
        """Highest ground speed towards a yaw: the cruise speed, or less where the wind leaves less of the airspeed."""
