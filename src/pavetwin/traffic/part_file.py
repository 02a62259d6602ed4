"""Parts of a recording as row groups of Parquet: in its file, or in memory, where a pose takes little more than a
byte.

Arrays go to Arrow and back by their buffers: by `pyarrow.array` and `to_numpy` PyArrow loads pandas, a quarter of a
second that no recording needs.
"""

from dataclasses import dataclass
from typing import Any, Final, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pavetwin.arrays import AnyArray
from pavetwin.traffic import part_table
from pavetwin.traffic.track_part import TrackPart

_SCHEMA: Final = pa.schema([*((name, pa.int32()) for name in part_table.COLUMNS), ("is_last", pa.bool_())])
_ENCODING: Final = {**dict.fromkeys(part_table.COLUMNS, "BYTE_STREAM_SPLIT"), "is_last": "RLE"}
_LEVEL: Final = 1
"""Of compression; higher ones gain 3 % and take three times as long."""


def part_writer(target: Any) -> pq.ParquetWriter:
    """Writes parts to a path or a stream of Arrow."""
    return pq.ParquetWriter(
        target,
        _SCHEMA,
        compression="zstd",
        compression_level=_LEVEL,
        use_dictionary=False,
        column_encoding=_ENCODING,
        store_schema=False,  # it would hold the metadata again
    )


def write_part(writer: pq.ParquetWriter, part: TrackPart) -> None:
    """Append a part as a row group."""
    columns = part_table.to_columns(part)
    table = pa.table([to_arrow(columns[name]) for name in _SCHEMA.names], schema=_SCHEMA)
    writer.write_table(table, row_group_size=max(1, len(table)))


def read_part(file: pq.ParquetFile, group: int, first_step: int, last_step: int) -> TrackPart:
    """The part that is a row group.

    Raises:
        pa.ArrowException, OSError, KeyError, ValueError: the file is damaged.
    """
    table = file.read_row_group(group, use_threads=False)
    columns = {name: from_arrow(table[name]) for name in table.column_names}
    return part_table.from_columns(columns, first_step, last_step)


def to_arrow(column: AnyArray) -> pa.Array:
    """A column of numbers or truth values, (rows,)."""
    if column.dtype == np.bool_:
        return pa.Array.from_buffers(
            pa.bool_(), len(column), [None, pa.py_buffer(np.packbits(column, bitorder="little"))]
        )
    return pa.Array.from_buffers(pa.from_numpy_dtype(column.dtype), len(column), [None, pa.py_buffer(column)])


def from_arrow(column: pa.ChunkedArray) -> AnyArray:
    """A column of numbers or truth values, (rows,), not to be written to.

    Raises:
        ValueError, TypeError: values are missing, or of another type.
    """
    whole = column.combine_chunks()
    if not pa.types.is_boolean(whole.type):
        return np.from_dlpack(whole)
    if whole.null_count:
        raise ValueError("values are missing")
    first, bits = whole.offset, np.frombuffer(whole.buffers()[1], np.uint8)
    return np.unpackbits(bits, count=first + len(whole), bitorder="little")[first:].astype(np.bool_)


@dataclass(frozen=True, eq=False)
class PackedPart:
    """A part in memory, as a file of its own."""

    first_step: int
    last_step: int
    data: Any
    """`pyarrow.Buffer`."""

    @classmethod
    def of(cls, part: TrackPart) -> Self:
        stream = pa.BufferOutputStream()
        with part_writer(stream) as writer:
            write_part(writer, part)
        return cls(part.first_step, part.last_step, stream.getvalue())

    def load(self) -> TrackPart:
        return read_part(pq.ParquetFile(pa.BufferReader(self.data)), 0, self.first_step, self.last_step)
