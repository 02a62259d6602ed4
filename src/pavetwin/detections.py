"""Detections: one columnar record from the model's output to the inventory.

A row is one detection. Each stage adds columns and returns a new record:

| stage | columns |
|---|---|
| detector (`perception.detector`) | `class_name`, `confidence`, `box_px`, `mask`, both partial confidences |
| sizes (`perception.measuring`) | `pixel_mm`, sizes, `severity`, `outline_px` |
| sensor (`sensing`) | `footprint` in the world frame, `is_cut`, `is_spurious` |
| mission (`mission.detections`) | `capture`, `time_s`, `segment`, `outcome`, `defect`, … |
| inventory | `image`, `position_error_m` |
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib import import_module
from math import ceil, floor
from types import MappingProxyType
from typing import Any, ClassVar, Final, Generic, Self, TypeVar, overload

import numpy as np
import numpy.typing as npt

from pavetwin.arrays import (
    AnyArray,
    BoolArray,
    Float32Array,
    Float64Array,
    GeometryArray,
    IndexArray,
    Int64Array,
    ObjectArray,
)
from pavetwin.errors import PaveTwinError, nearest_name
from pavetwin.labels.boxes import FloatBox, PixelBox
from pavetwin.labels.class_names import CLASSES, TRAFFIC
from pavetwin.world.model import Defect, Severity

SIZES: Final = ("area_m2", "length_m", "mean_width_mm", "diameter_mm")
"""Columns of measured sizes, in the order of tables."""

IS_COVERED: Final = 0.5
"""Probability from which a pixel belongs to a mask."""


NOT_RESOLVABLE: Final = "not resolvable"
"""Severity, and in files a size, that an image does not show."""

SEVERITY_RANGE: Final = " to "
"""Text between the ends of a range of severities, such as `low to medium`."""


def possible_severities(severity: str) -> tuple[int, ...] | None:
    """Severities that a text of the column `severity` allows, as indices of `Severity`.

    These are one, two neighbours, or none for `not resolvable`.

    Returns:
        None for another text.
    """
    if severity == NOT_RESOLVABLE:
        return ()
    names = [each.value for each in Severity]
    parts = severity.split(SEVERITY_RANGE)
    if any(part not in names for part in parts):
        return None
    ranks = tuple(names.index(part) for part in parts)
    return ranks if len(ranks) == 1 or (len(ranks) == 2 and ranks[1] - ranks[0] == 1) else None


class Outcome(StrEnum):
    """The judgement of a detection."""

    CONFIRMED = "confirmed"
    """The first detection of a defect that the capture sees."""
    DUPLICATE = "duplicate"
    """A further detection of a defect that is confirmed already."""
    FALSE_ALARM = "false_alarm"
    """Nothing of its class is there."""
    IGNORED = "ignored"
    """Neither right nor wrong: a defect that the capture does not see (outside the window, or too much of it is
    hidden), or an object that is not a defect."""


@dataclass(frozen=True, slots=True, eq=False)
class MaskPart:
    """A mask within a box: all of a detection's, or the part in one tile."""

    box: FloatBox
    """In pixels of the image."""
    grid: Float32Array
    """(side, side) probabilities."""

    @property
    def cell_px(self) -> tuple[float, float]:
        """Width and height of a cell of the grid, in pixels of the image."""
        rows, columns = self.grid.shape
        return (self.box[2] - self.box[0]) / columns, (self.box[3] - self.box[1]) / rows


ArrayT = TypeVar("ArrayT", bound=npt.NDArray[Any])


class Column(Generic[ArrayT]):
    """A column of `Detections`; it reads as its missing value in each row until a stage adds it."""

    def __init__(self, dtype: npt.DTypeLike, missing: Any, *shape: int) -> None:
        self.dtype, self.missing, self.shape = np.dtype(dtype), missing, shape
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, table: None, owner: type) -> Self: ...
    @overload
    def __get__(self, table: "Detections", owner: type) -> ArrayT: ...
    def __get__(self, table: "Detections | None", owner: type) -> "Self | ArrayT":
        if table is None:
            return self
        known = table.columns.get(self.name)
        return self.filled(len(table)) if known is None else known  # type: ignore[return-value]

    def filled(self, count: int) -> ArrayT:
        """The column filled with missing values."""
        if self.dtype != object:
            return np.full((count, *self.shape), self.missing, self.dtype)  # type: ignore[return-value]
        return self.of([self.missing] * count)

    def of(self, values: Any) -> ArrayT:
        """Values as a column.

        Raises:
            ValueError: they have another shape.
        """
        if self.dtype != object:
            made = np.asarray(values, self.dtype)
            if self.shape and not made.size:
                made = made.reshape(-1, *self.shape)
            if made.shape[1:] != self.shape or made.ndim == 0:
                raise ValueError(f"`{self.name}` has the shape {made.shape}, not {('n', *self.shape)}")
            return made  # type: ignore[return-value]
        objects = np.empty(len(values), dtype=object)
        for row, value in enumerate(values):  # an assignment of the whole would unpack arrays and tuples
            objects[row] = value
        return objects  # type: ignore[return-value]


