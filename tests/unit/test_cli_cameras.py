"""`skelsplat convert` of calibrations, `skelsplat check-cameras`, and calibrations of all formats."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import calibration_files as files
import skelsplat as sk
from command_line import assert_fails, invoke, read_report, succeed
from skelsplat import synthetic
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.io import read_calibration, read_npz, write_calibration

NAMES = ["54138969", "55011271", "58860488", "60457274"]


@pytest.fixture
def views():
    return files.reference(NAMES)


@pytest.mark.parametrize(
    ("write", "options", "suffix"),
    [
        (files.anipose, ["--unit", "m"], ".toml"),
        (files.human36m, ["--subject", "S9"], ".toml"),
        (files.qualisys, [], ".npz"),
    ],
)
def test_convert_keeps_the_cameras(tmp_path, views, write, options, suffix):
    folder = tmp_path / "in"
    folder.mkdir()
    target = tmp_path / f"out{suffix}"
    result = succeed("convert", write(folder, views), target, "--to-unit", "mm", *options)
    assert "Wrote 4 cameras (54138969, 55011271, 58860488, 60457274) to " in " ".join(result.stdout.split())
    assert result.stdout.strip().endswith("lengths in mm.")
    rig = read_calibration(target)
    assert rig.unit == "mm"
    np.testing.assert_allclose(sk.project(files.points(), rig), files.projected(views), atol=5e-3)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Write a walk of 20 frames seen by four cameras, as a user has it, and two faults."""
    folder = tmp_path_factory.mktemp("room")
    rig = synthetic.human36m_like(distortion=True)
    noise = synthetic.DetectionNoise.good()
    found = synthetic.simulate_detections(synthetic.motion("walk", 30, seed=1), rig, noise=noise, seed=3)
    write_calibration(folder / "Calib.toml", rig)
    files.openpose_folders(folder / "pose", rig, found[5:25, ..., :2])
    exchanged = found[5:25, [1, 0, 2, 3], :, :2].copy()
    files.openpose_folders(folder / "exchanged", rig, exchanged)
    late = found[5:25, ..., :2].copy()
    late[:, 2] = found[2:22, 2, :, :2]
    files.openpose_folders(folder / "late", rig, late)
    files.openpose_folders(folder / "both", rig, late[:, [1, 0, 2, 3]])
    exchanged[:, 0] = found[3:23, 1, :, :2]
    files.openpose_folders(folder / "moved", rig, exchanged)
    files.openpose_folders(folder / "short", rig, late)
    for path in sorted((folder / "short" / "cam3").iterdir())[8:10]:  # not where the recordings begin
        path.unlink()
    return folder


@cache
def check(room, detections, *options):
    """Return what the check of a recording prints, which changes nothing."""
    return invoke("check-cameras", room / "Calib.toml", room / detections, "--layout", "h36m17", *options)


def test_a_sound_rig_is_status_0(room):
    result = check(room, "pose")
    assert result.exit_code == 0, result.output
    assert "No fault found: 4 cameras, mm, 20 frames of detections." in result.stdout
    quiet = check(room, "pose", "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")


def options(document, kind):
    (finding,) = (finding for finding in document["findings"] if finding["kind"] == kind)
    return [part for one in finding["remedy"] for part in (f"--{one['setting']}", one["value"])]


def refined_px(room, detections, out, *given):
    succeed(
        *("refine", room / "Calib.toml", room / detections, "-o", out, "--layout", "h36m17", "-q"),
        *("--no-html", "--fps", 50, *given),
    )
    return float(np.nanmedian(sk.io.read_npz(out / "pose.npz").reprojection_error))


def test_the_order_that_is_printed_puts_exchanged_cameras_right(room, tmp_path):
    lines = check(room, "exchanged").stdout.splitlines()
    assert "Try --order cam2,cam1,cam3,cam4." in "\n".join(lines)
    assert lines[-2] == "To refine with all of this corrected:"
    assert lines[-1].endswith(" --layout h36m17 --order cam2,cam1,cam3,cam4 -o out")
    order = options(json.loads(check(room, "exchanged", "--json").stdout), "cameras_exchanged")
    assert check(room, "exchanged", *order).exit_code == 0
    right = refined_px(room, "pose", tmp_path / "pose")
    assert refined_px(room, "exchanged", tmp_path / "exchanged", *order) == pytest.approx(right, rel=1e-6)


