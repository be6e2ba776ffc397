"""Calibrations in OpenCV's ``FileStorage``, YAML or XML, read without OpenCV, and Kalibr's like its YAML.

EasyMocap's, OpenPose's, and those of two cameras as of OpenCV's stereo calibration.

Other parsers refuse its YAML: the header is ``%YAML:1.0``, matrices carry the tag ``!!opencv-matrix``. Read
here: numbers, texts, lists of texts (``- a`` lines or ``[a, b]``) and matrices, at the top level.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._budget import check_document, read_text
from skelsplat._fields import Field
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, warn
from skelsplat.io._files import natural
from skelsplat.io.calibration._entries import cameras_of, lens_of, matrix_of, rotation_of
from skelsplat.io.calibration._format import CalibrationFormat, Parsed, RawCamera, Source

_PASSED_OVER = re.compile(r"%YAML.*|#.*|---|\.\.\.|")
_KEY = re.compile(r"([^\s#%:-][^:]*):(?:\s+(.*))?")
_MATRIX = "!!opencv-matrix"


def _entries(path: Path) -> Field:
    """Return the top-level entries of a file: matrices and lists as nested lists, numbers, texts."""
    text = read_text(path)
    check_document(path, text)
    blocks = _blocks(path, text).items()
    found = {key: _value(path, key, first, " ".join(rest)) for key, (first, *rest) in blocks}
    return Field(path, "", found)


def _blocks(path: Path, text: str) -> dict[str, list[str]]:
    """Return by top-level key what stands behind it, and the lines below."""
    blocks: dict[str, list[str]] = {}
    key = None
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if _PASSED_OVER.fullmatch(stripped):
            continue
        indented = line[:1].isspace() or stripped.startswith("- ")
        found = None if indented else _KEY.fullmatch(stripped)
        if found:
            key = found[1].strip().strip("\"'")
            if key in blocks:
                raise DatasetError(path, f"{key} (line {number})", "a key once", "the same key again")
            blocks[key] = [found[2] or ""]
        elif indented and key is not None:
            blocks[key].append(stripped)
        else:
            raise DatasetError(path, f"line {number}", "key: value", repr(stripped[:60]))
    return blocks


def _value(path: Path, key: str, first: str, rest: str) -> Any:
    """Return what stands behind a key and, if it goes on, in the lines below."""
    if first.startswith(_MATRIX):
        parts = dict(re.findall(r"\b(rows|cols): *(\d+)", rest))
        data = re.search(r"\bdata: *\[([^\]]*)\]", rest)
        return _matrix(path, key, {**parts, "data": data[1].replace(",", " ")} if data else parts)
    if first.startswith("["):
        return [one.strip("\"' ") for one in f"{first} {rest}".strip("[] ").split(",") if one.strip()]
    if not first:
        return [one.strip("\"' ") for one in f" {rest}".split(" - ") if one.strip()]
    try:
        return float(first)
    except ValueError:
        return first.strip("\"'")


def _matrix(path: Path, key: str, parts: Mapping[str, str]) -> list[list[float]]:
    """Return the rows of a matrix."""
    try:
        shape = int(parts["rows"]), int(parts["cols"])
        return np.reshape([float(word) for word in parts["data"].split()], shape).tolist()
    except (KeyError, ValueError) as error:
        raise DatasetError(path, key, "a matrix with rows, cols and data", error) from error


_ROOT = "opencv_storage"


def _is_openpose(source: Source) -> bool:
    if source.is_folder:
        return any(file.suffix.lower() == ".xml" for file in source.files)
    return source.xml is not None and source.xml.tag == _ROOT


def _parse_openpose(source: Source) -> Parsed:
    """Return the camera of every file of OpenPose's, 2.xml before 10.xml: one OpenCV XML each, metres.

    ``CameraMatrix`` 3×4 is world → camera [R | t], ``Intrinsics`` 3×3, ``Distortion`` n×1 in OpenCV's order.
    The camera's name is that of its file. The image size is not in the files.
    """
    files = [f for f in source.files if f.suffix.lower() == ".xml"] if source.is_folder else [source.path]
    files.sort(key=lambda file: natural(file.stem))
    cameras = []
    for file in (one for one in files if source.keeps(one.stem)):
        entry = _xml_matrices(Source(file))
        pose, K = entry["CameraMatrix"].numbers((3, 4)), entry["Intrinsics"].numbers((3, 3))
        cameras.append(RawCamera(file.stem, K, pose[:, :3], pose[:, 3], lens_of(entry["Distortion"])))
    return cameras, "m"


def _xml_matrices(source: Source) -> Field:
    """Return the matrices of an XML file."""
    if source.xml is None or source.xml.tag != _ROOT:
        raise DatasetError(source.path, "XML", f"<{_ROOT}>, as OpenCV writes it", "something else")
    parts = {node.tag: {child.tag: child.text or "" for child in node} for node in source.xml if len(node)}
    return Field(source.path, "", {key: _matrix(source.path, key, part) for key, part in parts.items()})


_PAIR = ("intri", "extri")


def _is_easymocap(source: Source) -> bool:
    if source.is_folder:
        return any(_in_folder(source, part).is_file() for part in _PAIR)
    return source.start.startswith("%YAML") or _MATRIX in source.text


def _in_folder(source: Source, part: str) -> Path:
    """Return the place of one of the pair."""
    found = (file for file in source.files if file.name.lower() in (f"{part}.yml", f"{part}.yaml"))
    return next(found, source.path / f"{part}.yml")


def _parse_easymocap(source: Source) -> Parsed:
    """Return the cameras that EasyMocap's pair of files has, ``intri.yml`` and ``extri.yml``.

    ``names`` lists the cameras. ``intri.yml`` has ``K_NAME`` 3×3, ``dist_NAME`` or ``D_NAME``, and often
    ``H_NAME`` and ``W_NAME``, the image's height and width; ``extri.yml`` has ``Rot_NAME`` 3×3 or ``R_NAME``
    (Rodrigues vector), and ``T_NAME``, world → camera. Given is the folder or either file; a file of another
    name holds everything. Cameras are those in both. The length unit is that of the board.
    """
    path = source.path
    if source.is_folder:
        pair = [_in_folder(source, part) for part in _PAIR]
    else:
        own = next((part for part in _PAIR if part in path.name), None)
        pair = [path.with_name(path.name.replace(own, part)) if own else path for part in _PAIR]
    intri, extri = map(_entries, pair)
    names, placed = _easymocap_names(intri, "K_"), _easymocap_names(extri, "T_")
    both = [name for name in names if name in placed]
    if names and not both:
        raise extri["names"].error(f"cameras of {intri.path.name}: {', '.join(names)}", ", ".join(placed))
    if left := [name for name in dict.fromkeys((*names, *placed)) if name not in both]:
        words = (
            f"{path}: {', '.join(left)}: not in both of {' and '.join(file.name for file in pair)}, left out."
        )
        warn(Finding("calibration_read_as", "note", cameras_of(path, left), {"unread": True}, sentence=words))
    return [_easymocap_camera(intri, extri, name) for name in both if source.keeps(name)], None


def _easymocap_names(document: Field, prefix: str) -> list[str]:
    """Return the cameras that a file lists, or for which it has a matrix of this prefix."""
    known = [key.removeprefix(prefix) for key in document.value if key.startswith(prefix)]
    return document["names"].names() if "names" in document else known


def _easymocap_camera(intri: Field, extri: Field, name: str) -> RawCamera:
    lens = f"D_{name}" if f"D_{name}" in intri and f"dist_{name}" not in intri else f"dist_{name}"
    turn = f"Rot_{name}" if f"Rot_{name}" in extri else f"R_{name}"
    sides = [intri[f"{side}_{name}"] for side in "WH"]
    there = any(not side.is_missing for side in sides)
    return RawCamera(
        name=name,
        K=intri[f"K_{name}"].numbers((3, 3)),
        R=rotation_of(extri[turn]),
        t=extri[f"T_{name}"].numbers((3,)),
        distortion=lens_of(intri[lens]),
        size=replace(sides[0], value=[side.number() for side in sides]).size() if there else None,
    )


_LENSES = ("intrinsic", "extrinsic")
_OF_PAIR = re.compile(r"^\s*<?(M1|K1|cameraMatrix1)\b", re.MULTILINE)


def _stereo_files(source: Source) -> list[Source]:
    """Return the one file, or those of lenses and places, in a folder or beside each other."""
    if not source.is_folder:
        own = next((part for part in _LENSES if part in source.path.name), None)
        names = [source.path.name.replace(own, part) for part in _LENSES] if own else [source.path.name]
        pair = [source.path.with_name(name) for name in names]
    else:
        pair = [file for part in _LENSES for file in source.files if part in file.name.lower()]
    return [source if file == source.path else Source(file) for file in pair if file.is_file()]


def _is_stereo(source: Source) -> bool:
    files = _stereo_files(source)
    known = (file.suffix in (".yml", ".yaml", ".xml") and file.start[:1] in ("%", "<") for file in files)
    return bool(files) and all(known) and _OF_PAIR.search(files[0].text) is not None


def _parse_stereo(source: Source) -> Parsed:
    """Return the two cameras of a stereo calibration of OpenCV; unit and image size are not in the file.

    ``M1`` or ``K1``, ``D1``, ``M2`` or ``K2``, ``D2``, and ``R`` and ``T``, which lead from the first camera,
    the world, to the second: one file, or ``intrinsics`` and ``extrinsics`` as of OpenCV's sample.
    """
    entries: dict[str, Any] = {}
    for file in _stereo_files(source):
        entries |= (_xml_matrices(file) if file.xml is not None else _entries(file.path)).value
    document = Field(source.path, "", entries)
    for name in "RT":
        if document[name].is_missing:
            raise document[name].error("it here or, as of OpenCV's sample, in extrinsics.yml", "none")
    places = [(np.eye(3), np.zeros(3)), (rotation_of(document["R"]), document["T"].numbers((3,)))]
    cameras = []
    for number, (R, t) in enumerate(places, start=1):
        K = document.first(*(f"{name}{number}" for name in ("M", "K", "cameraMatrix")))
        lens = document.first(*(f"{name}{number}" for name in ("D", "distCoeffs")))
        cameras.append(RawCamera(f"cam{number}", K.numbers((3, 3)), R, t, lens_of(lens)))
    return cameras, None


_KALIBR = re.compile(r"^cam\d+:\s*(?:#.*)?$", re.MULTILINE)
_POSES = ("T_cam_imu", "T_imu_cam", "T_cn_cnm1")


def _is_kalibr(source: Source) -> bool:
    text = source.text if source.suffix in (".yml", ".yaml") else ""
    return "intrinsics:" in text and "distortion_model:" in text and _KALIBR.search(text) is not None


def _parse_kalibr(source: Source) -> Parsed:
    """Return the cameras of Kalibr's ``camchain.yaml``, or as OpenVINS has it; metres.

    ``camN`` has ``intrinsics`` (fx, fy, cx, cy), ``distortion_coeffs`` of the ``distortion_model`` radtan
    (k1, k2, p1, p2), equidistant (OpenCV's fisheye) or none, ``resolution``, and a pose 4×4: ``T_cn_cnm1``,
    from the camera before it to this one, the first being the world; or, if all have it, from the IMU,
    ``T_cam_imu``, or to it, ``T_imu_cam``.
    """
    check_document(source.path, source.text)
    blocks = _blocks(source.path, source.text)
    entries = [
        Field(source.path, key, _kalibr_table(lines)) for key, lines in blocks.items() if key[:3] == "cam"
    ]
    every = [name for name in _POSES[:2] if all(name in entry for entry in entries)]
    cameras: list[RawCamera] = []
    pose = np.eye(4)
    for entry in entries:
        if every:
            given = entry[every[0]].numbers((16,)).reshape(4, 4)
            if every[0] == _POSES[1]:
                pose[:3, :3], pose[:3, 3] = given[:3, :3].T, -given[:3, :3].T @ given[:3, 3]
            else:
                pose = given
        elif cameras:
            pose = entry[_POSES[2]].numbers((16,)).reshape(4, 4) @ pose
        cameras.append(_kalibr_camera(entry, pose.copy()))
    return cameras, "m"


def _kalibr_camera(entry: Field, pose: Array) -> RawCamera:
    kind, model = entry["distortion_model"], entry["camera_model"]
    if model.value != "pinhole":
        raise model.error("pinhole (in Kalibr: --models pinhole-radtan or pinhole-equi)", model.shown)
    if kind.value not in ("radtan", "equidistant", "none"):
        raise kind.error("radtan, equidistant or none", kind.shown)
    fisheye = kind.value == "equidistant"
    lens = None if kind.value == "none" else lens_of(entry["distortion_coeffs"], fisheye=fisheye)
    K, size = matrix_of(*entry["intrinsics"].numbers((4,))), entry["resolution"].size()
    return RawCamera(entry.place, K, pose[:3, :3], pose[:3, 3], lens, size, fisheye)


def _kalibr_table(lines: Sequence[str]) -> dict[str, Any]:
    """Return the entries of a camera: texts, and numbers in one list, whatever their rows."""
    texts: dict[str, str] = {}
    key = ""
    for line in lines:
        bare = re.sub(r"(^|\s)#.*", "", line)
        found = _KEY.fullmatch(bare)
        key, rest = (found[1], found[2] or "") if found and bare[:1] != "[" else (key, bare)
        texts[key] = f"{texts.get(key, '')} {rest}"
    return {key: _numbers_in(text.strip()) for key, text in texts.items()}


def _numbers_in(text: str) -> Any:
    """Return all numbers of a text in one list; the text if it has others than these."""
    try:
        return [float(word) for word in re.sub(r"[\[\],]|- ", " ", text).split()]
    except ValueError:
        return text.strip("'\"")


FORMATS = (
    CalibrationFormat("kalibr", "Kalibr's camchain.yaml", _is_kalibr, _parse_kalibr),
    CalibrationFormat("opencv-stereo", "OpenCV's stereo files", _is_stereo, _parse_stereo, ("size",)),
    CalibrationFormat("openpose", "OpenPose's folder of XML", _is_openpose, _parse_openpose, ("size",)),
    CalibrationFormat("easymocap", "EasyMocap's YAML pair", _is_easymocap, _parse_easymocap, ("size",)),
)
