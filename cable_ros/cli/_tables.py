# SPDX-License-Identifier: Apache-2.0
"""Where `cable sweep` writes: one row for each pose and cable."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cable_ros.batch import Batch
from cable_ros.cli._arguments import CommandError
from cable_ros.limits import QUANTITIES
from cable_ros.scene import Scene

ROW_GROUP = 50_000  # rows; smaller groups make Parquet files large and slow
COMPONENTS = tuple(f"{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz")


class Table(Protocol):
    """Takes batches as they come."""

    def write(self, variant: Mapping[str, float], batch: Batch) -> None:
        """Append a batch that was solved with these values of the varied fields."""


@contextmanager
def open_table(path: Path, scene: Scene) -> Iterator[Table]:
    """A table or log at `path`, of the kind its suffix names; the file appears when it is complete.

    Raises:
        CommandError: the suffix is not known.
        LogError: a log of that name exists.
        FileExistsError: another file came to be there meanwhile.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".mcap":
        from cable_ros.ros.batch_log import BatchLog

        with BatchLog(path, scene) as log:
            yield log
        return
    kinds: dict[str, Any] = {".csv": CsvTable, ".parquet": ParquetTable}
    unfinished = path.with_name(path.name + ".part")
    try:
        table = kinds[path.suffix](unfinished)
        try:
            yield table
        finally:
            table.close()
        # The empty placeholder reserves the name: what came there meanwhile stays.
        path.touch(exist_ok=False)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def check_out(path: Path, varied: bool) -> None:
    """Raise CommandError unless `path` is new and its suffix names a file that can hold what is asked for."""
    if path.suffix not in (".csv", ".parquet", ".mcap"):
        raise CommandError(f"--out {path}: the name must end in .csv, .parquet or .mcap")
    if path.suffix == ".mcap" and varied:
        raise CommandError("a log holds one scene; write variations to a .csv or .parquet file")
    if path.exists():
        raise CommandError(f"--out {path}: it exists already and is not overwritten; choose another name")


def columns(variant: Mapping[str, float], batch: Batch) -> dict[str, np.ndarray]:
    """The batch as columns of equal length, cable after cable within each pose."""
    cables = len(batch.cables)
    rows = len(batch) * cables
    out = {name: np.full(rows, value) for name, value in variant.items()}
    out |= {name: np.repeat(batch.joints[:, i], cables) for i, name in enumerate(batch.joint_names)}
    out["cable"] = np.tile(np.array(batch.cables), len(batch))
    out["status"] = np.array([status.name for status in batch.status.ravel()])
    for end in ("end", "start"):
        wrench = getattr(batch, f"{end}_wrench").reshape(rows, 6)
        out |= {f"{end}_{name}": wrench[:, i] for i, name in enumerate(COMPONENTS)}
    if batch.support_wrench is not None:
        for name in dict.fromkeys(name for _, name in batch.supports):
            held = np.full((len(batch), cables, 6), np.nan)
            for k, (cable, other) in enumerate(batch.supports):
                if other == name:
                    held[:, batch.cables.index(cable)] = batch.support_wrench[:, k]
            out |= {f"{name}_{part}": held.reshape(rows, 6)[:, i] for i, part in enumerate(COMPONENTS)}
    loads = zip(batch.joint_names, batch.joint_load.T, strict=True)
    out |= {f"load_{name}": np.repeat(load, cables) for name, load in loads}
    for name in ("total_twist", "energy", "stability_margin", "error_estimate", "iterations", "overlapping"):
        out[name] = getattr(batch, name).ravel()
    if batch.extremes is not None:
        for i, quantity in enumerate(QUANTITIES):
            out[quantity.name] = batch.extremes[:, :, i, 0].ravel()
            out[f"{quantity.name}_at"] = batch.extremes[:, :, i, 1].ravel()
    return out


class CsvTable:
    """Comma-separated text with a header; numbers that are not there are empty."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", newline="", encoding="utf-8")
        self._writer = csv.writer(self._file)
        self._empty = True

    def write(self, variant: Mapping[str, float], batch: Batch) -> None:
        table = columns(variant, batch)
        if self._empty:
            self._writer.writerow(table)
            self._empty = False
        rows = zip(*(column.tolist() for column in table.values()), strict=True)
        # A NaN is the one value that differs from itself.
        self._writer.writerows(["" if value != value else value for value in row] for row in rows)

    def close(self) -> None:
        self._file.close()


class ParquetTable:
    """Apache Parquet, for pandas, polars and DuckDB; needs pyarrow."""

    def __init__(self, path: Path) -> None:
        import pyarrow
        import pyarrow.parquet

        self._arrow = pyarrow
        self._path = path
        self._writer: Any = None
        self._waiting: list[dict[str, np.ndarray]] = []
        self._rows = 0

    def write(self, variant: Mapping[str, float], batch: Batch) -> None:
        table = columns(variant, batch)
        self._waiting.append(table)
        self._rows += len(table["cable"])
        if self._rows >= ROW_GROUP:
            self._flush()

    def close(self) -> None:
        if self._waiting:
            self._flush()
        if self._writer is not None:
            self._writer.close()

    def _flush(self) -> None:
        names: Sequence[str] = list(self._waiting[0])
        table = self._arrow.table(
            {name: np.concatenate([part[name] for part in self._waiting]) for name in names}
        )
        if self._writer is None:
            self._writer = self._arrow.parquet.ParquetWriter(self._path, table.schema)
        self._writer.write_table(table)
        self._waiting, self._rows = [], 0
