"""Versions of the software that decides the numbers and images of missions, studies and datasets."""

from collections.abc import Iterable, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from platform import python_version
from types import MappingProxyType
from typing import Final

from pavetwin.config import MissionSettings
from pavetwin.defects.registry import DEFECT_CLASSES
from pavetwin.errors import PaveTwinError
from pavetwin.navigation.patterns import PATTERNS
from pavetwin.policies.registered import POLICIES
from pavetwin.registry import packages_of
from pavetwin.sensing.sensor import SENSORS
from pavetwin.uav.aircraft import AIRCRAFT, camera_name
from pavetwin.uav.cameras import CAMERAS
from pavetwin.uav.energy import ENERGY_MODELS

PYTHON: Final = "python"

ALWAYS: Final = ("pavetwin", "libsumo", "numpy", "scipy", "shapely")
"""Distributions that decide a mission's numbers."""

RENDERER: Final = "wgpu"
"""The distribution that decides its images as well."""

ADAPTER: Final = "adapter"
"""The key of the graphics adapter that renders images, with its driver."""

NONE: Final = "none"


def software_versions(
    *, images: bool = False, adapter: str | None = None, packages: Mapping[str, str] = MappingProxyType({})
) -> dict[str, str]:
    """Versions of Python and of what decides a mission's numbers, by distribution.

    Args:
        images: include the renderer, for results that depend on images.
        adapter: the graphics adapter; by default the present one.
        packages: installed packages that give policies, sensors or the like, see `packages_in_use`.
    """
    names = (PYTHON, *ALWAYS, *((RENDERER,) if images else ()))
    found = {name: known for name in names if (known := _version(name))} | dict(packages)
    return found | {ADAPTER: (_adapter() if adapter is None else adapter) or NONE} if images else found


def packages_in_use(settings: MissionSettings, policy: str, defect_classes: Iterable[str] = ()) -> dict[str, str]:
    """Versions of the installed packages that a mission's names come from, by package; see `packages_of`."""
    return packages_of(
        (
            (POLICIES, policy),
            (SENSORS, settings.sensing.sensor),
            (PATTERNS, settings.pattern.kind),
            (ENERGY_MODELS, settings.energy.model),
            *(() if settings.aircraft is None else ((AIRCRAFT, settings.aircraft),)),
            (CAMERAS, camera_name(settings)),
            *((DEFECT_CLASSES, name) for name in defect_classes),
        )
    )


def renderer_of(versions: Mapping[str, str]) -> str | None:
    """The renderer of the images behind a result, in words; None without images."""
    return f"{RENDERER} {versions[RENDERER]}, {versions[ADAPTER]}" if versions.keys() >= {RENDERER, ADAPTER} else None


def version_changes(before: Mapping[str, str], *, adapter: str | None = None) -> list[str]:
    """Changes of versions, in words such as `numpy 1.0 (now 2.1)`.

    Args:
        before: the earlier result of `software_versions`.
        adapter: the present graphics adapter; found if not given.
    """
    now = software_versions(images=not before.keys().isdisjoint((RENDERER, ADAPTER)), adapter=adapter)
    pairs = {
        name: (known or NONE, now.get(name) or _version(name) or "not installed") for name, known in before.items()
    }
    return [f"{name} {then} (now {current})" for name, (then, current) in pairs.items() if then != current]


@cache
def _version(name: str) -> str:
    """Version of Python or a distribution; empty if it is not installed."""
    try:
        return python_version() if name == PYTHON else version(name)
    except PackageNotFoundError:
        return ""


@cache
def _adapter() -> str:
    """The graphics adapter that renders frames; empty without one."""
    from pavetwin.render.adapter import find_adapter  # headless missions load no renderer

    try:
        return str(find_adapter())
    except PaveTwinError:
        return ""
