"""Uploads to the server: their limits, and the decoding of untrusted images."""

from dataclasses import dataclass
from io import BytesIO
from typing import Final

from PIL import Image, UnidentifiedImageError
from tornado.httputil import HTTPFile, HTTPInputError, ParseMultipartConfig, parse_multipart_form_data

from pavetwin.arrays import UInt8Array
from pavetwin.errors import PaveTwinError
from pavetwin.perception.images import of_any_size, pixels_of
from pavetwin.perception.photograph import PhotographPose, pose_of

FIELD: Final = "file"
"""Field of the multipart form."""

KINDS: Final = ("JPEG", "PNG", "WEBP", "BMP", "TIFF")
"""Accepted formats by Pillow's names; a JPEG may hold several images (MPO)."""


@dataclass(frozen=True, slots=True)
class ServerLimits:
    """Limits of a server; requests beyond them are refused with a 4xx status."""

    upload_mb: float = 32.0
    """Size of a request."""
    megapixels: float = 50.0
    """Size of an image."""
    batch: int = 16
    """Images in a request."""
    waiting: int = 64
    """Requests that wait for the detector or are being processed."""
    held_mb: float = 256.0
    """Size of all requests together that are being received or wait; at least `upload_mb` is allowed."""
    timeout_s: float = 30.0
    """Time for the headers of a request, and for its body."""
    look_s: float = 60.0
    """Time for the detector to search all images of a request, checked between tiles."""

    def __post_init__(self) -> None:
        for name in ("upload_mb", "megapixels", "batch", "waiting", "held_mb", "timeout_s", "look_s"):
            if not getattr(self, name) > 0:
                raise PaveTwinError(f"`{name}` {getattr(self, name):g}: it must be above 0.")


class RefusedRequestError(Exception):
    """A request that is answered with a client error."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


def files_of(content_type: str, body: bytes, most: int) -> list[HTTPFile]:
    """The files of a multipart form's field `file`, at least one.

    Raises:
        RefusedRequestError: it is not a multipart form, or has no file or too many.
    """
    kind, _, rest = content_type.partition(";")
    boundary = next((part.strip()[9:] for part in rest.split(";") if part.strip().startswith("boundary=")), "")
    if kind.strip().lower() != "multipart/form-data" or not boundary.strip('"'):
        raise RefusedRequestError(415, f"Send a form of multipart/form-data with an image as its field '{FIELD}'.")
    files: dict[str, list[HTTPFile]] = {}
    config = ParseMultipartConfig(max_parts=2 * most + 8)
    try:
        parse_multipart_form_data(boundary.encode(), body, {}, files, config=config)
    except (HTTPInputError, ValueError) as error:
        raise RefusedRequestError(400, f"The form cannot be read: {error}.") from error
    found = files.get(FIELD, [])
    if not found:
        raise RefusedRequestError(400, f"The form has no file as its field '{FIELD}'.")
    if len(found) > most:
        raise RefusedRequestError(400, f"{len(found)} files; at most {most} are accepted in a request.")
    return found


def decoded(file: HTTPFile, megapixels: float) -> tuple[UInt8Array, PhotographPose]:
    """An image as red, green and blue (rows, columns, 3), turned by its EXIF orientation, and its pose.

    Its size is checked before its pixels are read.

    Raises:
        RefusedRequestError: it is not an image of an accepted format, is damaged, or has too many pixels.
    """
    name = file["filename"][:100] or "the file"
    Image.init()  # its readers of all kinds, once
    try:
        with of_any_size(BytesIO(file["body"]), KINDS) as held:
            if held.width * held.height > megapixels * 1e6:
                size = f"{held.width} × {held.height} px"
                raise RefusedRequestError(413, f"'{name}' has {size}; at most {megapixels:g} megapixels are accepted.")
            pose = pose_of(held)
            return pixels_of(held), pose
    except UnidentifiedImageError as error:
        raise RefusedRequestError(
            415, f"'{name}' is not an image in an accepted format ({', '.join(KINDS)})."
        ) from error
    except RefusedRequestError:
        raise
    # Pillow's decoders raise nearly anything for damaged files.
    except Exception as error:
        raise RefusedRequestError(400, f"'{name}' is damaged: {error}") from error
