"""`skelsplat convert` of calibrations and `skelsplat check-cameras`: output, exit status, one-line errors."""

from __future__ import annotations

import json
import re
import shlex
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

import calibration_files as files
import skelsplat as sk
from detection_cases import CASES
from detection_files import Take
from skelsplat import synthetic
from skelsplat.cli import app
from skelsplat.io import read_calibration, sample, write_calibration

NAMES = ["54138969", "55011271", "58860488", "60457274"]


def invoke(*args):
    return CliRunner().invoke(app, [str(arg) for arg in args], env={"COLUMNS": "80"})


def assert_fails(result, status, *parts):
    """One line on stderr that starts with ``error:`` and holds ``parts``; nothing on stdout."""
    assert result.exit_code == status, result.output
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ")
    for part in parts:
        assert part in line


@pytest.fixture
def views():
    return files.reference(NAMES)


@pytest.mark.parametrize("suffix", [".toml", ".json", ".npz"])
@pytest.mark.parametrize(
    ("write", "options"),
    [
        (files.anipose, ["--unit", "m"]),
        (files.easymocap, ["--unit", "m"]),
        (files.panoptic, ["--camera-type", "hd"]),
        (files.human36m, ["--subject", "S9"]),
        (files.openpose, ["--size", "1000x1002"]),
        (files.qualisys, []),
    ],
)
def test_convert_keeps_the_cameras(tmp_path, views, write, options, suffix):
    folder = tmp_path / "in"
    folder.mkdir()
    target = tmp_path / f"out{suffix}"
    result = invoke("convert", write(folder, views), target, "--to-unit", "mm", *options)
    assert result.exit_code == 0, result.output
    assert "Wrote 4 cameras (54138969, 55011271, 58860488, 60457274) to " in " ".join(result.stdout.split())
    assert result.stdout.strip().endswith("lengths in mm.")
    rig = read_calibration(target)
    assert rig.unit == "mm"
    np.testing.assert_allclose(sk.project(files.points(), rig), files.projected(views), atol=5e-3)


def test_convert_prints_notes_on_stderr_and_quietly_nothing(tmp_path, views):
    source = files.qualisys(tmp_path, views)
    source.write_text(source.read_text().replace('viewrotation="0"><fov', 'viewrotation="90"><fov'))
    assert invoke("convert", source, tmp_path / "b.toml").stderr.startswith(f"note: {source}: viewrotation")
    result = invoke("convert", source, tmp_path / "a.toml", "-q")
    assert (result.exit_code, result.output) == (0, "")
    assert read_calibration(tmp_path / "a.toml").unit == "mm"


def test_notes_on_the_calibration_of_a_folder_are_said_and_are_no_faults(tmp_path):
    path = files.anipose(tmp_path, files.reference(files.NAMES))
    path.write_text(path.read_text().replace("fisheye", "offset = [10, 20]\nfisheye", 1))
    result = invoke("check-cameras", tmp_path, "--unit", "m")
    assert result.exit_code == 0
    assert "videos of 54138969 are cropped" in " ".join(result.stdout.split())
    assert "No fault found in the file itself" in result.stdout
    assert "!" not in result.stdout
    assert invoke("check-cameras", tmp_path, "--unit", "m", "--quiet").output == ""


def test_convert_refuses(tmp_path, views):
    toml = files.anipose(tmp_path, views)
    out = tmp_path / "out.json"
    assert_fails(invoke("convert", toml, out), 2, "--unit: expected", '"m" is likely', "convert --help")
    assert_fails(invoke("convert", toml, out, "--unit", "ft"), 2, "--unit: expected", "'ft'")
    assert_fails(
        invoke("convert", toml, out, "--unit", "m", "--to-unit", "ft"), 2, "--to-unit: expected", "'ft'"
    )
    assert_fails(
        invoke("convert", toml, out, "--unit", "m", "--size", "wide"), 2, "--size: expected", "'wide'"
    )
    assert_fails(
        invoke("convert", toml, out, "--unit", "m", "--subject", "S1"), 2, "--subject: expected none"
    )
    assert_fails(
        invoke("convert", toml, out, "--format", "toml"), 2, "--format: expected one of 4d-association"
    )
    assert_fails(
        invoke("convert", toml, tmp_path / "out.xcp"), 2, "OUTPUT: expected a calibration to be", ".xcp"
    )
    assert_fails(
        invoke("convert", files.human36m(tmp_path, views), out), 2, "--subject: expected one of S1, S9"
    )
    assert_fails(invoke("convert", tmp_path / "none.toml", out), 1, "none.toml: file: expected a readable")
    (tmp_path / "hello.txt").write_text("hello")
    assert_fails(
        invoke("convert", tmp_path / "hello.txt", out), 1, "content: expected a calibration in a known"
    )
    broken = tmp_path / "broken.json"
    broken.write_text(files.panoptic(tmp_path, views).read_text()[:300])
    assert_fails(invoke("convert", broken, out), 1, "broken.json: JSON: expected a complete JSON document")
    assert not out.exists()


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
    assert max(len(line) for line in result.stdout.splitlines()) <= 80
    assert [line.split()[0] for line in result.stdout.splitlines() if line.startswith(" cam")][1:] == [
        "cam1",
        "cam2",
        "cam3",
        "cam4",
    ]
    quiet = check(room, "pose", "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")


