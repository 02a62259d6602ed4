"""Captures of several worlds as one dataset of COCO files."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pavetwin.errors import PaveTwinError
from pavetwin.files import link_or_copy, writing
from pavetwin.labels import SPLITS


@dataclass(frozen=True)
class JoinedImages:
    """What a joined dataset holds."""

    images: Counter[str] = field(default_factory=Counter)
    """By split."""
    empty: Counter[str] = field(default_factory=Counter)
    """Images without any label, by split."""
    labelled: Counter[tuple[str, str]] = field(default_factory=Counter)
    """Labels by class and split, without what is ignored."""


def join(folders: Sequence[Path], output: Path) -> JoinedImages:
    """Write `annotations/instances_SPLIT.json` of all captures, and link their images. What is there is replaced.

    Each image also says of which `capture` it is.

    Raises:
        PaveTwinError: captures have other classes than the first, or two images the same name.
    """
    found = JoinedImages()
    kinds: list[dict[str, Any]] | None = None
    for split in SPLITS:
        images: list[dict[str, Any]] = []
        annotations: list[dict[str, Any]] = []
        info: dict[str, Any] = {}
        for folder in folders:
            path = folder / "annotations" / f"instances_{split}.json"
            if not path.is_file():
                continue
            content = json.loads(path.read_text(encoding="utf-8"))
            info, kinds = content["info"], kinds or content["categories"]
            if content["categories"] != kinds:
                raise PaveTwinError(f"'{folder}' has other classes than '{folders[0]}'; captures must have the same.")
            numbers = {image["id"]: len(images) + at for at, image in enumerate(content["images"])}
            images += [{**each, "id": numbers[each["id"]], "capture": folder.name} for each in content["images"]]
            first = len(annotations)
            annotations += [
                {**each, "id": first + at + 1, "image_id": numbers[each["image_id"]]}
                for at, each in enumerate(content["annotations"])
            ]
            for each in content["images"]:
                link_or_copy(
                    folder / "images" / split / each["file_name"], output / "images" / split / each["file_name"]
                )
        if not images:
            continue
        if len({each["file_name"] for each in images}) < len(images):
            raise PaveTwinError("Two captures have images of the same name; name every world differently.")
        content = {"info": info, "licenses": [], "categories": kinds, "images": images, "annotations": annotations}
        with writing(output / "annotations" / f"instances_{split}.json") as temporary:
            temporary.write_text(json.dumps(content, ensure_ascii=False), encoding="utf-8")
        names = {each["id"]: each["name"] for each in kinds or ()}
        shown = {each["image_id"] for each in annotations}
        found.images[split] = len(images)
        found.empty[split] = sum(each["id"] not in shown for each in images)
        found.labelled.update((names[each["category_id"]], split) for each in annotations if not each["iscrowd"])
    return found
