"""The inputs of a recording except its duration, and their hash."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from pavetwin.errors import PaveTwinError, about
from pavetwin.files import file_sha256
from pavetwin.seeds import Stream, child
from pavetwin.traffic import sumo_run
from pavetwin.traffic.area import TrafficArea
from pavetwin.traffic.closed_loop import FULL, GOALS, PATIENCE, TRIP_M, WALK_M
from pavetwin.traffic.demand import (
    BUSIEST,
    DEFAULT_MIX,
    HOURLY_SHARES,
    HOURS,
    SEARCH,
    USER,
    Capacity,
    Density,
    density_named,
    kinds_of,
    mix_named,
    own_demand,
)
from pavetwin.traffic.job import STEP_S, AreaTraffic, Part, SimulationJob, SpeedLimits
from pavetwin.traffic.kinds import sumo_types
from pavetwin.traffic.recording import Origin
from pavetwin.world.cache import cached
from pavetwin.world.model import LaneKind, World

BEHAVIOUR: Final = 1
"""Version of the demand and the conversion; it is part of the hash."""

AREAS: Final = 1
"""Version of how traffic enters and leaves an area."""

WARM_UP_S: Final = (120.0, 300.0)
"""The shortest and the longest warm-up before a recording: queues at signals need a few cycles to form."""

LEVEL_WARM_UP_S: Final = (300.0, 600.0)
"""Warm-up for a level of service: queues that spill over several junctions take longer."""


@dataclass(frozen=True)
class Inputs:
    """A world, and the traffic to record in it."""

    world: World
    asked: Density | None
    """Density; None for a user's own routes."""
    seed: int
    routes: tuple[Path, ...] = ()
    speed_ratio: float | None = None
    """Speed ratio of the level of service in this world, once it is found."""
    area: TrafficArea | None = None
    """Area with traffic; None for the whole town."""
    area_traffic: AreaTraffic | None = None
    """The vehicles of the area, once they are known (`town_trips`)."""

    @classmethod
    def of(
        cls,
        world: World,
        density: Density | str | None,
        seed: int,
        routes: Sequence[str | Path] = (),
        area: TrafficArea | None = None,
    ) -> "Inputs":
        """`density` is ignored where `routes` are given, and so is `area`: a user's routes are driven everywhere.

        Raises:
            PaveTwinError: both are missing, the density is unknown, a file is not demand, or the seed is negative.
        """
        files = tuple(Path(route) for route in routes)
        asked = None if files else density_named(density) if isinstance(density, str) else density
        if asked is None and not files:
            raise PaveTwinError("No traffic is given: name a density, or your own routes.")
        if seed < 0:
            raise PaveTwinError(f"The seed must be a whole number from 0 up, not {seed}.")
        if files:
            with about("routes"):
                own_demand(files)
        for path in files:
            if "," in str(path):
                raise PaveTwinError(f"SUMO cannot read a file with a comma in its name: '{path}'. Rename it.")
        return cls(world, asked, seed, files, area=None if files else area)

    @property
    def path(self) -> Path:
        """The recording's file, `traffic/<density>-<seed>.parquet` in the world's cache."""
        name = self.asked.name if self.asked else "-".join([USER, *(_stem(path) for path in self.routes)])
        area = "" if self.area is None else f"-{self.area.name}"
        return cached(self.world, f"traffic/{name}-{self.seed}{area}.parquet")

    @cached_property
    def hash(self) -> str:
        try:
            sumo = version("libsumo")
        except PackageNotFoundError:
            sumo = ""
        asked = self.asked
        if asked and asked.is_found:
            asked = replace(asked, vehicles_per_lane_km=None)  # the same before and after it was found
        parts = {
            "behaviour": BEHAVIOUR,
            "world": self.world.content_hash,
            "network": file_sha256(self.world.network_file),
            "density": asdict(asked) if asked else None,
            "seed": self.seed,
            "routes": [file_sha256(path) for path in self.routes],
            **({"search": [SEARCH, *HOURLY_SHARES, BUSIEST]} if asked and asked.is_found else {}),
            **({"hours": HOURS} if asked and asked.hour is not None else {}),
            "types": sumo_types(kinds_of(self.mix)),
            **({"mix": dict(mix_named(self.mix).shares)} if self.mix != DEFAULT_MIX else {}),
            **({"area": [AREAS, *self.area.edges]} if self.area else {}),
            **({"observed on": self.observed_on.edges} if self.observed_on else {}),
            "options": [STEP_S, *sumo_run.OPTIONS, *sumo_run.CLOSED_LOOP_OPTIONS, *self.level_options, *self.warm_up_s],
            "loop": [TRIP_M, *WALK_M, GOALS, PATIENCE, FULL],
            "sumo": sumo,
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    @cached_property
    def observed_on(self) -> TrafficArea | None:
        """The streets on which the vehicles of the area are observed; None for all."""
        return None if self.area is None else self.area.surroundings(self.world)

    @property
    def mix(self) -> str:
        """Mix of vehicles; without meaning for a user's own routes."""
        return self.asked.mix if self.asked else DEFAULT_MIX

    @property
    def level_options(self) -> tuple[str, ...]:
        """SUMO options for traffic at a level of service."""
        return sumo_run.LEVEL_OPTIONS if self.asked and self.asked.is_found else ()

    @property
    def prefers_fastest_goals(self) -> bool:
        """Whether trips lead to the fastest of several random goals, as the paper's do."""
        return not (self.asked and self.asked.is_found)

    @property
    def warm_up_s(self) -> tuple[float, float]:
        """The shortest and the longest warm-up."""
        return LEVEL_WARM_UP_S if self.asked and self.asked.is_found else WARM_UP_S

    @cached_property
    def speed_limits(self) -> SpeedLimits:
        return SpeedLimits.of(self.world)

    @cached_property
    def capacity(self) -> Capacity:
        return Capacity.of(self.world, self.area)

    @cached_property
    def begin_s(self) -> float:
        """SUMO's clock at its first step."""
        return own_demand(self.routes).begin_s if self.routes else 0.0

    def job(self, folder: Path) -> SimulationJob:
        """The job of a simulation in `folder`, which no other simulation uses."""
        types = folder / "types.add.xml"
        types.write_text(sumo_types(kinds_of(self.mix)), encoding="utf-8")
        return SimulationJob(
            folder=str(folder),
            network=str(self.world.network_file.resolve()),
            lanes_of={
                edge: [lane.id for lane in lanes if lane.kind is not LaneKind.PARKING]
                for edge, lanes in self.world.lanes_by_edge.items()
            },
            area=None if self.area is None else frozenset(self.area.edges),
            additional=str(types),
            routes=[str(route.resolve()) for route in self.routes],
            seed=self.seed,
            sumo_seed=int(child(self.seed, Stream.TRAFFIC).integers(1, 2**31 - 1)),
            begin_s=self.begin_s,
            warm_up_s=(0.0, 0.0) if self.asked is None else self.warm_up_s,
            options=self.level_options,
            vehicle_types=[(kind.sumo_id, share) for kind, share in mix_named(self.mix).vehicles],
            fastest_goals=self.prefers_fastest_goals,
            speed_ratio=self.speed_ratio,
            speed_limits=None if self.speed_ratio is None else self.speed_limits,
            vehicles=self._vehicles,
            area_traffic=self.area_traffic,
            pedestrians=self.capacity.pedestrians(self.asked) if self.asked else 0,
        )

    @property
    def _vehicles(self) -> int:
        """Number of vehicles at a time."""
        if self.area_traffic is not None:
            return round(self.area_traffic.vehicles)
        return self.capacity.vehicles(self.asked) if self.asked else 0

    def origin(self, part: Part) -> Origin:
        """Origin of a recording that `part` belongs to."""
        return Origin(
            world=self.world.content_hash,
            inputs=self.hash,
            seed=self.seed,
            asked=self.asked,
            capacity=self.capacity,
            sumo_version=part.sumo_version,
            warm_up_s=part.start_s - self.begin_s,
            area=self.area,
        )


def _stem(path: Path) -> str:
    return path.name.removesuffix(".gz").removesuffix(".xml").removesuffix(".rou")
