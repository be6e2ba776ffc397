"""Files that claim, nest or repeat more than they hold are refused in one line, at once, in little memory."""

from __future__ import annotations

import os
import re
import resource
import struct
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import _budget, io
from skelsplat.io._files import load_json

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="limits of memory, pipes and devices of Linux"
)
_MORE = 400 * 2**20  # bytes that a refusal may take


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (used + _MORE, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (hard, hard))


def calibration(path: Path) -> object:
    return io.read_calibration(path, unit="mm")


def detections(path: Path) -> object:
    return io.read_detections(path, ["cam0", "cam1"], layout="coco17", order="sorted")


def refused(read: Callable[[Path], object], path: Path, field: str) -> None:
    with pytest.raises(sk.DatasetError, match=": expected ") as caught:
        read(path)
    assert caught.value.path == path
    assert re.fullmatch(field, caught.value.field)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def npy(shape: object, data: bytes = b"") -> bytes:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text.encode() + data


DEEP = f'{{"format": "skelsplat-calibration", "version": 1, "cameras": {"[" * 960}{"]" * 960}}}'
YAML = "%YAML:1.0\n"
# name and content of a file, and the field that is refused
TEXTS: dict[str, tuple[str, str, str]] = {
    "a word in YAML": ("c.yml", f"{YAML}K_a: !!opencv-matrix\n   {'a' * 200_000}", "K_a"),
    "blanks in YAML": ("c.yml", f"{YAML}a{' ' * 10**6}b", "line 2"),
    "digits in YAML": ("c.yml", f"{YAML}a: {'1' * 200_000}x", "cameras"),
    "blank lines": ("c.toml", "\n" * 200_000 + "x", "content"),
    "JSON 960 deep": ("c.json", DEEP, "JSON"),
    "JSON 10^6 deep": ("c.json", '{"a": ' + "[" * 10**6, "JSON"),
    "half a character": ("c.json", r'{"joint_names": ["\ud800"]}', "JSON"),
    "a key twice": ("c.json", '{"a": 1, "a": 2}', "JSON"),
    "a long TOML": ("c.toml", "a = 1\n" * 400_000, "file"),
    "TOML nested": ("c.toml", f"a = {'[' * 10**5}{']' * 10**5}", "TOML"),
    "XML entities": ("c.xml", "<!DOCTYPE a><a/>", "XML"),
    "XML nested": ("c.xml", "<a>" * 1000 + "</a>" * 1000, "content"),
    "many columns": ("d.csv", "frame,joint,x,y" + ",1" * 10**6, "line 1"),
    "a long line": ("d.csv", "frame,joint,x,y\n" + "1" * 5_000_000, "line 2"),
}


@pytest.mark.parametrize("case", TEXTS)
def test_text_is_read_in_time_proportional_to_its_length(tmp_path: Path, case: str) -> None:
    name, text, field = TEXTS[case]
    path = tmp_path / name
    path.write_text(text)
    refused(detections if name == "d.csv" else calibration, path, field)


def test_brackets_in_strings_do_not_nest(tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    path.write_text(r'["\"' + "[{" * 100 + r'\\", ["]"], ' + '"[" , ' * 100 + '"\u0130"]')
    assert load_json(path, "x")[1] == ["]"]


@pytest.mark.parametrize("name", ["c.json", "d.csv", "p.npz", "d.h5", "x.mat"])
def test_what_is_no_file_is_not_opened(tmp_path: Path, name: str) -> None:
    read = io.read_pose if name[0] == "p" else calibration if name[0] in "cx" else detections
    path = tmp_path / name
    for make, kind in (
        (os.mkfifo, "a pipe"),
        (lambda p: p.symlink_to("/dev/zero"), "a device"),
        (lambda p: p.symlink_to(p.name), "too many levels of symbolic links"),
    ):
        make(path)
        with pytest.raises(sk.DatasetError) as caught:
            read(path)
        assert kind in str(caught.value)
        path.unlink()


def test_a_file_larger_than_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_budget, "_available", lambda: 2**27)
    path = tmp_path / "p.json"
    path.write_bytes(b" " * 7 * 10**7)
    refused(io.read_pose, path, "file")


def zipped(path: Path, member: bytes, name: str = "pose.npy") -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, member)
    return path


def test_a_zip_file_does_not_unpack_to_gigabytes(tmp_path: Path) -> None:
    path = zipped(tmp_path / "pose.npz", npy((10**6, 17, 3)))
    content = bytearray(path.read_bytes())
    struct.pack_into(
        "<I", content, content.rfind(b"PK\1\2") + 24, 4 * 10**9
    )  # what its list of members claims
    path.write_bytes(content)
    refused(io.read_pose, path, "file")


NPY = {
    "claims 80 GB": npy((2, 10**8, 25, 2)),
    "negative": npy((-2, 3, 17, 2)),
    "no numbers": npy((10**15, 0, 17, 2)),
    "axes": npy((1,) * 100, data=bytes(8)),
    "a version": b"\x93NUMPY\x09\x00" + bytes(99),
}


@pytest.mark.parametrize("case", NPY)
def test_a_header_of_npy_claims_what_is_there(tmp_path: Path, case: str) -> None:
    path = tmp_path / "x.npy"
    path.write_bytes(NPY[case])
    refused(sk.io._arrays.load_npy, path, "array")
    refused(io.read_pose, zipped(tmp_path / "x.npz", NPY[case]), "pose")


@pytest.mark.parametrize("kind", ["json", "csv", "trc", "c3d", "nc"])
def test_an_infinite_coordinate_is_refused(tmp_path: Path, kind: str) -> None:
    pytest.importorskip({"c3d": "ezc3d", "nc": "h5netcdf"}.get(kind, "json"))
    path = tmp_path / f"p.{kind}"
    io.write_pose(path, io.PoseData(np.full((2, 1, 3), 7.5), ("a",), np.arange(2), "mm", frame_rate=9.0))
    content = path.read_bytes()
    for there, infinite in (
        (b"0.0075" if kind == "trc" else b"7.5", b"1e999"),
        (np.float32([7.5]).tobytes(), np.float32([np.inf]).tobytes()),
        (np.float64([7.5]).tobytes(), np.float64([np.inf]).tobytes()),
    ):
        content = content.replace(there, infinite, 1)
    path.write_bytes(content)
    refused(io.read_pose, path, r"pose|frames.*")


HEADER = "frame,joint,x,y,camera\n"
CROWDS = {
    "places in csv": ("d.csv", HEADER + "".join(f"{k},9999,5,5,cam0\n" for k in range(5000)), "joint"),
    "cameras": ("d.csv", HEADER + "".join(f"0,0,5,5,c{k}\n" for k in range(5000)), "views"),
    "a name": ("d.csv", f"{HEADER}0,0,5,5,cam0\n0,0,5,5,{'a1' * 5000}\n", "views"),
}


@pytest.mark.parametrize("case", CROWDS)
def test_a_table_does_not_grow_with_the_square_of_its_lines(tmp_path: Path, case: str) -> None:
    name, text, field = CROWDS[case]
    (tmp_path / name).write_text(text)
    refused(detections, tmp_path / name, field)
