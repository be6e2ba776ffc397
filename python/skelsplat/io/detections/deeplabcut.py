"""DeepLabCut results in h5, single- and multi-animal: one file per camera.

A pandas table under the key ``df_with_missing`` with columns (scorer, [individuals,] bodyparts, coords),
coords x, y in pixels and likelihood; the index is the frame number. Parts are matched to joints by name.
Needs pandas and PyTables, which can run what a malicious file holds: open files of people you trust (the csv
has the same numbers and no such risk).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat._optional import require
from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number
from skelsplat.io.detections._dlc_table import Table, camera_part
from skelsplat.io.detections._format import DetectionFormat, View
from skelsplat.io.detections._hdf5 import hdf5_mentions

if TYPE_CHECKING:
    from pathlib import Path

_KEY = "df_with_missing"


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    frame = _load(path)
    if not hasattr(frame, "columns") or not hasattr(frame.columns, "levels"):
        raise DatasetError(path, "header", "a table with several levels of columns", type(frame).__name__)
    if frame.index.nlevels != 1 or frame.index.dtype.kind not in "iu":
        raise DatasetError(path, "index", "frame numbers (results of a video)", str(frame.index[:1].tolist()))
    columns = [tuple(str(part) for part in column) for column in frame.columns]
    if not all(dtype.kind in "fiu" for dtype in frame.dtypes):
        raise DatasetError(path, "values", "numbers", "columns of another kind")
    levels = tuple(str(name) for name in frame.columns.names)
    values = np.asarray(frame.to_numpy(dtype=np.float64))
    return Table(
        path, levels, columns, [frame_number(path, "index", int(number)) for number in frame.index], values
    ).view()


def _load(path: Path) -> Any:
    """Return the table; its file is closed again."""
    pandas = require("pandas", f"{path}: DeepLabCut's h5")
    require("tables", f"{path}: DeepLabCut's h5")
    try:
        path.open("rb").close()
    except OSError as error:
        raise DatasetError(path, "file", "a readable file", (error.strerror or str(error)).lower()) from error
    try:
        with pandas.HDFStore(path, mode="r") as store:
            keys = [key.strip("/") for key in store.keys()]  # noqa: SIM118 - a store, not a dict
            return store[_KEY] if _KEY in keys else _no_table(path, keys)
    except DatasetError:
        raise
    except Exception as error:  # PyTables raises nearly anything for a damaged file
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise DatasetError(path, "file", "a complete HDF5 file of pandas", reason[-1]) from error


def _no_table(path: Path, keys: list[str]) -> Any:
    raise DatasetError(path, _KEY, "a table under this key", f"keys {', '.join(keys) or 'none'}")


FORMAT = DetectionFormat(
    name="deeplabcut",
    suffixes=(".h5",),
    matches=lambda path: hdf5_mentions(path, b"df_with_missing"),
    file=read_file,
    camera_part=camera_part,
)