class Detections:
    """Detections of one or several images, one row each.

    ```python
    Detections(["pothole"], [0.9], box_px=[[10, 20, 60, 50]])
    ```

    Rows are chosen by index arrays, masks or slices (`found[found.confidence > 0.5]`); `with_columns` adds columns.
    """

    COLUMNS: ClassVar[Mapping[str, Column[Any]]]
    """All columns, by name."""

    class_name = Column[ObjectArray](object, "")
    """(n,) A defect class such as `pothole`, or another object such as `person` or `car`."""
    confidence = Column[Float64Array](np.float64, np.nan)
    """(n,) 0 … 1."""
    box_px = Column[Float64Array](np.float64, np.nan, 4)
    """(n, 4) Left, top, right, bottom in pixels of the image."""
    mask = Column[ObjectArray](object, ())
    """(n,) Tuples of `MaskPart`; empty for objects that are not defects, and for models without a mask head."""
    detection_confidence = Column[Float32Array](np.float32, np.nan)
    """(n,) Confidence in the coarse class, 0 … 1."""
    subtype_confidence = Column[Float32Array](np.float32, np.nan)
    """(n,) Confidence in the subtype of a defect, 0 … 1; 1 for other objects."""
    image = Column[ObjectArray](object, "")
    """(n,) Name of the image: detections of one image that lie apart are different defects."""

    pixel_mm = Column[Float64Array](np.float64, np.nan)
    """(n,) Side of a pixel on the ground, in the image that was searched."""
    area_m2 = Column[Float64Array](np.float64, np.nan)
    length_m = Column[Float64Array](np.float64, np.nan)
    mean_width_mm = Column[Float64Array](np.float64, np.nan)
    diameter_mm = Column[Float64Array](np.float64, np.nan)
    """(n,) Sizes (`SIZES`); NaN where a size is not measured or the image does not resolve it."""
    severity = Column[ObjectArray](object, "")
    """(n,) `low`, `medium`, `high`, a range such as `low to medium`, or `not resolvable`; empty where it is not
    measured."""
    is_cut = Column[BoolArray](np.bool_, False)
    """(n,) Whether it ends at the image's border: its sizes are the least that they can be."""
    outline_px = Column[ObjectArray](object, None)
    """(n,) Corners (m, 2) of the mask's outline, column and row; None without a mask."""
    area_px = Column[Float64Array](np.float64, np.nan)
    """(n,) Area of the mask, or else of the box."""

    footprint = Column[GeometryArray](object, None)
    """(n,) Polygons on the ground, in metres of the world frame or of the inventory's frame; None where the place is
    not known."""
    position_error_m = Column[Float64Array](np.float64, 0.0)
    """(n,) Standard deviation of the place, east and north each."""
    is_spurious = Column[BoolArray](np.bool_, False)
    """(n,) Whether it is a false alarm drawn by a sensor without images: it matches no defect."""

    capture = Column[Int64Array](np.int64, -1)
    """(n,) Index of the capture in the mission."""
    time_s = Column[Float64Array](np.float64, np.nan)
    """(n,) Time of the capture since the beginning of the mission."""
    segment = Column[Int64Array](np.int64, -1)
    """(n,) Index of the segment under inspection."""
    on_revisit = Column[BoolArray](np.bool_, False)
    """(n,) Whether the capture was taken during a revisit."""
    outcome = Column[ObjectArray](object, None)
    """(n,) `Outcome`; None until judged."""
    defect = Column[Int64Array](np.int64, -1)
    """(n,) Id of the matched defect; −1 for a false alarm, and for an object that is not a defect."""
    visible_fraction = Column[Float64Array](np.float64, np.nan)
    """(n,) Visible share of that defect's area; NaN where the capture does not see it."""
    attempt = Column[Int64Array](np.int64, 0)
    """(n,) 1 for the first capture in which that defect can be found; 0 where the capture does not see it."""

    def __init__(
        self,
        class_name: Sequence[str] | ObjectArray = (),
        confidence: npt.ArrayLike = (),
        *,
        size_px: tuple[int, int] | None = None,
        **columns: Any,
    ) -> None:
        """Args:
            class_name: (n,)
            confidence: (n,), or one for all.
            size_px: width and height of the image, for detections of one image.
            columns: further columns by name, (n, …) each; at least one of `box_px` and `footprint`.

        Raises:
            TypeError: there is no such column.
            ValueError: a column has another length, there is no place, or a confidence is not a share.
        """
        self.size_px = size_px
        count = len(class_name)
        confidence = np.broadcast_to(np.asarray(confidence if count else (), np.float64), (count,))
        if not np.all((confidence >= 0.0) & (confidence <= 1.0)):
            raise ValueError(f"a confidence lies between 0 and 1: {confidence}")
        if count and "box_px" not in columns and "footprint" not in columns:
            raise ValueError("detections need a `footprint` on the ground or a `box_px` in the image")
        given = {"class_name": class_name, "confidence": confidence, **columns}
        self.columns: Mapping[str, AnyArray] = MappingProxyType(_checked(given, count))
        """The columns added so far, by name."""

    @classmethod
    def _of(cls, columns: Mapping[str, AnyArray], size_px: tuple[int, int] | None) -> Self:
        made = cls.__new__(cls)
        made.size_px, made.columns = size_px, MappingProxyType({**columns})
        return made

    @classmethod
    def of_defects(cls, defects: Iterable[Defect], confidence: npt.ArrayLike = 1.0) -> "Detections":
        """Detections that outline defects exactly.

        Args:
            confidence: (n,), or one for all.
        """
        known = list(defects)
        if not known:
            return NO_DETECTIONS
        outlines = [defect.polygon for defect in known]
        return cls([defect.kind for defect in known], confidence, footprint=outlines)

    def __len__(self) -> int:
        return len(self.columns["class_name"])

    def __getitem__(self, rows: slice | Sequence[int] | Sequence[bool] | IndexArray | BoolArray) -> Self:
        chosen = rows if isinstance(rows, slice) else np.asarray(rows)
        if not isinstance(chosen, slice) and not chosen.size:
            chosen = np.empty(0, dtype=np.intp)
        return self._of({name: values[chosen] for name, values in self.columns.items()}, self.size_px)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Detections):
            return NotImplemented
        if len(self) != len(other):
            return False
        return all(_are_equal(getattr(self, name), getattr(other, name)) for name in {*self.columns, *other.columns})

    __hash__ = None  # type: ignore[assignment]
    __iter__ = None
    """A row alone is no value: iterate over columns."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({len(self)} rows: {', '.join(self.columns)})"

    def with_columns(self, **columns: Any) -> Self:
        """The same rows with more columns, or with other values in some.

        Raises:
            TypeError: there is no such column.
            ValueError: a column has another length.
        """
        return self._of({**self.columns, **_checked(columns, len(self))}, self.size_px)

    def without(self, *names: str) -> Self:
        """The same rows without some columns."""
        return self._of({name: each for name, each in self.columns.items() if name not in names}, self.size_px)

    @staticmethod
    def concatenated(parts: Sequence["Detections"]) -> "Detections":
        """The rows of several records, one after another, with the columns of any of them."""
        some = [part for part in parts if len(part)]
        if len(some) <= 1:
            return next(iter(some or parts), NO_DETECTIONS)
        names = dict.fromkeys(name for part in some for name in part.columns)
        sizes = {part.size_px for part in some}
        columns = {name: np.concatenate([getattr(part, name) for part in some]) for name in names}
        return Detections._of(columns, sizes.pop() if len(sizes) == 1 else None)

    @property
    def is_defect(self) -> BoolArray:
        """(n,) Whether the class is not one of `TRAFFIC`."""
        return np.array([name not in TRAFFIC for name in self.class_name], dtype=np.bool_)

    @property
    def class_number(self) -> Int64Array:
        """(n,) The classes as numbers in `CLASSES`."""
        return np.array([CLASSES.index(name) for name in self.class_name], dtype=np.int64)

    def box(self, row: int) -> FloatBox:
        """Left, top, right, bottom of one detection in pixels."""
        left, top, right, bottom = self.box_px[row].tolist()
        return left, top, right, bottom

    def mask_pixels(self, row: int) -> tuple[PixelBox, BoolArray] | None:
        """The mask of one detection: a window (left, top, right, bottom) of the image, and its pixels.

        Returns:
            None without a mask.
        """
        parts = self.mask[row]
        if not parts:
            return None
        left, top, right, bottom = self.box(row)
        x, y = floor(left), floor(top)
        width, height = max(1, ceil(right) - x), max(1, ceil(bottom) - y)
        window = (x, y, x + width, y + height)
        covered = np.zeros((height, width), dtype=np.bool_)
        for part in parts:
            covered |= _pixels(part, window, (width, height))
        return window, covered

    def to_supervision(self, *, masks: bool = True) -> Any:
        """The record as `supervision.Detections`, with both partial confidences and the class names in `data`.

        Args:
            masks: include masks of the size of the image, which need much memory for large images.

        Raises:
            PaveTwinError: supervision is not installed.
        """
        try:
            supervision: Any = import_module("supervision")
        except ImportError as error:
            raise PaveTwinError(
                "supervision is not installed, which is an extra; install it with `pip install pavetwin[detect]`."
            ) from error
        return supervision.Detections(
            xyxy=self.box_px.astype(np.float32),
            confidence=self.confidence.astype(np.float32),
            class_id=self.class_number,
            mask=self._whole_masks(self.size_px) if masks and self.size_px and any(self.mask) else None,
            data={
                "class_name": np.array([*self.class_name]),
                "det_conf": self.detection_confidence,
                "cls_conf": self.subtype_confidence,
            },
        )

    def _whole_masks(self, size_px: tuple[int, int]) -> BoolArray:
        found = np.zeros((len(self), size_px[1], size_px[0]), dtype=np.bool_)
        for row in range(len(self)):
            if (mask := self.mask_pixels(row)) is not None:
                (left, top, right, bottom), covered = mask
                found[row, top:bottom, left:right] = covered
        return found


def _checked(columns: Mapping[str, Any], count: int) -> dict[str, AnyArray]:
    made = {}
    for name, values in columns.items():
        column = Detections.COLUMNS.get(name)
        if column is None:
            raise TypeError(f"detections have no column '{name}'{nearest_name(name, Detections.COLUMNS)}")
        made[name] = column.of(values)
        if len(made[name]) != count:
            raise ValueError(f"`{name}` has {len(made[name])} rows, not {count}")
    return made


def _are_equal(first: AnyArray, second: AnyArray) -> bool:
    if first.dtype == object:
        return all(np.array_equal(one, other) for one, other in zip(first, second, strict=True))
    return np.array_equal(first, second, equal_nan=first.dtype.kind == "f")


def _pixels(part: MaskPart, window: PixelBox, size: tuple[int, int]) -> BoolArray:
    """The pixels of a window (width, height) whose centre a part covers, its grid interpolated linearly."""
    import cv2  # heavy, and needed for masks only

    across, down = part.cell_px
    # From the centre of a pixel of the window to the grid, in which the centre of the first cell is 0.
    matrix = np.array(
        [
            [1 / across, 0.0, (window[0] + 0.5 - part.box[0]) / across - 0.5],
            [0.0, 1 / down, (window[1] + 0.5 - part.box[1]) / down - 0.5],
        ]
    )
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    shares = cv2.warpAffine(part.grid, matrix, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    x = np.arange(window[0], window[0] + size[0]) + 0.5
    y = np.arange(window[1], window[1] + size[1]) + 0.5
    inside_x, inside_y = (x >= part.box[0]) & (x <= part.box[2]), (y >= part.box[1]) & (y <= part.box[3])
    covered: BoolArray = (shares >= IS_COVERED) & inside_x & inside_y[:, None]
    return covered


Detections.COLUMNS = MappingProxyType(
    {name: each for name, each in vars(Detections).items() if isinstance(each, Column)}
)

NO_DETECTIONS: Final = Detections()
"""The record of an image in which nothing is detected."""
