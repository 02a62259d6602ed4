"""Names of image files: they say where an image is from, and no two datasets give different images one name."""

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Any

from pavetwin.capture.platforms import PLATFORMS
from pavetwin.capture.settings import CaptureSettings, parking_in
from pavetwin.plugins import plugin_hashes
from pavetwin.world.model import World


def platform_prefix(world: World, settings: CaptureSettings, platform: str) -> str:
    """How the names of a platform's images begin: `town-s1-uav-3f9c2a81`.

    Neither the number of images nor the other platforms and label formats of a dataset change it.
    """
    others = {"images", "platforms", "formats", "plugins"}
    if not PLATFORMS.get(platform).uses_altitude:
        others |= {"altitudes_m", "camera", "gsd_mm"}
    if settings.gsd_mm is None:
        others |= {"gsd_mm"}
    if not parking_in(settings, world).enabled:
        others |= {"parking"}
    made_from = settings.model_dump(mode="json", exclude=others)
    made_from["plugins"] = sorted(plugin_hashes(settings.plugins).values())
    return prefix(world, settings.seed, platform, made_from)


def prefix(world: World, seed: int, taken_by: str, made_from: Mapping[str, Any]) -> str:
    """World, seed, what took the images, and the beginning of a hash of the world and all that they are made from."""
    content = [world.content_hash, world.defects_hash, seed, taken_by, dict(made_from)]
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8]
    name = re.sub(r"[^A-Za-z0-9]+", "-", world.name).strip("-")[:40] or "world"
    return f"{name}-s{seed}-{taken_by}-{digest}"


def image_name(prefix: str, index: int) -> str:
    """Of the n-th image with a prefix, without the file's suffix."""
    return f"{prefix}-{index:06d}"