def test_offsets_that_were_given_follow_an_exchange(room):
    given = ["--offset", "cam_01=-2"]  # of the folder cam1, which is camera 2's
    order = options(json.loads(check(room, "moved", *given, "--json").stdout), "cameras_exchanged")
    assert order == ["--order", "cam2,cam1,cam3,cam4", "--offset", "cam1=0", "--offset", "cam2=-2"]
    assert check(room, "moved", *order).exit_code == 0
    document = json.loads(check(room, "both", "--offset", "cam3=2", "--json").stdout)
    assert options(document, "cameras_exchanged") == ["--order", "cam2,cam1,cam3,cam4"]
    assert options(document, "frame_offset") == ["--offset", "cam3=-3"]


def test_frames_that_differ_need_more_than_an_offset(room, tmp_path):
    assert options(json.loads(check(room, "late", "--json").stdout), "frame_offset") == [
        "--offset",
        "cam3=-3",
    ]
    given = options(json.loads(check(room, "short", "--json").stdout), "frame_offset")
    assert given == ["--offset", "cam3=-3", "--frames", "intersection"]
    refined_px(room, "short", tmp_path / "out", *given)
    refused = ("refine", room / "Calib.toml", room / "short", "-o", tmp_path / "x", "--layout", "h36m17")
    assert_fails(invoke(*refused, *given[:2]), 1, "frames", "--frames intersection")


def test_the_offset_of_the_table_is_the_one_to_give(room):
    table = check(room, "late").stdout
    (row,) = (line.split() for line in table.splitlines() if line.startswith(" cam3 "))
    assert row[2] == "-3:"
    given = check(room, "late", "--offset", "cam3=-3")
    assert given.exit_code == 0, given.output
    more = json.loads(check(room, "late", "--offset", "cam3=2", "--json").stdout)
    assert [row["offset_option"] for row in more["cameras"]] == [None, None, -3, None]


@pytest.mark.parametrize("given", [["--offset", "cam1=2"], ["--layout", "h36m17"], ["--person", "1"]])
def test_options_of_detections_need_some(room, tmp_path, given):
    said = f"{given[0]}: requires DETECTIONS"
    assert_fails(invoke("check-cameras", room / "Calib.toml", *given), 2, said)
    shared = tmp_path / "run.toml"  # may hold what other commands need
    shared.write_text('layout = "h36m17"\nframes = "union"\n[check-cameras.offset]\ncam1 = 2\n')
    assert invoke("check-cameras", room / "Calib.toml", "--config", shared).exit_code == 0
    assert_fails(invoke("check-cameras", room / "Calib.toml", "--config", shared, *given), 2, said)


def test_the_person_is_chosen_as_in_refine(room, tmp_path):
    """The largest person of each image, whom the cameras do not agree on, instead of the one they do."""
    everyone = sk.io.read_detections(room / "pose", ["cam1", "cam2", "cam3", "cam4"], layout="h36m17")
    mirror = everyone.people.copy()
    mirror[..., 0] = 999 - mirror[..., 0]
    mirror[..., :2] = 500 + 1.2 * (mirror[..., :2] - 500)
    for i in range(4):
        people = np.concatenate([everyone.people[:, i], mirror[:, i]], axis=1)
        np.savez(tmp_path / f"cam{i + 1}.npz", detections=people)
    command = ["check-cameras", room / "Calib.toml", tmp_path, "--layout", "h36m17", "--json"]
    assert json.loads(invoke(*command).stdout)["ok"] is True
    assert json.loads(invoke(*command, "--person", "entry:0").stdout)["ok"] is True
    for other in ("entry:1", "largest"):
        report = json.loads(invoke(*command, "--person", other).stdout)
        assert not report["ok"]
        assert min(row["left_out_px"] for row in report["cameras"]) > 20
    assert_fails(invoke(*command, "--person", "entry:2"), 2, "--person: expected less than 2")
    for other in ("tall", "0"):  # a number is somebody who is followed over time, as in refine
        assert_fails(invoke(*command, "--person", other), 2, "--person: expected", "such as entry:0")


