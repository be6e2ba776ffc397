"""Calibrations with one thing broken at a time: the message names the file and the field."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import calibration_files as files
import skelsplat as sk
from calibration_files import FORMATS_WRITTEN, NAMES
from skelsplat.io import read_calibration
from skelsplat.io.calibration import FORMATS

N = NAMES[0]


@pytest.fixture
def views():
    return files.reference(NAMES)


def _edit(path, old, new):
    text = path.read_text()
    assert old in text, old
    path.write_text(text.replace(old, new, 1))
    return path


def _json_edit(path, change):
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    return path


def _npz_edit(path, **changes):
    with np.load(path) as archive:
        arrays = {**archive, **changes}
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


def _pickle(path):
    return path / "Videos" / N / "cameraIntrinsicsExtrinsics.pickle"


def _pickle_edit(path, **changes):
    table = {**pickle.loads(_pickle(path).read_bytes()), **changes}
    _pickle(path).write_bytes(pickle.dumps({key: value for key, value in table.items() if value is not None}))
    return path


def _mat_edit(path, *, camnames=None, **changes):
    cameras = [files.matlab_camera(v) for v in files.reference(NAMES)]
    cameras[1] = {key: value for key, value in {**cameras[1], **changes}.items() if value is not None}
    scipy.io.savemat(path, {"params": files.cell(cameras), "camnames": files.cell(camnames or NAMES)})
    return path


def _compressed_otherwise(path):
    """Say method 99, which nothing can unpack, in the first entry of the archive's directory."""
    data = bytearray(path.read_bytes())
    place = data.index(b"PK\x01\x02") + 10
    data[place] = 99
    path.write_bytes(data)
    return path


def _pair(path, name, old, new):
    _edit(path / name, old, new)
    return path


