"""Several people in one file: csv with a column for the person, json, and NetCDF for movement."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from skelsplat._arrays import Index
from skelsplat._atomic import atomic_path, atomic_write_text, make_room
from skelsplat.exceptions import InvalidInputError
from skelsplat.io.poses._csv import COLUMNS, csv_text, rows_of
from skelsplat.io.poses._json import people_text
from skelsplat.io.poses._pose_data import ARRAYS, PoseData
from skelsplat.io.poses._xarray import check_packages, room_for, to_xarray


def write_people(path: str | os.PathLike[str], people: Mapping[int, PoseData]) -> None:
    """Write several people into one file, whose extension names the format.

    ``.csv`` has the columns of `write_csv` after one called ``person``, and times from the first frame of
    all. ``.json`` is an object with ``format`` ("skelsplat-people"), ``version`` (1) and ``people``, a list
    of the objects of `write_json`, each with ``person``. ``.nc`` is the dataset of `to_xarray` with an
    individual ``person_0``, … each, over the frames of all: where a person is not there, positions are NaN.

    Parameters
    ----------
    path : path
        Ends in ``.csv``, ``.json`` or ``.nc``.
    people : dict of int to PoseData
        By identity; all have the same joints.

    Raises
    ------
    InvalidInputError
        If the extension is another, or there is nobody.
    MissingPackageError
        If the format needs a package that is not installed.
    """
    kind = os.fspath(path).rpartition(".")[2].lower()
    if kind not in PEOPLE_FORMATS:
        known = ", ".join(f".{name}" for name in PEOPLE_FORMATS)
        raise InvalidInputError(f"path: expected a name that ends in {known}, got {os.fspath(path)!r}")
    if not people:
        raise InvalidInputError("people: expected at least one, got none")
    PEOPLE_FORMATS[kind](path, people)


def _write_csv(path: str | os.PathLike[str], people: Mapping[int, PoseData]) -> None:
    start = min((int(data.frames[0]) for data in people.values() if data.frames.size), default=0)
    rows = ([identity, *row] for identity, data in people.items() for row in rows_of(data, start))
    atomic_write_text(path, csv_text([("person", *COLUMNS), *rows]))


def _write_netcdf(path: str | os.PathLike[str], people: Mapping[int, PoseData]) -> None:
    xarray = check_packages()
    frames = np.unique(np.concatenate([data.frames for data in people.values()]))
    each = [to_xarray(_on_frames(data, frames), individual=f"person_{k}") for k, data in people.items()]
    dataset = xarray.concat(each, dim="individuals", data_vars="minimal", coords="minimal", join="exact")
    with atomic_path(path) as temporary:
        make_room(temporary, room_for(dataset, len(frames)))
        dataset.to_netcdf(temporary, engine="h5netcdf")


def _on_frames(data: PoseData, frames: Index) -> PoseData:
    """Return the poses over more frames; in the others joints are unobserved."""
    places = np.searchsorted(frames, data.frames)
    whole: dict[str, Any] = {"frames": frames}
    for name, (_, kind) in ARRAYS.items():
        own = getattr(data, name)
        if len(own) == len(data.frames):
            empty = {np.float64: np.nan, np.str_: "unobserved"}.get(kind, 0)
            dtype = "U10" if kind is np.str_ else own.dtype
            whole[name] = np.full((len(frames), *own.shape[1:]), empty, dtype)
            whole[name][places] = own
    return replace(data, **whole)


#: The formats that hold several people, by extension.
PEOPLE_FORMATS: dict[str, Callable[[str | os.PathLike[str], Mapping[int, PoseData]], None]] = {
    "csv": _write_csv,
    "json": lambda path, people: atomic_write_text(path, people_text(people)),
    "nc": _write_netcdf,
}
