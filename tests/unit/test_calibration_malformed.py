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


def text(old, new, file=""):
    """Replace a text once, in a file of the calibration's folder or in the calibration."""

    def change(path):
        content = (path / file).read_text() if file else path.read_text()
        assert old in content, old
        (path / file if file else path).write_text(content.replace(old, new, 1))

    return change


def tree(change):
    """Change a JSON document."""

    def apply(path):
        document = json.loads(path.read_text())
        change(document)
        path.write_text(json.dumps(document))

    return apply


def arrays(**changes):
    """Change arrays of an npz; None removes one."""

    def change(path):
        with np.load(path) as archive:
            found = {**archive, **changes}
        np.savez(path, **{name: value for name, value in found.items() if value is not None})

    return change


def pickled(**changes):
    """Change entries of the pickle of OpenCap's first camera; None removes one."""

    def change(path):
        file = path / "Videos" / N / "cameraIntrinsicsExtrinsics.pickle"
        table = {**pickle.loads(file.read_bytes()), **changes}
        file.write_bytes(pickle.dumps({key: value for key, value in table.items() if value is not None}))

    return change


def matlab(*, camnames=NAMES, **changes):
    """Change the second of DANNCE's cameras, or the names; None removes an entry."""

    def change(path):
        cameras = [files.matlab_camera(v) for v in files.reference(NAMES)]
        cameras[1] = {key: value for key, value in {**cameras[1], **changes}.items() if value is not None}
        scipy.io.savemat(path, {"params": files.cell(cameras), "camnames": files.cell(camnames)})

    return change


def h5(name):
    """Remove a dataset."""

    def change(path):
        import h5py

        with h5py.File(path, "a") as file:
            del file[name]

    return change


def replaced(content):
    """Put other content into the file."""
    return lambda path: path.write_bytes(content)


def cut(path):
    path.write_bytes(path.read_bytes()[:500])


# format, what is broken in its file, and the field that the message must name after the file
CASES = [
    ("anipose", text("matrix", "matrx"), r"cam_0\.matrix"),
    ("anipose", text("fisheye = false", "fisheye = true"), r"cam_0\.distortions"),
    ("anipose", text(f'"{NAMES[1]}"', f'"{N}"'), "cameras"),
    ("anipose", text(f'"{N}"', '" "'), "name"),
    ("anipose", text("rotation = [", "rotation = [0.0, 90.0, 0.0]\nother = ["), r"cam_0\.rotation"),
    ("anipose", replaced("[cam]".encode("utf-16")), "file"),
    ("caliscope", text("rotation = [[", "rotation = [[1, 0], [0, 1, 0]]\nold = [["), r"cameras\.0\.rotation"),
    ("voxelpose", tree(lambda d: d[N].pop("T")), rf"{N}\.T"),
    ("voxelpose", tree(lambda d: d[N]["k"].pop()), rf"{N}\.k"),
    ("voxelpose", tree(lambda d: d.update(note="Shelf")), "note"),
    ("voxelpose", text(f'"{NAMES[1]}":', f'"{N}":'), "JSON"),
    ("4d-association", tree(lambda d: d[N]["RT"].pop()), rf"{N}\.RT"),
    ("4d-association", tree(lambda d: d[N].update(distCoeff=[0.1, 0.0, 0.0])), rf"{N}\.distCoeff"),
    ("opencap", pickled(rotation=None, translation=None), "rotation"),
    ("opencap", pickled(imageSize=np.array([[720.5], [1280.0]])), "imageSize"),
    ("opencap", pickled(distortion=Path("lens")), "pickle"),
    ("dannce", matlab(r=None), r"params\[1\]\.r"),
    ("dannce", matlab(RDistort=np.array([[0.1]])), r"params\[1\]\.RDistort"),
    ("dannce", matlab(camnames=["a", "b", "c"]), "camnames"),
    ("dannce", replaced(b"MATLAB 7.3 MAT-file" + bytes(600)), "file"),
    ("easymocap", text(f"dist_{N}:", f"dost_{N}:", "intri.yml"), f"dist_{N}"),
    ("easymocap", lambda path: (path / "extri.yml").unlink(), r"extri\.yml: file"),
    ("easymocap", text(f"K_{N}: !!opencv-matrix", "something", "intri.yml"), r"intri\.yml: line 8"),
    ("kalibr", text("T_cn_cnm1", "T_cn"), r"cam1\.T_cn_cnm1"),
    ("kalibr", text("radtan", "fov"), r"cam0\.distortion_model"),
    ("kalibr", text("resolution: [1000, ", "resolution: ["), r"cam0\.resolution"),
    ("opencv-stereo", text("D2:", "E2:"), "D2"),
    ("opencv-stereo", text("T: !!opencv-matrix\n   rows: 3", "T: !!opencv-matrix\n   rows: 2"), "T"),
    ("matrices", tree(lambda d: d[N].pop()), N),
    ("matrices", tree(lambda d: d.update({N: [[0] * 4] * 3})), N),
    ("colmap", text("FULL_OPENCV", "FOV", "cameras.txt"), "line 2"),
    ("colmap", text(" 0.0\n", "\n", "cameras.txt"), "line 2"),
    ("colmap", text("7 ", "7 9 ", "images.txt"), "line 3"),
    ("colmap", text(" -1 7.0", " 7.0", "images.txt"), "line 6"),
    ("colmap", lambda path: (path / "cameras.txt").rename(path / "cameras.bin"), r"cameras\.txt"),
    ("human36m-h5", h5("subject9/camera2/T"), r"subject9/camera2\.T"),
    ("human36m-h5", lambda path: path.write_bytes(path.read_bytes()[:900]), "file"),
    ("openpose", text("</opencv_storage>", "", f"{N}.xml"), rf"{N}\.xml: XML"),
    ("panoptic", tree(lambda d: d["cameras"][1].pop("R")), r"cameras\[1\]\.R"),
    ("panoptic", cut, "JSON"),
    ("panoptic", tree(lambda d: [c.update(type="vga") for c in d["cameras"]]), "type"),
    ("human36m", tree(lambda d: d["intrinsics"].pop(N)), rf"intrinsics\.{N}.*|calibration_matrix"),
    ("human36m", tree(lambda d: d["intrinsics"][N].pop("distortion")), "distortion"),
    ("qualisys", text("focalLengthU", "f"), rf"camera {N}\.intrinsic\.focalLengthU"),
    ("qualisys", text("<fov_video", "<fov"), rf"camera {N}\.fov_video\.left"),
    ("qualisys", text('right="999"', 'right="-5"'), rf"camera {N}\.fov_video"),
    ("qualisys", text('skew="0.0', 'skew="2.0'), rf"camera {N}\.intrinsic\.skew"),
    ("qualisys", text(' x="', ' x="1.5e308" old="'), "t of .*"),
    ("theia", text("<transform", "<transformation"), rf"camera {N}\.transform\.x"),
    ("theia", text('sensorMaxU="1000"', 'sensorMaxU="1000.5"'), rf"camera {N}\.intrinsic\.sensorMaxU"),
    ("vicon", lambda path: path.write_text(path.read_text().replace("VueVIDEO", "Vue")), "TYPE"),
    ("vicon", text('ORIENTATION="', 'ORIENTATION="1 1 1 1" OLD="'), r".*\.ORIENTATION"),
    ("vicon", text(' 0 0 0"', ' -0.3 0.1 0"'), r".*\.VICON_RADIAL2"),
    ("vicon", text("VICON_RADIAL2", "VICON_RADIAL3"), r".*\.VICON_RADIAL2"),
    ("json", tree(lambda d: d["cameras"][0].update(K=None)), r"cameras\[0\]\.K"),
    ("json", tree(lambda d: d.update(version=2)), "version"),
    ("json", tree(lambda d: d.update(cameras=d["cameras"][0])), "cameras"),
    ("npz", arrays(names=None), "names"),
    ("npz", arrays(distortion=np.tile([0.1, np.nan, 0.1, 0.1, 0.1], (4, 1))), r"\[0\]\.distortion"),
    ("npz", arrays(distortion=None, distCoef=np.zeros((4, 5))), "distCoef"),
    ("npz", arrays(K=np.array([None] * 4, dtype=object)), "K"),
    ("npz", replaced(b"PK\x03\x04 no"), "file"),
]


