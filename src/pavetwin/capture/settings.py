"""The settings that determine a dataset, together with the world."""

from collections.abc import Mapping
from pathlib import Path
from shlex import quote
from typing import Annotated, Any, Final, Literal, Self

import yaml
from pydantic import Field, ValidationError, field_validator, model_validator

from pavetwin.config.mission import Altitude, ParkingSettings
from pavetwin.config.settings import NameOrFile, PluginFiles, Positive, Settings, Share, complaint
from pavetwin.errors import PaveTwinError
from pavetwin.files import FORMAT, check_format, file_sha256
from pavetwin.labels.classes import categories
from pavetwin.mission.versions import ADAPTER, version_changes
from pavetwin.plugins import plugin_hashes
from pavetwin.scene.ground.styles import DEFAULT_STYLE, style_sha256
from pavetwin.traffic.demand import DEFAULT_TRAFFIC
from pavetwin.uav.entries import own_file
from pavetwin.world.model import World

ImageSidePx = Annotated[int, Field(ge=64, le=8192)]

CAMERA_HASH: Final = "camera_sha256"  # Key of a dataset's description: of the file that its camera comes from
STYLE_HASH: Final = "style_sha256"  # The same, of the style of its streets

FILE: Final = "capture.yaml"


class CaptureSettings(Settings):
    """Everything that one dataset is made from."""

    platforms: Annotated[tuple[str, ...], Field(min_length=1)]
    """Names of the registry in pavetwin.capture.platforms."""
    images: Annotated[int, Field(ge=1, le=10_000_000)]
    """Number of images of each platform."""
    seed: Annotated[int, Field(ge=0)] = 0
    gsd_mm: tuple[Positive, Positive] | None = None
    """Finest and coarsest ground resolution of the UAV's images [mm a pixel], one drawn for each, log-uniform: crops of
    the camera's whole frame, from the altitude that gives it. None: whole images from `altitudes_m`."""
    altitudes_m: tuple[Altitude, ...] = ()
    """Altitudes of the UAV, one drawn for each image."""
    densities: Annotated[tuple[str, ...], Field(min_length=1)] = (DEFAULT_TRAFFIC,)
    """Names of the traffic (`pavetwin.traffic.demand.density_named`), one drawn for each image."""
    size_px: tuple[ImageSidePx, ImageSidePx] = (640, 640)
    """Width, height. The camera's vertical field of view is kept, so that a square is its middle; with `gsd_mm` images
    are crops of that size."""
    camera: NameOrFile = "paper"
    """Camera of the UAV: a name of the camera database, or a path to a YAML file of the same form."""
    formats: Annotated[tuple[str, ...], Field(min_length=1)] = ("yolo", "yolo-seg", "voc", "coco")
    split: tuple[Share, Share, Share] = (0.70, 0.15, 0.15)
    """Shares of train, val and test: of the images, and about those of the streets' defects."""
    empty: Share = 0.15
    """Share of images that are to show no defect at all."""
    road_users: Share = 0.0
    """Share of the UAV's images without defects that are taken of a person or a vehicle, in equal parts; the others
    are taken of any place. Few people walk where defects are."""
    parking: ParkingSettings = ParkingSettings()
    """Vehicles parked in the world's places: at the date and time of each image, by the seed."""
    style: NameOrFile = DEFAULT_STYLE
    """Look of the streets: a name that ships with the package, or a path to a YAML file of the same form."""
    picture: Literal["jpg", "png"] = "jpg"
    quality: Annotated[int, Field(ge=50, le=100)] = 92
    """JPEG quality."""
    plugins: PluginFiles = ()
    """Files of the user's own that register defect classes, platforms, formats or cameras."""

    @field_validator("platforms")
    @classmethod
    def _once_each(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(names))

    @property
    def total_images(self) -> int:
        """Over all platforms."""
        return self.images * len(self.platforms)

    @field_validator("gsd_mm")
    @classmethod
    def _finest_first(cls, bounds: tuple[float, float] | None) -> tuple[float, float] | None:
        if bounds is not None and bounds[0] > bounds[1]:
            raise ValueError("the finest ground resolution comes first, then the coarsest")
        return bounds

    @model_validator(mode="after")
    def _shares_sum_to_one(self) -> Self:
        if abs(sum(self.split) - 1) > 1e-6:
            raise ValueError(f"the shares of train, val and test sum to {sum(self.split):g}, not to 1")
        return self


NO_PARKING: Final = ParkingSettings(enabled=False)

JOINED_BY: Final = {"size_px": "x", "split": "/", "formats": ",", "gsd_mm": " "}
"""Separator of options that take several values at once; other options are given several times."""


def settings_of(values: Mapping[str, Any], typed: Mapping[str, str]) -> CaptureSettings:
    """Settings from the command line's options.

    Args:
        typed: by setting, the value as the user typed it, where parsing changed it.

    Raises:
        PaveTwinError: a value does not fit; the message names its setting.
    """
    try:
        return CaptureSettings.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0]) if first["loc"] else "split"  # only the shares of the splits are validated together
        given = first["input"]
        shown = f"{given:g}" if isinstance(given, int | float) else str(given)
        got = f" (got {shown})" if name in typed and first["loc"] else ""
        raise PaveTwinError(f"`{name}` {typed.get(name, shown)}: {complaint(error)}{got}.") from error


