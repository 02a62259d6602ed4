"""Photographs without labels, from which training takes how real streets look."""

from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Final

from PIL import Image

from pavetwin.errors import PaveTwinError
from pavetwin.files import PICTURE_SUFFIXES
from pavetwin.training.datasets.examples import Example, ExampleSet, read_coco
from pavetwin.training.datasets.packs import read_pack

SPLIT: Final = "train"
"""Of a dataset, the images that are taken: what a network is measured on must not shape it."""


def read_unlabelled(path: Path) -> ExampleSet:
    """The photographs of a folder and the folders within; or of a dataset's training split, without its labels.

    Args:
        path: a folder of pictures, a folder with COCO files, or a packed file. Synthetic images are left out.

    Raises:
        PaveTwinError: there is no photograph, or a file cannot be read.
    """
    if not path.exists():
        raise PaveTwinError(f"`photographs`: there is no folder '{path}'.")
    if path.is_file():
        data = read_pack(path, (SPLIT,))
    elif (path / "annotations").is_dir():
        data = read_coco(path, (SPLIT,))
    else:
        data = _of_folder(path)
    found = tuple(replace(each, objects=()) for each in data.examples if not each.is_synthetic)
    if not found:
        kinds = ", ".join(sorted(each.removeprefix(".") for each in PICTURE_SUFFIXES))
        raise PaveTwinError(
            f"`photographs`: '{path}' holds no photograph; it is a folder of pictures ({kinds}), or a dataset whose "
            f"split '{SPLIT}' has some."
        )
    return replace(data, examples=found)


def _of_folder(folder: Path) -> ExampleSet:
    """The pictures; the fingerprint is of their names and lengths, so that nothing has to be read whole."""
    digest, examples = sha256(), []
    for file in sorted(folder.rglob("*")):
        if file.suffix.lower() not in PICTURE_SUFFIXES or not file.is_file():
            continue
        name = file.relative_to(folder).as_posix()
        try:
            with Image.open(file) as picture:
                size = picture.size
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise PaveTwinError(f"`photographs`: '{file}' cannot be read as an image ({error}).") from error
        digest.update(f"{name}\n{file.stat().st_size}\n".encode())
        examples.append(Example(name, SPLIT, size, "unlabelled", is_synthetic=False, place=name))
    return ExampleSet(folder, digest.hexdigest(), tuple(examples))
