"""A contact sheet of a dataset of photographs: images side by side, with their boxes drawn over them."""

from pathlib import Path

from PIL import Image, ImageDraw

from pavetwin.draw.contact_sheet import CELL_PX, assembled, captioned, check_sheet, draw_box, evenly_chosen
from pavetwin.errors import PaveTwinError
from pavetwin.files import writing
from pavetwin.labels.classes import colours
from pavetwin.labels.common_form import AnnotatedImage, annotation_path, image_names, read_description, read_image
from pavetwin.labels.voc import PICTURES
from pavetwin.training.datasets.pictures import PictureError, opened


def save_contact_sheet(folder: Path, path: Path, *, count: int = 24) -> int:
    """Draw `count` images of a dataset, evenly chosen by name, into a PNG or JPEG. Returns how many.

    Raises:
        PaveTwinError: the folder holds no image, one is damaged, or the file cannot be written.
    """
    description = read_description(folder)
    check_sheet(path, count)
    names = image_names(folder)
    if not names:
        raise PaveTwinError(f"'{folder}' holds no image.")
    chosen = [names[index] for index in evenly_chosen(len(names), count)]
    colour_of = colours(description["classes"])
    cells = [_cell(folder, read_image(annotation_path(folder, name)), colour_of) for name in chosen]
    of = f"{len(names)} images" if len(names) != 1 else "1 image"
    title = f"{folder.absolute().name}   {len(cells)} of {of}"
    sheet = assembled(cells, title, colour_of, ignored="ignored: neither an object nor background")
    with writing(path) as temporary:
        sheet.save(temporary, quality=90)
    return len(cells)


def _cell(folder: Path, image: AnnotatedImage, colour_of: dict[str, str]) -> Image.Image:
    path = folder / PICTURES / image.picture
    try:
        with opened(path) as file:
            picture = file.convert("RGB")
    except PictureError as error:
        raise PaveTwinError(f"'{path}' is damaged or missing; make the dataset again.") from error
    scale = CELL_PX / picture.width
    drawn = picture.resize((CELL_PX, max(1, round(picture.height * scale))), Image.Resampling.LANCZOS)
    pen = ImageDraw.Draw(drawn)
    for each in sorted(image.annotations, key=lambda each: each.ignored is None):
        left, top, right, bottom = each.box
        is_shown = each.ignored is None and each.category is not None
        colour = colour_of[each.category] if is_shown and each.category is not None else None
        draw_box(pen, (left * scale, top * scale, right * scale, bottom * scale), colour)
    ignored = len(image.annotations) - len(image.labelled)
    labels = "1 label" if len(image.labelled) == 1 else f"{len(image.labelled)} labels"
    count = labels if not image.is_background else "background"
    resolution = "" if image.gsd_mm is None else f" · {image.gsd_mm:.3g} mm a pixel"
    width, height = image.size_px
    return captioned(
        drawn,
        image.name,
        f"{image.source} · {width} × {height}{resolution}",
        count + (f", {ignored} ignored" if ignored else ""),
    )
