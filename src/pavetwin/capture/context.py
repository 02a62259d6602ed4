"""The context that images are drawn from, made from a world and settings; each process makes the same one."""

from collections.abc import Callable
from typing import Final

from pavetwin.capture.defect_index import AIMED_WITHIN_M, DefectIndex
from pavetwin.capture.formats import find_formats
from pavetwin.capture.plan import STREETS
from pavetwin.capture.platforms import PLATFORMS, CaptureContext
from pavetwin.capture.presence import presence
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.splits import split_streets
from pavetwin.config.mission import UavSettings
from pavetwin.errors import PaveTwinError
from pavetwin.navigation.navmesh import navmesh
from pavetwin.plugins import load_plugins
from pavetwin.seeds import Stream, child
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_of
from pavetwin.uav.cameras import find_camera
from pavetwin.world.model import World

RECORDED_S: Final = 600.0
"""Duration of the recorded traffic that images are taken from."""

OnProgress = Callable[[float, str], None]
"""Called with the share done and the current step."""


def check(settings: CaptureSettings) -> None:
    """Check the settings before anything takes time.

    Raises:
        PaveTwinError: a plugin fails; a platform, density, camera or format is not known; an option is missing or out
            of place.
    """
    load_plugins(settings.plugins)
    platform = PLATFORMS.get(settings.platform)
    find_formats(settings.formats)
    find_camera(settings.camera)
    for name in settings.densities:
        density_named(name)
    if platform.uses_altitude and not settings.altitudes_m:
        raise PaveTwinError(f"`altitudes_m`: say how high the {settings.platform} flies, for example `altitudes_m` 10.")
    if settings.altitudes_m and not platform.uses_altitude:
        raise PaveTwinError(f"`altitudes_m`: a {settings.platform} does not fly; leave it out.")
    for altitude in settings.altitudes_m:
        if altitude >= AIMED_WITHIN_M:
            raise PaveTwinError(
                f"`altitudes_m` {altitude:g}: images are to show defects, which must be nearer than "
                f"{AIMED_WITHIN_M:g} m; choose a lower altitude."
            )


def prepare(world: World, settings: CaptureSettings, on_progress: OnProgress | None = None) -> CaptureContext:
    """The context for a world and settings; traffic is recorded where no recording exists.

    Raises:
        PaveTwinError: the world has no defects or too few streets, an altitude leaves nothing to fly in, or the
            traffic cannot be recorded.
    """
    check(settings)
    if not world.defects:
        raise PaveTwinError(f"The world '{world.name}' has no defects to take images of; build it with some.")
    report = on_progress or (lambda _share, _what: None)
    meshes = {}
    for number, altitude in enumerate(settings.altitudes_m):
        report(number / len(settings.altitudes_m), f"Baking the NavMesh at {altitude:g} m")
        meshes[altitude] = navmesh(world, altitude, UavSettings().radius_m)
    recordings: dict[str, Recording] = {}
    for number, name in enumerate(dict.fromkeys(settings.densities)):

        def part(share: float, done: int = number) -> None:
            report((done + share) / len(settings.densities), "Recording traffic")

        recordings[name] = record(world, name, settings.seed, RECORDED_S, on_progress=part)
    reached = PLATFORMS.get(settings.platform).reaches(world, recordings)
    rng, agents = child(settings.seed, Stream.CAPTURE, STREETS), presence(world, recordings.values())
    splits = split_streets(world, settings.split, rng, reached, agents=agents)
    return CaptureContext(
        world=world,
        settings=settings,
        defect_index=DefectIndex(world, splits),
        recordings=recordings,
        traces={name: trace_of(recording) for name, recording in recordings.items()},
        meshes=meshes,
    )
