"""`python -m gallery [NAME …]`: renders the images of `docs/gallery`."""

import argparse
import sys
import time
from pathlib import Path

from gallery.pictures import PICTURES
from gallery.renderer import GalleryRenderer
from gallery.sheet import save
from pavetwin.cli.console import fail, out
from pavetwin.errors import PaveTwinError, nearest_name


def main() -> int:
    """Render all images, or those that are named."""
    parser = argparse.ArgumentParser(prog="python -m gallery", description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(PICTURES)}; all unless given")
    parser.add_argument(
        "--maps", type=Path, help="folder of berlin_neukoelln.osm and seattle_roosevelt.osm: real streets too"
    )
    parser.add_argument("--output", type=Path, default=Path("docs/gallery"), help="folder of the pictures")
    parser.add_argument("--work", type=Path, default=Path("out/gallery"), help="folder of the town and its traffic")
    options = parser.parse_args()
    try:
        for name in options.names:
            if name not in PICTURES:
                raise PaveTwinError(
                    f"No picture '{name}'{nearest_name(name, PICTURES)}; there are {', '.join(PICTURES)}."
                )
        renderer = GalleryRenderer(options.work, maps=options.maps)
        pictures = {name: PICTURES[name] for name in options.names or PICTURES}
        options.output.mkdir(parents=True, exist_ok=True)
        for name, take in pictures.items():
            begun = time.perf_counter()
            size = save(take(renderer), options.output / f"{name}.jpg")
            out.print(f"{options.output / name}.jpg   {size / 1000:.0f} kB, {time.perf_counter() - begun:.1f} s")
    except PaveTwinError as error:
        fail(str(error))
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
