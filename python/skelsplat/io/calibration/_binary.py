"""Calibrations in binary files: OpenCap's pickles, MAT-files of DANNCE and Label3D, Human3.6M in HDF5."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._fields import Field
from skelsplat.exceptions import DatasetError, MissingPackageError
from skelsplat.io._arrays import hdf5_mentions
from skelsplat.io._files import natural
from skelsplat.io._guarded import read_guarded, read_hdf5, unpickle
from skelsplat.io.calibration._entries import SKEW, camera_of, matrix_of, warn_of_fit, without_skew
from skelsplat.io.calibration._format import CalibrationFormat, Parsed, RawCamera, Source
from skelsplat.io.calibration._json import HUMAN36M_SIZES, one_subject

_OPENCAP = "cameraIntrinsicsExtrinsics"
_PICKLES = (".pickle", ".pkl")


def _opencap_files(source: Source) -> dict[str, Path]:
    """Return the files by camera: of a session, its folder ``Videos``, or a folder with files or folders."""
    if not source.is_folder:
        name = source.path.stem if source.path.stem != _OPENCAP else source.path.absolute().parent.name
        return {name: source.path} if source.suffix in _PICKLES else {}
    for pattern in (f"*/{_OPENCAP}.pickle", f"Videos/*/{_OPENCAP}.pickle"):
        if found := {path.parent.name: path for path in source.path.glob(pattern)}:
            break
    else:
        found = {path.stem: path for path in source.files if path.suffix.lower() in _PICKLES}
    return {name: found[name] for name in sorted(found, key=natural)}


def _is_opencap(source: Source) -> bool:
    path = next(iter(_opencap_files(source).values()), None)
    try:
        return path is not None and "intrinsicMat" in _opencap_entry(path)
    except DatasetError:
        if source.is_folder:  # somebody else's
            return False
        raise


def _parse_opencap(source: Source) -> Parsed:
    """Return OpenCap's cameras, ``Videos/CAMERA/cameraIntrinsicsExtrinsics.pickle``; millimetres.

    Each pickle is a table of arrays: ``intrinsicMat`` 3×3, ``distortion`` in OpenCV's order, ``imageSize``
    (**height**, width), ``rotation`` 3×3 and ``translation`` 3×1, both world → camera; the world is that of
    the checkerboard. ``rotation_EulerAngles`` is the rotation once more, as a rotation vector. Nothing in a
    pickle is run.
    """
    files = _opencap_files(source)
    kept = [(name, path) for name, path in files.items() if source.keeps(name)]
    return [_opencap_camera(name, _opencap_entry(path)) for name, path in kept], "mm"


def _opencap_entry(path: Path) -> Field:
    return Field(path, "", _plain(unpickle(path)))


def _opencap_camera(name: str, entry: Field) -> RawCamera:
    K, R, t = "intrinsicMat", "rotation", "translation"
    camera = camera_of(entry.table(), name, K=K, R=R, t=t, lens="distortion", size="imageSize")
    return replace(camera, size=entry["imageSize"].size()[::-1])


_PARAMS = re.compile(r"_?params$")
_VARIABLES = ("params", "camnames", "K", "R", "r", "t", "RDistort", "TDistort")


def _mat_files(source: Source) -> list[Path]:
    """Return the file, or the files of single cameras in a folder."""
    if source.is_folder:
        found = [path for path in source.files if path.suffix == ".mat" and _PARAMS.search(path.stem)]
        return sorted(found, key=lambda path: natural(path.stem))
    return [source.path] if source.suffix == ".mat" else []


def _is_dannce(source: Source) -> bool:
    files = _mat_files(source)
    try:
        return bool(files) and not {"params", "K"}.isdisjoint(_mat(files[0]).value)
    except (DatasetError, MissingPackageError):  # of which parsing tells
        return True


def _parse_dannce(source: Source) -> Parsed:
    """Return the cameras of DANNCE and Label3D; millimetres.

    Either one MAT-file with ``params``, a cell of the cameras, and perhaps ``camnames`` (else ``Camera1``,
    …), or a folder of ``NAME_params.mat``, one per camera. A camera has MATLAB's matrices, which multiply
    rows from the right: ``K`` and ``r`` are the transposes of K and R, ``t`` is a row; ``RDistort`` has k1,
    k2 and perhaps k3, ``TDistort`` p1 and p2. In MATLAB the first pixel's centre is (1, 1): the principal
    point is moved by one. Skew, which MATLAB may estimate, is followed by half turning the camera; the
    remaining error is reported. The image size is not in the files.
    """
    entries: list[tuple[str, Field]] = []
    for path in _mat_files(source):
        document = _mat(path)
        if "params" not in document and "K" in document:
            entries.append((_PARAMS.sub("", path.stem) or path.stem, document))
            continue
        params = document["params"].entries("a cell of cameras with K, r, t, RDistort and TDistort")
        names = [f"Camera{i + 1}" for i in range(len(params))]
        if "camnames" in document:
            names = document["camnames"].names()
        if len(names) != len(params):
            raise document["camnames"].error(f"{len(params)} names, one per camera", f"{len(names)}")
        entries += zip(names, params, strict=True)
    errors: dict[str, float] = {}
    cameras = [_dannce_camera(name, entry, errors) for name, entry in entries if source.keeps(name)]
    warn_of_fit(source.path, errors, SKEW)
    return cameras, "mm"


def _mat(path: Path) -> Field:
    """Return the variables of a MAT-file as values of JSON; a cell of one element is a list."""
    expected = "a MAT-file of version 5 to 7 (in MATLAB: save with '-v7')"
    return Field(path, "", _plain(read_guarded("mat", path, expected, names=_VARIABLES)))


def _plain(value: Any) -> Any:
    """Return arrays as lists, MATLAB's structures as tables and its texts as texts, wherever they are."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, np.ndarray) and (value.dtype.kind in "OU" or value.dtype.names):
        parts = [one.strip() if isinstance(one, str) else _plain(one) for one in value.ravel()]
        return parts[0] if len(parts) == 1 and value.dtype.kind != "O" else parts
    if isinstance(value, np.void) and value.dtype.names:
        return {name: _plain(value[name]) for name in value.dtype.names}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _dannce_camera(name: str, entry: Field, errors: dict[str, float]) -> RawCamera:
    """Return a camera; the largest error of what stands for its skew, px, is added to `errors`."""
    K = entry.table()["K"].numbers((3, 3)).T.copy()
    K[:2, 2] -= 1.0
    rotation = entry["r" if "r" in entry or "R" not in entry else "R"].numbers((3, 3)).T
    radial, (p1, p2) = entry["RDistort"].numbers(None), entry["TDistort"].numbers((2,))
    if radial.size not in (2, 3):
        raise entry["RDistort"].error("2 or 3 numbers", f"{radial.size} of them")
    lens = np.array([radial[0], radial[1], p1, p2, *radial[2:]])
    K, turn, errors[name] = without_skew(K)
    return RawCamera(name, K, turn @ rotation, turn @ entry["t"].numbers((3,)), lens)