def test_what_is_refused(room, views, tmp_path):
    toml, out = files.anipose(tmp_path, views), tmp_path / "out.json"
    for status, field, *words in (
        (2, "--unit: expected", "convert", toml, out),
        (2, "--to-unit: expected", "convert", toml, out, "--unit", "m", "--to-unit", "ft"),
        (2, "--size: expected", "convert", toml, out, "--unit", "m", "--size", "wide"),
        (2, "--subject: expected none", "convert", toml, out, "--unit", "m", "--subject", "S1"),
        (2, "OUTPUT: expected", "convert", toml, tmp_path / "out.xcp"),
        (1, "none.toml: file: expected", "convert", tmp_path / "none.toml", out),
        (2, "--layout: expected", "check-cameras", room / "Calib.toml", room / "pose"),
        (2, "--without: expected", "check-cameras", room / "Calib.toml", "--without", "nosuch"),
    ):
        assert_fails(invoke(*words), status, field)
    assert_fails(check(room, "pose", "--frames", "some"), 2, "--frames: expected")
    assert_fails(check(room, "nowhere"), 1, "nowhere: folder")
    assert not out.exists()


LAYOUT = ["--layout", "h36m17"]
# How the file is written, what has to be said of it, its unit, and what the report calls it.
CALIBRATIONS = [
    (files.easymocap, ["--unit", "m", "--calibration-format", "easymocap"], "m", "easymocap"),
    (files.openpose, ["--size", "1000x1002"], "m", "openpose"),
    (files.panoptic, ["--camera-type", "hd"], "cm", "panoptic"),
    (files.human36m, ["--subject", "S9"], "mm", "human36m"),
    (files.qualisys, ["--binning", "1"], "mm", "qualisys"),
]


@pytest.fixture
def without_lenses():
    """Four cameras without distortion; their images have one size, which OpenPose has to be told."""
    return [replace(view, size=(1000, 1002)) for view in files.reference(files.NAMES, distortion=False)]


@pytest.mark.parametrize(("write", "options", "unit", "name"), CALIBRATIONS)
def test_refine_reads_every_format_and_says_which(tmp_path, without_lenses, write, options, unit, name):
    pose = synthetic.motion("walk", 3, seed=3)
    cameras = [sk.Camera(v.K, v.R, v.t, size=v.size, name=v.name) for v in without_lenses]
    np.savez(tmp_path / "detections.npz", detections=sk.project(pose, cameras).swapaxes(0, 1))
    (tmp_path / "rig").mkdir()
    given = [write(tmp_path / "rig", without_lenses), tmp_path / "detections.npz", *LAYOUT, *options]
    succeed("refine", *given, "--order", "sorted", "-q", "--fps", 50, "-o", tmp_path / "out")
    said = read_report(tmp_path / "out")["input"]
    assert (said["unit"], said["calibration_format"]) == (unit, name)
    poses = read_npz(tmp_path / "out" / "pose.npz")
    assert poses.unit == unit
    # the files hold six digits: at 4 m a hundredth of a pixel is 0.04 mm; symmetry pulls by less than that
    np.testing.assert_allclose(poses.pose * MM_PER_UNIT[unit], pose, atol=1.0)


@pytest.mark.parametrize("command", ["refine", "check-cameras"])
@pytest.mark.parametrize(
    ("write", "options", "option"),
    [
        (files.anipose, [], "--unit"),
        (files.qualisys, ["--unit", "m"], "--unit"),
        (files.human36m, [], "--subject"),
        (files.openpose, ["--size", "wide"], "--size"),
        (files.anipose, ["--calibration-format", "toml"], "--calibration-format"),
    ],
)
def test_what_is_missing_or_wrong_is_status_2_and_names_the_option(
    tmp_path, without_lenses, command, write, options, option
):
    layout = [] if command == "check-cameras" else LAYOUT  # which needs none without detections
    rest = [tmp_path / "none", "-o", tmp_path / "out"] if command == "refine" else []
    (tmp_path / "rig").mkdir()
    result = invoke(command, write(tmp_path / "rig", without_lenses), *rest, *layout, *options)
    assert_fails(result, 2, f"error: {option}: ", f"{command} --help")