def test_faults_are_status_1_and_said_in_words(room):
    result = check(room, "exchanged")
    assert result.exit_code == 1
    assert "! The detections of cam1 and cam2 are exchanged" in result.stdout
    assert result.stderr == ""
    result = check(room, "late", "-q")
    assert result.exit_code == 1
    words = " ".join(result.stdout.split())
    assert "! cam3's frame numbers are 3 too high: its frame f+3 is frame f of the others" in words
    assert words.endswith(" Correct it in refine with: --offset cam3=-3")
    assert result.stdout.splitlines()[-1] == "  --offset cam3=-3"
    assert words.startswith("! cam3")  # no table, no legend


def options(document, kind):
    (finding,) = (finding for finding in document["findings"] if finding["kind"] == kind)
    return [part for option in finding["remedy"] for part in (f"--{option['option']}", option["value"])]


def refined_px(room, detections, out, *given):
    result = invoke(
        *("refine", room / "Calib.toml", room / detections, "-o", out, "--layout", "h36m17", "-q"),
        *("--no-html", "--fps", 50, *given),
    )
    assert result.exit_code == 0, result.output
    return float(np.nanmedian(sk.io.read_npz(out / "pose.npz").reprojection_error))


def test_the_order_that_is_printed_puts_exchanged_cameras_right(room, tmp_path):
    assert "  --order cam2,cam1,cam3,cam4" in check(room, "exchanged").stdout.splitlines()
    order = options(json.loads(check(room, "exchanged", "--json").stdout), "cameras_exchanged")
    assert check(room, "exchanged", *order).exit_code == 0
    right = refined_px(room, "pose", tmp_path / "pose")
    assert refined_px(room, "exchanged", tmp_path / "exchanged", *order) == pytest.approx(right, rel=1e-6)


def exchanged_as_files(room, folder, names):
    """Write the exchanged cameras as files of these names, and return the check of them."""
    everyone = sk.io.read_detections(room / "exchanged", ["cam1", "cam2", "cam3", "cam4"], layout="h36m17")
    for name, view in zip(names, everyone.people.swapaxes(0, 1), strict=True):
        np.savez(folder / f"{name}.npz", detections=view)
    return ["check-cameras", room / "Calib.toml", folder, "--layout", "h36m17"]


def test_options_stand_on_a_line_that_can_be_pasted_however_long_it_is(room, tmp_path):
    names = [f"the long walk of Monday $1 :smile: cam{i}" for i in (1, 2, 3, 4)]
    command = exchanged_as_files(room, tmp_path, names)
    said = invoke(*command).stdout.splitlines()
    (line,) = (line for line in said if "--order" in line)
    assert len(line) > 80
    order = shlex.split(line)
    assert order == ["--order", ",".join(f"{names[i]}.npz" for i in (1, 0, 2, 3))]
    assert options(json.loads(invoke(*command, "--json").stdout), "cameras_exchanged") == order
    assert invoke(*command, *order).exit_code == 0
    assert max(len(other) for other in said if other is not line) <= 80


def test_an_order_with_a_comma_in_a_name_cannot_be_said(room, tmp_path):
    command = exchanged_as_files(room, tmp_path, [f"walk, cam{i}" for i in (1, 2, 3, 4)])
    assert options(json.loads(invoke(*command, "--json").stdout), "cameras_exchanged") == []
    said = invoke(*command).stdout
    assert said.rstrip().endswith(" after the correction).")
    assert "--order" not in said


def test_offsets_that_were_given_follow_an_exchange(room):
    given = ["--offset", "cam_01=-2"]  # of the folder cam1, which is camera 2's
    order = options(json.loads(check(room, "moved", *given, "--json").stdout), "cameras_exchanged")
    assert order == ["--order", "cam2,cam1,cam3,cam4", "--offset", "cam1=0", "--offset", "cam2=-2"]
    assert check(room, "moved", *order).exit_code == 0
    document = json.loads(check(room, "both", "--offset", "cam3=2", "--json").stdout)
    assert options(document, "cameras_exchanged") == ["--order", "cam2,cam1,cam3,cam4"]
    assert options(document, "frame_offset") == ["--offset", "cam3=-3"]


