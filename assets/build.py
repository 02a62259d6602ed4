"""Makes the models: `python -m assets.build [names]`, all without names. Needs Blender's Python module (bpy)."""

import argparse
import sys
import time
from pathlib import Path
from typing import Final

from assets.models import load_families
from assets.models.common import MODELS
from assets.models.gltf import write_glb

IN_THE_AIR: Final = frozenset(
    {"quadrotor", "lamp_head", "signal_head", "signal_pedestrian", "sign_round", "sign_triangle", "sign_octagon"}
)
"""Models that no ground lies below."""

OUTPUT: Final = Path(__file__).parent.parent / "src" / "pavetwin" / "scene" / "models"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="models to make (default: all)")
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT, help="folder of the .glb files")
    options = parser.parse_args()
    load_families()
    unknown = sorted(set(options.names) - set(MODELS))
    if unknown:
        print(f"There is no model called {', '.join(unknown)}. There are: {', '.join(sorted(MODELS))}", file=sys.stderr)
        return 2
    for name in options.names or sorted(MODELS):
        started = time.perf_counter()
        made = MODELS[name]()
        path = options.output / f"{name}.glb"
        write_glb(made, path, ground=name not in IN_THE_AIR)
        triangles = sum(len(part.triangles) for node in made.meshes() for part in node.parts)
        seconds = time.perf_counter() - started
        print(f"{name:16} {triangles:6} triangles {path.stat().st_size / 1024:6.0f} KiB {seconds:5.1f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