def description(settings: CaptureSettings, world: World, versions: Mapping[str, str]) -> dict[str, Any]:
    """Content of a dataset's `capture.yaml` before its first image; plugins must have been loaded.

    Args:
        versions: of the software that takes the images.
    """
    own = own_file(settings.camera)
    parking = parking_in(settings, world).model_dump(mode="json")
    hashes = {"content_hash": world.content_hash, "defects_hash": world.defects_hash}
    return {
        "format": FORMAT,
        "made_by": dict(versions),
        "world": {"name": world.name, **hashes},
        STYLE_HASH: style_sha256(settings.style),
        **({CAMERA_HASH: file_sha256(Path(own))} if own else {}),
        "plugins": {Path(path).name: content for path, content in plugin_hashes(settings.plugins).items()},
        "classes": [category.name for category in categories()],
        "settings": settings.model_dump(mode="json") | {"parking": parking},
    }


def parking_in(settings: CaptureSettings, world: World) -> ParkingSettings:
    """The parking of a dataset: none in a world without places."""
    return settings.parking if world.parking else NO_PARKING


def check_same(folder: Path, expected: dict[str, Any]) -> bool:
    """Return whether a dataset with these settings was begun in `folder`; more images may be requested than before. A
    `capture.yaml` alone is of a run without images, and is ignored.

    Raises:
        PaveTwinError: something else is there, or a dataset with other settings; the message names the first.
    """
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return False
    if not (folder / FILE).is_file():
        raise PaveTwinError(f"'{folder}' exists and holds no dataset; choose another folder.")
    if all(path.name == FILE or path.name.startswith(".") for path in folder.iterdir()):
        return False
    found = read_description(folder)
    if changes := version_changes(found["made_by"], adapter=expected["made_by"][ADAPTER]):
        raise PaveTwinError(
            f"'{folder}' was begun with {', '.join(changes)}, whose pictures may differ; choose another folder or "
            "these versions."
        )
    for key, what in (("content_hash", "another world"), ("defects_hash", "other defects")):
        if found["world"][key] != expected["world"][key]:
            raise PaveTwinError(
                f"'{folder}' holds images of {what} than '{expected['world']['name']}' has now; choose another folder."
            )
    both_own = all(own_file(each["settings"]["camera"]) for each in (found, expected))
    if both_own and found.get(CAMERA_HASH) != expected[CAMERA_HASH]:
        raise PaveTwinError(
            f"'{folder}' was begun with another `camera` than '{expected['settings']['camera']}' holds now; "
            "choose another folder."
        )
    if found[STYLE_HASH] != expected[STYLE_HASH] and found["settings"]["style"] == expected["settings"]["style"]:
        raise PaveTwinError(
            f"'{folder}' was begun with another content of `style` '{expected['settings']['style']}'; "
            "choose another folder."
        )
    if (before := found["plugins"]) != (now := expected["plugins"]):
        raise PaveTwinError(f"'{folder}' was begun {_plugins_differ(before, now)}, or choose another folder.")
    if (labels := found["classes"]) != expected["classes"]:
        only = [name for name in (*labels, *expected["classes"]) if (name in labels) != (name in expected["classes"])]
        raise PaveTwinError(
            f"'{folder}' was begun with other classes of labels than now ({', '.join(only) or 'in another order'}); "
            "give the `plugins` that it was begun with, or choose another folder."
        )
    existing, requested = found["settings"], expected["settings"]
    if both_own:  # the same content, in whichever folder
        existing, requested = ({**each, "camera": Path(each["camera"]).name} for each in (existing, requested))
    for key, value in requested.items():
        if key not in ("images", "plugins") and existing[key] != value:
            raise PaveTwinError(
                f"'{folder}' was begun {_as_parameter(key, existing[key])}, not {_as_parameter(key, value)}; "
                "give the same, or choose another folder."
            )
    if requested["images"] < existing["images"]:
        raise PaveTwinError(
            f"'{folder}' was begun with `images` {existing['images']}, more than {requested['images']}; "
            "choose another folder."
        )
    return True


def read_description(folder: Path) -> dict[str, Any]:
    """A dataset's `capture.yaml`.

    Raises:
        PaveTwinError: there is none, it is damaged, or of another version's format.
    """
    path = folder / FILE
    if not path.is_file():
        raise PaveTwinError(
            f"'{folder}' holds no dataset; make one with `pavetwin capture WORLD --output {quote(str(folder))}`."
        )
    try:
        found = yaml.safe_load(path.read_text(encoding="utf-8"))
        _ = found["format"], found["world"]["name"], found["settings"]["images"], found["classes"]
        _ = found["made_by"]["adapter"]
    except (yaml.YAMLError, OSError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise PaveTwinError(f"'{path}' is damaged; capture into another folder.") from error
    check_format(found["format"], f"'{path}'")
    return dict(found)


def _plugins_differ(before: Mapping[str, str], now: Mapping[str, str]) -> str:
    """Plugins that a dataset was begun with, and how to continue it.

    Args:
        before, now: hashes of the plugin files and of what they read, by name.
    """
    changed = sorted(name for name in before.keys() & now.keys() if before[name] != now[name])
    if changed:
        return f"with another content of {', '.join(changed)}; give the former file as `plugins`"
    if missing := sorted(before.keys() - now.keys()):
        return f"with {', '.join(missing)}, which is not given now; add it by `plugins`"
    return f"without {', '.join(sorted(now.keys() - before.keys()))}; leave it out of `plugins`"


def _as_parameter(key: str, value: Any) -> str:
    """A setting with the name of its parameter."""
    if key == "picture":
        return f"with {value.upper()} images"
    if key == "parking":
        return f"with `parking` {_parking(value)}"
    if value in (None, []):
        return f"without `{key}`"
    values = value if isinstance(value, list) else [value]
    texts = [_plain(100 * each if key == "split" else each) for each in values]
    return f"with `{key}` {JOINED_BY.get(key, ', ').join(texts)}"


def _parking(value: Mapping[str, Any]) -> str:
    """Parking settings in one word."""
    if not value["enabled"]:
        return "none"
    return "by-time" if value["occupancy"] is None else f"{value['occupancy']:g}"


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