def test_a_finding_says_what_is_put_right_before(room):
    result = check(room, "both", "-q")
    said = " ".join(result.stdout.split())
    assert re.search(r" px once cam1 and cam2 are corrected, \d+\.\d px after this correction", said)


def test_frames_that_differ_need_more_than_an_offset(room, tmp_path):
    assert options(json.loads(check(room, "late", "--json").stdout), "frame_offset") == [
        "--offset",
        "cam3=-3",
    ]
    given = options(json.loads(check(room, "short", "--json").stdout), "frame_offset")
    assert given == ["--offset", "cam3=-3", "--frames", "intersection"]
    refined_px(room, "short", tmp_path / "out", *given)
    refused = ("refine", room / "Calib.toml", room / "short", "-o", tmp_path / "x", "--layout", "h36m17")
    said = ["expected the same frames in every folder", "--frames intersection reads the frames that all"]
    assert_fails(invoke(*refused, *given[:2]), 1, *said, '(in Python frames="intersection", frames="union")')


def test_the_offset_of_the_table_is_the_one_to_give(room, tmp_path):
    table = check(room, "late").stdout
    (row,) = (line.split() for line in table.splitlines() if line.startswith(" cam3 "))
    assert row[2] == "-3:"
    given = check(room, "late", "--offset", "cam3=-3")
    assert given.exit_code == 0, given.output
    more = json.loads(check(room, "late", "--offset", "cam3=2", "--json").stdout)
    assert [row["offset_option"] for row in more["cameras"]] == [None, None, -3, None]
    errors = []
    for frames in (0, -3, 3):
        out = tmp_path / str(frames)
        refined = invoke(
            *("refine", room / "Calib.toml", room / "late", "-o", out, "--layout", "h36m17"),
            *("--offset", f"cam3={frames}", "--frames", "intersection", "-q"),
        )
        assert refined.exit_code == 0, refined.output
        error = sk.io.read_npz(out / "pose.npz").reprojection_error
        errors.append(float(np.nanmean(error)))
    without, negative, positive = errors
    assert negative < 0.7 * without < 0.7 * positive


def test_a_wrong_unit_is_said(room, tmp_path):
    text = (room / "Calib.toml").read_text().replace('unit = "mm"\n', "")
    (tmp_path / "Calib.toml").write_text(text)
    result = invoke(
        "check-cameras", tmp_path / "Calib.toml", room / "pose", "--layout", "h36m17", "--unit", "m"
    )
    assert result.exit_code == 1
    assert result.stdout.count("! ") == 1
    assert 'The unit of the calibration is most likely "mm".' in " ".join(result.stdout.split())
    alone = invoke("check-cameras", tmp_path / "Calib.toml", "--unit", "m")
    assert alone.exit_code == 1
    assert '"mm" is likely' in " ".join(alone.stdout.split())


def test_an_entry_of_the_files_need_not_be_one_person(room, tmp_path):
    rig = read_calibration(room / "Calib.toml")
    walk = synthetic.motion("walk", 20, seed=1)
    noise = synthetic.DetectionNoise.good()
    crowd = [synthetic.simulate_detections(walk + x, rig, noise=noise) for x in (0.0, 400.0)]
    joints = list(sk.layouts.H36M17.joints)
    CASES["openpose"].write(tmp_path, Take(np.stack(crowd, axis=2), list(rig.names), joints))
    given = ("check-cameras", room / "Calib.toml", tmp_path, "--layout", "h36m17")
    assert "entry 1 of each file" in " ".join(invoke(*given, "--person", "1").stdout.split())
    assert "of each file" not in invoke(*given).stdout


def test_json_has_the_numbers(room):
    result = check(room, "late", "--json")
    assert result.exit_code == 1
    report = json.loads(result.stdout)
    assert report["ok"] is False
    assert report["findings"][0]["numbers"]["frames"] == 3
    assert [row["best_offset"] for row in report["cameras"]] == [0, 0, 3, 0]
    assert [row["offset_option"] for row in report["cameras"]] == [None, None, -3, None]
    assert report["unit"] == "mm"


def test_a_calibration_alone(room):
    result = invoke("check-cameras", room / "Calib.toml")
    assert result.exit_code == 0
    words = " ".join(result.stdout.split())
    assert words.startswith("No fault found in the file itself: 4 cameras, mm. Whether it fits a recording")
    assert invoke("check-cameras", room / "Calib.toml", "-q").output == ""


