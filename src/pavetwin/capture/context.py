"""The context that images are drawn from, made from a world and settings; each process makes the same one."""

from collections.abc import Mapping, Set
from functools import partial

from pavetwin.capture.formats import FORMATS, find_formats
from pavetwin.capture.image_spec import AIMED_WITHIN_M, DefectIndex, check_resolution
from pavetwin.capture.platforms import PLATFORMS, CaptureContext, flying
from pavetwin.capture.platforms.platform import Airspace
from pavetwin.capture.settings import CaptureSettings
from pavetwin.capture.splits import RECORDED_S, defect_streets, street_splits
from pavetwin.defects.registry import DEFECT_CLASSES, kinds
from pavetwin.errors import PaveTwinError, about, naming
from pavetwin.mission.inputs import OnProgress
from pavetwin.navigation.navmesh import flight_domain
from pavetwin.plugins import load_plugins
from pavetwin.registry import packages_of
from pavetwin.scene.ground.styles import street_style
from pavetwin.traffic.demand import density_named
from pavetwin.traffic.record import record
from pavetwin.traffic.recording import Recording
from pavetwin.traffic.trace import trace_of
from pavetwin.uav.cameras import CAMERAS, find_camera
from pavetwin.world.model import World


def check(settings: CaptureSettings) -> None:
    """Check the settings before anything takes time.

    Raises:
        PaveTwinError: a plugin fails; a platform, density, camera, format or style is unknown; an option is missing or
            out of place.
    """
    load_plugins(settings.plugins)
    flyers = flying(settings.platforms)
    find_formats(settings.formats)
    with naming({CAMERAS.key: "`camera`"}):
        find_camera(settings.camera)
    with about("style"):
        street_style(settings.style)
    for name in settings.densities:
        density_named(name)
    if flyers and not (settings.altitudes_m or settings.gsd_mm):
        raise PaveTwinError(f"`altitudes_m`: give the altitude of the {flyers[0]}, for example `altitudes_m` 10.")
    if settings.altitudes_m and settings.gsd_mm:
        raise PaveTwinError("`gsd_mm`: the ground resolution decides the altitude; give it or `altitudes_m`, not both.")
    for name in ("altitudes_m", "gsd_mm", "road_users"):
        if getattr(settings, name) and not flyers:
            raise PaveTwinError(f"`{name}`: a {settings.platforms[0]} does not fly; leave it out.")
    check_resolution(settings)
    for altitude in settings.altitudes_m:
        if altitude >= AIMED_WITHIN_M and settings.empty < 1:
            raise PaveTwinError(
                f"`altitudes_m` {altitude:g}: images are to show defects, which must be nearer than "
                f"{AIMED_WITHIN_M:g} m; choose a lower altitude, or images that show none (`empty` 1)."
            )


def packages_in_use(settings: CaptureSettings, world: World) -> dict[str, str]:
    """Versions by name of the installed packages that give what checked settings name or a world holds."""
    classes = {defect.kind for defect in world.defects}
    if not classes <= {kind.name for kind in kinds()}:
        DEFECT_CLASSES.names()  # finds those of installed packages
    return packages_of(
        (
            *((PLATFORMS, name) for name in settings.platforms),
            *((FORMATS, name) for name in settings.formats),
            *((DEFECT_CLASSES, name) for name in classes),
            (CAMERAS, settings.camera),
        )
    )


def prepare(
    world: World,
    settings: CaptureSettings,
    on_progress: OnProgress | None = None,
    splits: Mapping[str, str] | None = None,
) -> CaptureContext:
    """The context for a world and settings; traffic is recorded where no recording exists.

    Args:
        splits: of the world's streets, where they are known (`street_splits`).

    Raises:
        PaveTwinError: the world has no defects, defects of a class that is not known, or too few streets; an altitude
            leaves nothing to fly in; or the traffic cannot be recorded.
    """
    check(settings)
    if not world.defects:
        raise PaveTwinError(f"The world '{world.name}' has no defects to take images of; build it with some.")
    for kind in sorted({defect.kind for defect in world.defects}):
        DEFECT_CLASSES.get(kind)  # a class whose plugin is missing is named before anything takes time
    defect_streets(world, settings.split)  # checked before traffic is recorded
    report = on_progress or (lambda _share, _what: None)
    airspace = Airspace.of(world)
    for altitude in settings.altitudes_m:
        flight_domain(world, altitude, airspace.standing)  # names one without free airspace at once
    recordings: dict[str, Recording] = {}
    densities = list(dict.fromkeys(settings.densities))

    def part(done: int, share: float, what: str = "Recording traffic") -> None:
        report((done + share) / (len(densities) + 1), what)

    for number, name in enumerate(densities):
        search = partial(part, number, what=f"Finding the demand of {name}, kept for the next time")
        recordings[name] = record(
            world, name, settings.seed, RECORDED_S, on_progress=partial(part, number), on_search=search
        )
    if splits is None:
        splits = street_splits(world, settings.seed, settings.split, partial(part, len(densities)))
    for name in settings.platforms:
        _check_reached(name, splits, PLATFORMS.get(name).reaches(world, recordings))
    return CaptureContext(
        world=world,
        settings=settings,
        defect_index=DefectIndex(world, splits),
        recordings=recordings,
        traces={name: trace_of(recording) for name, recording in recordings.items()},
        airspace=airspace,
    )


def _check_reached(platform: str, splits: Mapping[str, str], reached: Set[str]) -> None:
    """Check that a platform can take images in every split, which may have been made for another."""
    for split in dict.fromkeys(splits.values()):
        if not any(street in reached for street, its in splits.items() if its == split):
            raise PaveTwinError(
                f"No {platform} comes to a street of the split {split} in the recorded traffic; choose another "
                "density of `densities`, another `seed`, other `split` shares, or a larger world."
            )
