"""What can be said about a world's parking places together."""

import numpy as np
import shapely

from pavetwin.arrays import Float64Array
from pavetwin.world.model import World


def on_carriageway(world: World) -> Float64Array:
    """The share of each place's area that lies on the segments of its world, 0 … 1, (places,)."""
    places = np.array([place.polygon for place in world.parking], dtype=object)
    surfaces = np.array([segment.polygon for segment in world.segments], dtype=object)
    place, surface = shapely.STRtree(surfaces).query(places, predicate="intersects")
    shared = shapely.area(shapely.intersection(places[place], surfaces[surface]))
    covered = np.bincount(place, weights=shared, minlength=len(places))
    return np.asarray(covered / shapely.area(places), dtype=np.float64)
