"""Names of streets as pictures show them: as on the map where a font has their letters, else in Latin letters."""

from pavetwin.draw.fonts import fonts, package_for, pillow_can_write, readable
from pavetwin.world.model import Segment, World


def shown_names(world: World) -> dict[str, str]:
    """By the id of each segment, its street's name in letters that a picture can show; the id where there is none."""
    lacking = fonts().lacking("".join({segment.street for segment in world.segments}))
    shown = {}
    for segment in world.segments:
        names = (segment.street_name, world.latin_name_of(segment))
        shown[segment.id] = next((name for name in names if lacking.isdisjoint(name) and readable(name)), segment.id)
    return shown


def shown_label(world: World, segment: Segment, *, by_pillow: bool = False) -> str:
    """As `Segment.label`, in letters that a picture drawn by Matplotlib or Pillow can show."""
    labels = (segment.label, f"{world.latin_name_of(segment)}, {segment.id}")
    can_show = pillow_can_write if by_pillow else readable
    return next((label for label in labels if can_show(label)), segment.id)


def remark(world: World) -> str | None:
    """What to tell the user where no font of the machine has the letters of some streets' names."""
    names = sorted({segment.street for segment in world.segments if segment.has_street_name})
    lacking = fonts().lacking("".join(names))
    if not lacking:
        return None
    count = sum(not lacking.isdisjoint(name) for name in names)
    streets = "one street's name" if count == 1 else f"the names of {count} streets"
    return (
        f"No font on this machine has the letters of {streets}; pictures show Latin names or segment ids instead. "
        f"Install one, on Debian: apt-get install {package_for(lacking)}"
    )