_CAMERA_H5 = re.compile(r"subject(\d+)/camera(\d+)/R")
_PARTS = ("R", "T", "f", "c", "k", "p", "Name")


def _is_human36m_h5(source: Source) -> bool:
    return source.suffix == ".h5" and hdf5_mentions(source.path, b"subject1", b"camera1")


def _parse_human36m_h5(source: Source, subject: str | None) -> Parsed:
    """Return a subject's cameras of ``cameras.h5``, Human3.6M as 3d-pose-baseline has it; millimetres.

    ``subjectN/cameraK`` has ``R``, transposed as MATLAB stores it, ``T``, the centre, ``f``, ``c``, ``k``
    with k1, k2, k3, ``p`` with p1, p2, and ``Name`` in characters' numbers. Of several subjects one must be
    named.
    """
    names = [f"subject*/camera*/{part}" for part in _PARTS]
    arrays = read_hdf5(source.path, names)["arrays"]
    places = sorted((m for m in map(_CAMERA_H5.fullmatch, arrays) if m), key=lambda m: int(m[2]))
    subjects = sorted({f"S{place[1]}" for place in places}, key=natural)
    chosen = one_subject(source.path, subjects, subject)
    cameras = []
    for place in (one[0].removesuffix("/R") for one in places if f"S{one[1]}" == chosen):
        found = {part: np.ravel(arrays.get(f"{place}/{part}", ())).tolist() for part in _PARTS}
        entry = Field(source.path, place, found)
        name = "".join(chr(int(code)) for code in entry["Name"].numbers(None) if 0 < code < 0x110000)
        R = entry["R"].numbers((9,)).reshape(3, 3).T
        (k1, k2, k3), (p1, p2) = entry["k"].numbers((3,)), entry["p"].numbers((2,))
        K = matrix_of(*entry["f"].numbers((2,)), *entry["c"].numbers((2,)))
        lens, size = np.array([k1, k2, p1, p2, k3]), HUMAN36M_SIZES.get(name)
        cameras.append(RawCamera(name, K, R, -R @ entry["T"].numbers((3,)), lens, size))
    return cameras, "mm"


FORMATS = (
    CalibrationFormat("opencap", "OpenCap's session or pickles", _is_opencap, _parse_opencap),
    CalibrationFormat(
        "human36m-h5",
        "3d-pose-baseline's cameras.h5",
        _is_human36m_h5,
        _parse_human36m_h5,
        ("subject", "size"),
    ),
    CalibrationFormat("dannce", "DANNCE's and Label3D's MAT-files", _is_dannce, _parse_dannce, ("size",)),
)