LENS = "{}: !!opencv-matrix\n   rows: 1\n   cols: 4\n   dt: d\n   data: [ {} ]\n"
# format: one thing broken, and what the message must say after the file's name
MALFORMED = {
    "caliscope": {
        "misspelt lens": (lambda p: _edit(p, "distortions = ", "distorsions = "), r"cameras\.0\.distortions"),
        "no size": (lambda p: _edit(p, "size = ", "sizes = "), r"cameras\.0\.size"),
        "uncalibrated": (lambda p: _edit(p, "rotation = [[", "extra = [["), r"cameras\.0\.rotation"),
        "short matrix": (lambda p: _edit(p, ", [0.0, 0.0, 1.0]]", "]"), r"cameras\.0\.matrix"),
        "all ignored": (
            lambda p: (p.write_text(p.read_text().replace("ignore = false", "ignore = true")), p)[1],
            "cameras",
        ),
        "stretched rotation": (
            lambda p: _edit(p, "rotation = [[", "rotation = [[9, 0, 0], [0, 1, 0], [0, 0, 1]]\nold = [["),
            "R of camera 'cam_0'",
        ),
    },
    "voxelpose": {
        "no centre": (lambda p: _json_edit(p, lambda d: d[N].pop("T")), rf"{N}\.T"),
        "two radial coefficients": (lambda p: _json_edit(p, lambda d: d[N]["k"].pop()), rf"{N}\.k"),
        "no lens": (lambda p: _json_edit(p, lambda d: d[N].pop("p")), rf"{N}\.p"),
        "a note between the cameras": (lambda p: _json_edit(p, lambda d: d.update(note="Shelf")), "note"),
    },
    "4d-association": {
        "eleven numbers": (lambda p: _json_edit(p, lambda d: d[N]["RT"].pop()), rf"{N}\.RT"),
        "no size": (lambda p: _json_edit(p, lambda d: d[N].pop("imgSize")), rf"{N}\.imgSize"),
        "no translation": (lambda p: _json_edit(p, lambda d: d[NAMES[1]].pop("T")), rf"{NAMES[1]}\.T"),
        "three coefficients": (
            lambda p: _json_edit(p, lambda d: d[N].update(distCoeff=[0.1, 0.0, 0.0])),
            rf"{N}\.distCoeff",
        ),
    },
    "opencap": {
        "intrinsics alone": (
            lambda p: _pickle_edit(p, rotation=None),
            rf"{N}.cameraIntrinsicsExtrinsics\.pickle: document",
        ),
        "no translation": (lambda p: _pickle_edit(p, translation=None), "translation"),
        "half a pixel": (lambda p: _pickle_edit(p, imageSize=np.array([[720.5], [1280.0]])), "imageSize"),
        "a class": (lambda p: _pickle_edit(p, distortion=Path("lens")), "pickle"),
        "cut": (lambda p: (_pickle(p).write_bytes(_pickle(p).read_bytes()[:90]), p)[1], "pickle"),
        "a list": (lambda p: (_pickle(p).write_bytes(pickle.dumps([1.0])), p)[1], "document"),
    },
    "dannce": {
        "no rotation": (lambda p: _mat_edit(p, r=None), r"params\[1\]\.r"),
        "one radial coefficient": (
            lambda p: _mat_edit(p, RDistort=np.array([[0.1]])),
            r"params\[1\]\.RDistort",
        ),
        "fewer names than cameras": (lambda p: _mat_edit(p, camnames=["a", "b", "c"]), "camnames"),
        "no cameras": (lambda p: (scipy.io.savemat(p, {"com": 1.0}), p)[1], "params"),
        "no MAT-file": (lambda p: (p.write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600)), p)[1], "file"),
    },
    "easymocap": {
        "misspelt lens": (lambda p: _pair(p, "intri.yml", f"dist_{N}:", f"dost_{N}:"), f"dist_{N}"),
        "two lenses": (
            lambda p: _pair(p, "intri.yml", f"H_{N}:", LENS.format(f"D_{N}", "0.1, 0, 0, 0") + f"H_{N}:"),
            rf"intri\.yml: D_{N}",
        ),
        "no partner": (lambda p: ((p / "extri.yml").unlink(), p)[1], r"extri\.yml: file"),
        "no T": (lambda p: _pair(p, "extri.yml", f"T_{N}:", "Q:"), rf"extri\.yml: T_{N}"),
        "short matrix": (
            lambda p: _pair(p, "extri.yml", "rows: 3\n   cols: 1", "rows: 4\n   cols: 1"),
            rf"extri\.yml: R_{N}",
        ),
        "two rotations": (
            lambda p: (
                _pair(p, "extri.yml", "Rot_55011271", "Rot_54138969b")
                .joinpath("extri.yml")
                .write_text(
                    (p / "extri.yml")
                    .read_text()
                    .replace("Rot_54138969:", "old:")
                    .replace("Rot_54138969b", "Rot_54138969")
                )
                and p
            ),
            rf"extri\.yml: Rot_{N}",
        ),
        "no key": (
            lambda p: _pair(p, "intri.yml", f"K_{N}: !!opencv-matrix", "something"),
            r"intri\.yml: line 8",
        ),
    },
    "openpose": {
        "not closed": (lambda p: _pair(p, f"{N}.xml", "</opencv_storage>", ""), rf"{N}\.xml: XML"),
        "other root": (
            lambda p: _pair(
                _pair(p, f"{N}.xml", "<opencv_storage>", "<a>"), f"{N}.xml", "</opencv_storage>", "</a>"
            ),
            rf"{N}\.xml: root",
        ),
        "short": (lambda p: _pair(p, f"{N}.xml", "<rows>8", "<rows>9"), rf"{N}\.xml: Distortion"),
    },
    "panoptic": {
        "cut": (lambda p: (p.write_text(p.read_text()[:500]), p)[1], "JSON"),
        "no R": (lambda p: _json_edit(p, lambda d: d["cameras"][1].pop("R")), r"cameras\[1\]\.R"),
        "no hd": (lambda p: _json_edit(p, lambda d: [c.update(type="vga") for c in d["cameras"]]), "type"),
        "mirrored": (
            lambda p: _json_edit(
                p, lambda d: d["cameras"][1].update(R=(-np.array(d["cameras"][1]["R"])).tolist())
            ),
            r"R of camera '5413\d+'",
        ),
    },
    "human36m": {
        "no camera": (lambda p: _json_edit(p, lambda d: d["intrinsics"].pop(N)), rf"intrinsics\.{N}"),
        "no lens": (
            lambda p: _json_edit(p, lambda d: d["intrinsics"][N].pop("distortion")),
            rf"intrinsics\.{N}\.distortion",
        ),
        "cut": (lambda p: (p.write_text(p.read_text()[:-9]), p)[1], "JSON"),
    },
    "qualisys": {
        "not closed": (lambda p: _edit(p, "</calibration>", ""), "XML"),
        "no focal length": (lambda p: _edit(p, "focalLengthU", "f"), rf"camera {N}\.intrinsic\.focalLengthU"),
        "no view": (lambda p: _edit(p, "<fov_video", "<fov"), rf"camera {N}\.fov_video"),
        "odd view": (lambda p: _edit(p, 'right="999"', 'right="-5"'), rf"camera {N}\.fov_video"),
        "skew": (lambda p: _edit(p, 'skew="0.0', 'skew="2.0'), rf"camera {N}\.intrinsic\.skew"),
        "no rotation": (lambda p: _edit(p, 'r11="', 'r11="5" old="'), f"R of camera '{N}'"),
    },
    "theia": {
        "not active": (
            lambda p: (p.write_text(p.read_text().replace('active="1"', 'active="0"')), p)[1],
            "active",
        ),
        "no transform": (lambda p: _edit(p, "<transform", "<transformation"), rf"camera {N}\.transform"),
        "half a pixel": (
            lambda p: _edit(p, 'sensorMaxU="1000"', 'sensorMaxU="1000.5"'),
            rf"camera {N}\.intrinsic\.sensorMaxU",
        ),
        "skew": (lambda p: _edit(p, 'skew="0"', 'skew="2"'), rf"camera {N}\.intrinsic\.skew"),
    },
    "vicon": {
        "no video": (lambda p: (p.write_text(p.read_text().replace("VueVIDEO", "Vue")), p)[1], "TYPE"),
        "no frame": (lambda p: _edit(p, "<KeyFrame ", "<Frame "), rf"Camera {N}\.KeyFrames\.KeyFrame"),
        "no unit": (
            lambda p: _edit(p, 'ORIENTATION="', 'ORIENTATION="1 1 1 1" OLD="'),
            rf"Camera {N}\.ORIENTATION",
        ),
        "lens": (lambda p: _edit(p, ' 0 0 0"', ' -0.3 0.1 0"'), rf"Camera {N}\.VICON_RADIAL2"),
        "short lens": (lambda p: _edit(p, ' 0 0 0"', ' 0 0"'), rf"Camera {N}\.VICON_RADIAL2"),
        "misspelt lens": (
            lambda p: _edit(p, "VICON_RADIAL2", "VICON_RADIAL3"),
            rf"Camera {N}\.VICON_RADIAL2",
        ),
        "skew": (lambda p: _edit(p, 'SKEW="0"', 'SKEW="0.1"'), rf"Camera {N}\.SKEW"),
    },
    "json": {
        "version": (lambda p: _json_edit(p, lambda d: d.update(version=2)), "version"),
        "unit": (lambda p: _json_edit(p, lambda d: d.update(unit="inch")), "unit"),
        "no cameras": (lambda p: _json_edit(p, lambda d: d.update(cameras=[])), "cameras"),
        "one camera for the list": (
            lambda p: _json_edit(p, lambda d: d.update(cameras=d["cameras"][0])),
            "cameras",
        ),
        "no K": (lambda p: _json_edit(p, lambda d: d["cameras"][0].pop("K")), r"cameras\[0\]\.K"),
    },
    "npz": {
        "no names": (lambda p: _npz_edit(p, names=None), "names"),
        "names in no encoding": (
            lambda p: _npz_edit(p, names=np.array([b"a", b"\xff\xfe", b"c", b"d"])),
            r"names\[1\]",
        ),
        "unit": (lambda p: _npz_edit(p, unit="inch"), "unit"),
        "NaN": (lambda p: _npz_edit(p, K=np.full((4, 3, 3), np.nan)), r"\[0\]\.K"),
        "hole": (
            lambda p: _npz_edit(p, distortion=np.tile([0.1, np.nan, 0.1, 0.1, 0.1], (4, 1))),
            r"distortion\[0\]",
        ),
        "pickled": (lambda p: _npz_edit(p, K=np.array([None] * 4, dtype=object)), "K"),
        "unknown compression": (_compressed_otherwise, r"\w+"),
        "no zip": (lambda p: (p.write_bytes(b"PK\x03\x04 no"), p)[1], "file"),
    },
}
CASES = [(name, case) for name, cases in MALFORMED.items() for case in cases]


@pytest.mark.parametrize(("name", "case"), CASES, ids=[f"{name}: {case}" for name, case in CASES])
def test_a_malformed_file_is_named_with_its_field(tmp_path, views, name, case):
    write, options, *_ = FORMATS_WRITTEN.get(name, (files.vicon, {}))
    change, field = MALFORMED[name][case]
    path = change(write(tmp_path, views))
    with pytest.raises(sk.DatasetError, match=f"{field}: expected") as caught:
        read_calibration(path, format=name, **options)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_every_format_has_malformed_twins():
    assert set(MALFORMED) == set(FORMATS) - {"anipose"}  # whose twins are in test_calibration.py
    assert min(len(cases) for cases in MALFORMED.values()) >= 3