@pytest.mark.parametrize(
    "given",
    [
        *(["--offset", "cam1=2"], ["--order", "sorted"], ["--layout", "h36m17"], ["--map", "nose=0"]),
        *(["--frames", "union"], ["--format", "npz"], ["--sequence", "one"], ["--person", "1"]),
    ],
)
def test_options_of_detections_need_some(room, tmp_path, given):
    said = f"{given[0]}: requires DETECTIONS"
    assert_fails(invoke("check-cameras", room / "Calib.toml", *given), 2, said)
    shared = tmp_path / "run.toml"  # may hold what other commands need
    shared.write_text('layout = "h36m17"\nframes = "union"\n[check-cameras.offset]\ncam1 = 2\n')
    assert invoke("check-cameras", room / "Calib.toml", "--config", shared).exit_code == 0
    assert_fails(invoke("check-cameras", room / "Calib.toml", "--config", shared, *given), 2, said)


def test_a_camera_may_be_left_out_of_a_calibration_alone(room):
    result = invoke("check-cameras", room / "Calib.toml", "--without", "cam1")
    assert (result.exit_code, "3 cameras, mm" in result.stdout) == (0, True)
    unknown = invoke("check-cameras", room / "Calib.toml", "--without", "nosuch")
    assert_fails(unknown, 2, "--without: expected a camera, one of cam1, cam2, cam3, cam4, got 'nosuch'")


def test_check_cameras_refuses(room, tmp_path):
    assert_fails(
        invoke("check-cameras", room / "Calib.toml", room / "pose"),
        2,
        "--layout: expected",
        "got none; ",
        "h36m17",
    )
    assert_fails(check(room, "pose", "--frames", "some"), 2, "--frames: expected one of strict", "'some'")
    assert_fails(check(room, "pose", "--unit", "m"), 2, '--unit: expected none or "mm"', "'m'")
    assert_fails(check(room, "nowhere"), 1, "nowhere: folder")
    assert_fails(invoke("check-cameras", tmp_path / "none.toml"), 1, "none.toml: file: expected a readable")
    assert_fails(invoke("check-cameras"), 2, "CALIBRATION")


@pytest.mark.sweep  # docs/howto/pose2sim.md does the same
def test_the_third_camera_of_the_sample_is_turned(tmp_path):
    paths = sample.extract(tmp_path)
    result = invoke(
        "check-cameras",
        paths.calibration,
        paths.detections,
        "--unit",
        "m",
        "--layout",
        sample.LAYOUT,
        "--json",
    )
    assert result.exit_code == 1
    (finding,) = json.loads(result.stdout)["findings"]
    assert (finding["kind"], finding["subject"]) == ("camera_rotated", {"cameras": ["cam_03"]})
    assert finding["numbers"]["degrees"] == pytest.approx(1.43, abs=0.1)


@pytest.mark.parametrize("frames", [2, 23])
def test_a_late_camera_shows_beside_the_turned_one_of_the_sample(tmp_path, frames):
    """Two frames late, its error is 19.3 px instead of 17.6: nothing beside the 34 px of cam_03.

    Of one that is 23 frames late, errors alone, which cam_03 spoils, make 22.
    """
    paths = sample.extract(tmp_path)
    options = ("--unit", "m", "--layout", sample.LAYOUT, "--offset", f"cam_04={frames}", "--json")
    options += ("--frames", "intersection")
    report = json.loads(invoke("check-cameras", paths.calibration, paths.detections, *options).stdout)
    late, turned = report["findings"]
    assert (late["kind"], late["subject"]) == ("camera_late", {"cameras": ["cam_04"]})
    numbers = late["numbers"]
    assert numbers["clock_frames"] == pytest.approx(frames, abs=2.0 * numbers["clock_sigma_frames"])
    assert (turned["kind"], turned["subject"]) == ("camera_rotated", {"cameras": ["cam_03"]})
    assert [row["offset_option"] for row in report["cameras"]] == [None, None, None, 0]
    assert [row["best_offset"] for row in report["cameras"]] == [0, 0, 0, frames]


@pytest.mark.parametrize("command", ["convert", "check-cameras"])
def test_help_has_examples_and_fits_80_columns(command):
    result = invoke(command, "--help")
    assert f"skelsplat {command} " in result.stdout.split("Examples")[1]
    assert max(len(line.rstrip()) for line in result.stdout.splitlines()) <= 80


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
    assert json.loads(invoke(*command, "--person", "0").stdout)["ok"] is True
    for other in ("1", "largest"):
        report = json.loads(invoke(*command, "--person", other).stdout)
        assert not report["ok"]
        assert min(row["left_out_px"] for row in report["cameras"]) > 20
    assert_fails(invoke(*command, "--person", "2"), 2, "--person: expected less than 2", "got 2")
    assert_fails(
        invoke(*command, "--person", "tall"),
        2,
        "--person: expected everybody, consistent, largest or a number",
    )