@pytest.mark.parametrize(("name", "change", "field"), CASES, ids=[f"{case[0]}: {case[2]}" for case in CASES])
def test_a_malformed_file_is_named_with_its_field(tmp_path, name, change, field):
    write, options, *_ = {**FORMATS_WRITTEN, **files.OTHERS}.get(name, (files.vicon, {}))
    path = write(tmp_path, files.reference(NAMES))
    change(path)
    with pytest.raises(sk.DatasetError, match=f"{field}: expected") as caught:
        read_calibration(path, format=name, **options)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: lines[:2], "content: expected three lines of four numbers, got 2 with 8 numbers"),
        (lambda lines: [*lines[:2], "0 0 q 1"], "line 3: expected numbers, got 0 0 q 1"),
    ],
)
def test_a_broken_matrix_among_others_is_named(tmp_path, change, message):
    files.matrices(tmp_path, files.reference(NAMES), "txt")
    broken = tmp_path / f"{N}.txt"
    broken.write_text("\n".join(change(broken.read_text().splitlines())))
    with pytest.raises(sk.DatasetError, match=f"{broken}: {message}"):
        read_calibration(tmp_path, unit="m", size=(1000, 1000))


def test_every_format_has_malformed_twins():
    assert {name for name, *_ in CASES} == set(FORMATS)


# formats of which the first case spoils the first camera alone
OF_ONE_CAMERA = ["anipose", "caliscope", "voxelpose", "4d-association", "opencap", "easymocap", "openpose"]
OF_ONE_CAMERA += ["panoptic", "human36m", "qualisys", "theia", "colmap", "json"]


@pytest.mark.parametrize("name", OF_ONE_CAMERA)
def test_a_camera_that_cannot_be_read_may_be_left_out(tmp_path, name):
    write, options, names, *_ = FORMATS_WRITTEN[name]
    path = write(tmp_path, files.reference(NAMES))
    next(change for format, change, _ in CASES if format == name)(path)
    with pytest.raises(sk.DatasetError):
        read_calibration(path, **options, without=[names[1]])
    with pytest.warns(UserWarning, match=f"{names[0]}: cannot be read"):
        rig = read_calibration(path, **options, without=[names[0].upper()])
    assert rig.names == tuple(names[1:])
