"""TRC files: what is written, what other programs read and write, headers that contradict the rows."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from pose_sample import JOINTS, assert_equal, sample
from skelsplat.findings import FindingWarning
from skelsplat.io import PoseData, read_trc, write_trc


@pytest.fixture
def path(tmp_path):
    write_trc(tmp_path / "pose.trc", sample())
    return tmp_path / "pose.trc"


def test_the_lines(tmp_path):
    small = PoseData(
        np.array([[[1.0, 2.0, 3.0], [np.nan] * 3], [[-4.0, 5.5, 6.25], [7.0, 8.0, 9.0]]]),
        ("nose", "head"),
        np.array([7, 9]),
        "mm",
    )
    write_trc(tmp_path / "pose.trc", small, frame_rate=60.0, unit="mm")
    assert (tmp_path / "pose.trc").read_text().split("\n") == [
        "PathFileType\t4\t(X/Y/Z)\tpose.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "60\t60\t2\t2\tmm\t60\t1\t2",
        "Frame#\tTime\tnose\t\t\thead\t\t\t",
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\t",
        "",
        "1\t0.000000\t1.000\t2.000\t3.000\t\t\t\t",
        "3\t0.033333\t-4.000\t5.500\t6.250\t7.000\t8.000\t9.000\t",
        "",
    ]


@pytest.mark.parametrize(("unit", "factor", "digit"), [("mm", 1.0, 1e-3), ("m", 1e-3, 1e-6)])
def test_written_and_read(tmp_path, unit, factor, digit):
    write_trc(tmp_path / "pose.trc", sample(), unit=unit)
    back = read_trc(tmp_path / "pose.trc")
    assert (back.unit, back.joint_names, back.frame_rate) == (unit, JOINTS, 59.94)
    np.testing.assert_allclose(back.pose, sample().pose * factor, rtol=1e-15, atol=0.5001 * digit)
    write_trc(tmp_path / "pose.trc", sample(), unit=unit, y_up=True)
    turned = read_trc(tmp_path / "pose.trc").pose[..., [2, 0, 1]]
    np.testing.assert_array_equal(turned, back.pose)


@pytest.mark.parametrize("change", ["no blank line", "nan", "no tab at the end", "windows"])
def test_files_of_other_writers(path, change):
    expected = read_trc(path)
    lines = path.read_text().split("\n")
    if change == "no blank line":
        del lines[5]
    elif change == "nan":
        lines[7] = lines[7].replace("\t\t\t\t", "\tnan\tnan\tnan\t")
    elif change == "no tab at the end":
        lines[3:10] = [line.removesuffix("\t") for line in lines[3:10]]
    path.write_bytes(("\r\n" if change == "windows" else "\n").join(lines).encode())
    assert_equal(read_trc(path), expected)


@pytest.mark.parametrize("stated", ["2", "5.0", "0"])
def test_a_header_that_miscounts_the_frames(path, stated):
    expected = read_trc(path)
    path.write_text(path.read_text().replace("\t4\t3\tm", f"\t{stated}\t3\tm"))
    with pytest.warns(FindingWarning) as told:
        assert_equal(read_trc(path), expected)
    (finding,) = (one.message.finding for one in told)
    assert finding.kind == "header_contradicts"
    assert finding.numbers == {"stated": float(stated), "rows": 4}


def test_a_header_without_a_frame_rate(path):
    path.write_text(path.read_text().replace("59.94", "nan"))
    assert read_trc(path).frame_rate is None


MALFORMED = {
    "not a trc": (lambda _: ["hello"], "header"),
    "inches": (lambda lines: [line.replace("\tm\t", "\tinch\t") for line in lines], "line 3 Units"),
    "no frame rate": (lambda lines: [line.replace("59.94", "x", 1) for line in lines], "line 3 DataRate"),
    "a row cut short": (lambda lines: [*lines[:6], lines[6][:30]], "line 7"),
    "text": (lambda lines: [*lines[:6], lines[6].replace("1\t0.0", "one\t0.0")], "line 7"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_a_malformed_file(path, case):
    change, place = MALFORMED[case]
    path.write_text("\n".join(change(path.read_text().split("\n"))))
    with pytest.raises(sk.DatasetError, match=rf"pose\.trc: {place}"):
        read_trc(path)
