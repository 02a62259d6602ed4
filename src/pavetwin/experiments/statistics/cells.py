"""A study's table as matrices: one row per cell of the design, one column per independent replicate.

A null level means that the missions do not have the factor, such as the option of another policy. Their one set of
missions stands for all its levels.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl

from pavetwin.arrays import BoolArray, Float64Array, IndexArray
from pavetwin.experiments.metrics import FAILED, REPLICATE, STATUS

CellKey = tuple[Any, ...]
"""The levels of a cell, in the order of its columns."""


@dataclass(frozen=True)
class Layout:
    """Cell and block of every row of a table. A *block*, one replicate in one world, is the independent unit."""

    keys: tuple[CellKey, ...]
    """The cells, sorted by the first appearance of their levels, column by column."""
    cell: IndexArray
    """(rows,) index into `keys`."""
    block: IndexArray
    """(rows,) number of the row's block."""
    worlds: IndexArray
    """(blocks,) number of each block's world. Blocks are sorted by world and replicate, wherever their rows stand."""

    def means(self, values: Float64Array) -> Float64Array:
        """(cells, blocks) the mean of the defined values of a cell in a block; NaN where there is none.

        Args:
            values: (rows,) NaN where undefined.
        """
        defined = ~np.isnan(values)
        # In an order of their own, so that sums do not depend on the order of rows by as much as their last bit.
        order = np.lexsort((values, self.block, self.cell))
        order = order[defined[order]]
        counts = self._binned(order, None)
        means = np.full(counts.shape, np.nan)
        np.divide(self._binned(order, values[order]), counts, out=means, where=counts > 0)
        return means

    def present(self) -> BoolArray:
        """(cells, blocks) where the table has a row, whatever became of its mission."""
        return np.asarray(self._binned(np.arange(len(self.cell)), None) > 0)

    def _binned(self, rows: IndexArray, weights: Float64Array | None) -> Float64Array:
        shape = (len(self.keys), len(self.worlds))
        flat = self.cell[rows] * shape[1] + self.block[rows]
        binned = np.bincount(flat, weights=weights, minlength=shape[0] * shape[1])
        return binned.reshape(shape).astype(np.float64)


def layout(table: pl.DataFrame, by: Sequence[str]) -> Layout:
    """The layout of `table` by the columns `by`; with none, all rows are one cell."""
    rows = table.select(by).rows() if by else [()] * table.height
    places = [_first_places(table[column].to_list()) for column in by]
    keys = sorted(set(rows), key=lambda key: [place[level] for place, level in zip(places, key, strict=True)])
    of_row = table.select("world", REPLICATE).rows()
    blocks = sorted(set(of_row))
    worlds = _first_places([world for world, _ in blocks])
    return Layout(
        keys=tuple(keys),
        cell=_numbered(rows, keys),
        block=_numbered(of_row, blocks),
        worlds=np.array([worlds[world] for world, _ in blocks], dtype=np.intp),
    )


def _first_places(values: Sequence[Hashable]) -> dict[Hashable, int]:
    """The distinct values, numbered in the order of their first appearance."""
    return {value: at for at, value in enumerate(dict.fromkeys(values))}


def _numbered(rows: Sequence[Hashable], among: Sequence[Hashable]) -> IndexArray:
    number = {key: at for at, key in enumerate(among)}
    return np.array([number[row] for row in rows], dtype=np.intp)


def values_of(table: pl.DataFrame, column: str) -> Float64Array:
    """(rows,) a metric's values, NaN where undefined or failed. Never 0 for what was not measured."""
    values = np.array(table[column].cast(pl.Float64).fill_null(float("nan")).to_numpy(), dtype=np.float64)
    values[~np.isfinite(values) | failures(table)] = np.nan
    return values


def failures(table: pl.DataFrame) -> BoolArray:
    """(rows,) whether the mission failed."""
    return np.asarray((table[STATUS] == FAILED).to_numpy(), dtype=np.bool_)


def failed_alone(table: pl.DataFrame, by: Sequence[str]) -> BoolArray:
    """(rows,) where a mission failed that another cell of `by` flew: only such make the cells' means unequal.

    Factors that some missions do not have, and that are not in `by`, are disregarded.
    """
    rest = [name for name in (*varied_columns(table), REPLICATE) if name not in by and not table[name].null_count()]
    failed = pl.col(STATUS) == FAILED
    return np.asarray(table.select(failed & ~failed.all().over(rest)).to_series().to_numpy(), dtype=np.bool_)


def varied_columns(table: pl.DataFrame) -> list[str]:
    """Columns that identify the cells of a design: factors and swept settings, those before `replicate`."""
    return table.columns[: table.columns.index(REPLICATE)]


def levels_of(table: pl.DataFrame, factor: str) -> list[Any]:
    """The levels of a factor, in the order of their first appearance; missing ones are not levels."""
    return table[factor].drop_nulls().unique(maintain_order=True).to_list()


def partners(keys: Sequence[CellKey], at: int, reference: Any) -> Iterator[tuple[int, int, CellKey]]:
    """Each cell with the cells that have the level `reference` of the factor at the place `at` and agree in all else; a
    level that one of two does not have agrees with any.

    Returns:
        Number of the cell, number of its partner, and the key of the pair, which has the levels of both.
    """
    rest = [tuple(None if place == at else level for place, level in enumerate(key)) for key in keys]
    lacking = [frozenset(place for place, level in enumerate(key) if level is None) for key in rest]
    others = [cell for cell, key in enumerate(keys) if key[at] == reference]
    for theirs in dict.fromkeys(lacking[cell] for cell in others):
        for ours in dict.fromkeys(lacking):
            found: dict[CellKey, list[int]] = {}
            for cell in others:
                if lacking[cell] == theirs:
                    found.setdefault(_without(rest[cell], ours), []).append(cell)
            for cell, key in enumerate(rest):
                if lacking[cell] == ours and keys[cell][at] not in (None, reference):
                    for partner in found.get(_without(key, theirs), ()):
                        yield cell, partner, _of_both(keys[cell], keys[partner])


def _without(key: CellKey, places: frozenset[int]) -> CellKey:
    return tuple(None if place in places else level for place, level in enumerate(key))


def _of_both(key: CellKey, partner: CellKey) -> CellKey:
    return tuple(other if level is None else level for level, other in zip(key, partner, strict=True))


def at_every_level(table: pl.DataFrame) -> pl.DataFrame:
    """The table with missions repeated at each level of the factors that they do not have."""
    for name in varied_columns(table):
        if table[name].null_count():
            levels = table.select(name).drop_nulls().unique(maintain_order=True)
            lacking = table.filter(pl.col(name).is_null()).drop(name).join(levels, how="cross")
            table = pl.concat([table.drop_nulls(name), lacking.select(table.columns)])
    return table


def key_columns(table: pl.DataFrame, by: Sequence[str], keys: Sequence[CellKey]) -> pl.DataFrame:
    """One row a key, its columns `by` typed as in `table`."""
    return pl.DataFrame(keys, schema={column: table.schema[column] for column in by}, orient="row")


def nullable(values: Sequence[float] | Float64Array) -> pl.Series:
    """A column in which NaN is null."""
    return pl.Series(np.asarray(values, dtype=np.float64), dtype=pl.Float64, nan_to_null=True).fill_nan(None)
