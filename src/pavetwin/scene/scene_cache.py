"""Tiles of a scene, and what they are made from, kept in the cache between runs.

The path of a file says all that its value depends on: the world and its defects, the look and the seed, and the code,
data and libraries that make it.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Final, TypeVar

from pavetwin.scene import model
from pavetwin.scene.extras import StreetObject
from pavetwin.scene.ground.distractors.fixtures import Fixture
from pavetwin.scene.ground.distractors.segment_marks import Repairs
from pavetwin.scene.ground.layout.paved import PavedSurface
from pavetwin.scene.ground.looks import look_sha256, street_look
from pavetwin.scene.ground.markings.painter import Paint
from pavetwin.scene.ground.plan import made
from pavetwin.world.cache import ValueStore, made_by, mark_used, short_sha256, tile_folder
from pavetwin.world.model import World

MADE_BY: Final = ("scene", "defects", "world")
"""The folders of the package whose code and data decide what is kept here."""

Value = TypeVar("Value")

_STORE: Final = ValueStore(
    "tiles of the ground",
    (
        *(model.Tile, model.GroundPiece, model.FacadePiece, model.Instance, model.Mesh, model.Finish),
        *(model.GroundKind, model.GroundMaps, model.DefectPatch, model.Model),
        *(Fixture, Paint, PavedSurface, Repairs, StreetObject),
    ),
)


class SceneCache:
    """What is kept of one scene."""

    def __init__(self, world: World, *, seed: int, look: str) -> None:
        """Args:
        world: with its defects. Of one that was never built or loaded, and so has no content hash, nothing is kept.
        look: of its streets: a name, or a YAML file.
        """
        self._folder: Path | None = None
        if world.content_hash:
            beside_hash = [(street.latin_name, street.bridges) for street in world.streets]
            inputs = (world.content_hash, world.defects_hash, beside_hash, seed, look_sha256(look), street_look(look))
            self._folder = tile_folder() / short_sha256(f"{inputs!r} {made_by(*MADE_BY)}")

    def kept(self, name: str, make: Callable[[], Value], /) -> Value:
        """A value: from its file, else made and written.

        Args:
            name: of the value in this scene; a path where there are many.
            make: gives one of the classes that are listed in this module, or a container of such.
        """
        return made(name, make) if self._folder is None else _STORE.kept(self._folder / name, make)

    @property
    def keeps(self) -> bool:
        """Whether what is made of this scene is kept: not where the cache cannot be written."""
        if self._folder is None:
            return False
        with suppress(OSError):
            self._folder.mkdir(parents=True, exist_ok=True)
            with TemporaryFile(dir=self._folder):
                return True
        return False

    def lacks(self, name: str) -> bool:
        """Whether a value of a scene with a content hash is not there; one that is counts as used now."""
        if self._folder is None:
            return False
        mark_used(self._folder / name)
        return not (self._folder / name).exists()


def kept_of_all(name: str, make: Callable[[], Value]) -> Value:
    """A value that is the same in every scene, as `SceneCache.kept` keeps others."""
    return _STORE.kept(tile_folder() / short_sha256(made_by(*MADE_BY)) / name, make)
