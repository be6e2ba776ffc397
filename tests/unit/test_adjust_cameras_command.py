"""`skelsplat adjust-cameras` and `refine --adjust-cameras`: files in, corrected cameras and sentences out."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest

import calibration_files as files
import skelsplat as sk
from command_line import assert_fails, invoke, succeed
from rig_case import turned
from skelsplat import synthetic
from skelsplat.findings import Finding, Remedy
from skelsplat.io import convert_unit, read_calibration, write_calibration
from skelsplat.rig_check import ReadAs
from skelsplat.run import Job, run, run_people
from skelsplat.run.adjusted import findings_of
from skelsplat.run.cameras import adjust_cameras

LAYOUT = ["--layout", "h36m17"]
ORDER = "cam2,cam1,cam3,cam4"  # which corrects the recording `exchanged`
RIG = synthetic.human36m_like(distortion=True)


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """Write a walk of 30 frames, in which cam2 may be 4 frames late or cam1 and cam2 exchanged."""
    folder = tmp_path_factory.mktemp("room")
    found = synthetic.simulate_detections(
        synthetic.motion("walk", 40, seed=1), RIG, noise=synthetic.DetectionNoise.good(), seed=3
    )[..., :2]
    write_calibration(folder / "Calib.toml", RIG)
    write_calibration(folder / "old.toml", convert_unit(turned(RIG, 2, [1.0, 1.5, -1.0]), "m"))
    files.openpose_folders(folder / "pose", RIG, found[5:35])
    late = found[5:35].copy()
    late[:, 1] = found[1:31, 1]
    files.openpose_folders(folder / "late", RIG, late)
    files.openpose_folders(folder / "exchanged", RIG, found[5:35][:, [1, 0, 2, 3]])
    return folder


def test_the_turned_camera_is_corrected_and_the_others_are_as_they_were(room):
    given = read_calibration(room / "old.toml")
    found = adjust_cameras(room / "old.toml", room / "pose", layout="h36m17", without=["cam4"])
    assert found.adjusted == ("cam3",)
    assert (found.cameras.unit, found.cameras.names) == ("m", RIG.names)  # cam4 as well
    (finding,) = found.findings
    assert (finding.kind, finding.severity, finding.subject.cameras) == ("camera_adjusted", "note", ("cam3",))
    assert finding.numbers["degrees"] == pytest.approx(np.sqrt(1 + 1.5**2 + 1), abs=0.25)
    assert finding.numbers["after_px"] < 0.2 * finding.numbers["before_px"]
    for camera, before, true in zip(found.cameras, given, RIG, strict=True):
        if camera.name == "cam3":
            turn = np.asarray(camera.R) @ np.asarray(true.R).T
            assert np.degrees(np.arccos((np.trace(turn) - 1) / 2)) < 0.2  # a tenth
        else:
            np.testing.assert_array_equal(camera.R, before.R)
            np.testing.assert_array_equal(camera.t, before.t)


def test_the_command_writes_the_calibration_and_says_what_was_adjusted(room, tmp_path):
    out = tmp_path / "fixed.toml"
    command = ["adjust-cameras", room / "old.toml", room / "pose", "-o", out, *LAYOUT]
    result = succeed(*command)
    assert max(map(len, result.stdout.splitlines()[:-1])) <= 80  # the last has the path
    assert " cam3 adjusted " in " ".join(result.stdout.split())
    assert f"Wrote 4 cameras to {out}, lengths in m." in result.stdout
    assert out.read_text().startswith("# skelsplat adjust-cameras: cam3 of old.toml adjusted by pose\n")
    assert read_calibration(out).unit == "m"
    assert out.read_text().endswith('[metadata]\nadjusted = true\nunit = "m"\n')
    assert_fails(
        invoke(*command), 1, "fixed.toml: output: expected no file of this name (--force replaces it)"
    )
    again = succeed("adjust-cameras", out, room / "pose", "-o", tmp_path / "more.json", *LAYOUT)
    assert again.stdout.endswith("more.json was not written.\n")
    assert not (tmp_path / "more.json").exists()


def test_outputs_and_names_that_are_refused(room, tmp_path):
    command = ["adjust-cameras", room / "old.toml", room / "pose", *LAYOUT, "-o"]
    assert_fails(invoke(*command, tmp_path / "a.xml"), 2, "--output: expected a calibration to be written as")
    same = "another file than the input, got the same"
    assert_fails(invoke(*command, room / "old.toml", "--force"), 1, same)
    out = tmp_path / "a.toml"
    assert_fails(invoke(*command, out, "--move", "cam9"), 2, "--move: expected a camera, one of cam1")
    everyone = [word for name in RIG.names for word in ("--move", name)]
    assert_fails(invoke(*command, out, *everyone), 2, "--move: expected")
    assert not out.exists()


def test_named_cameras_focal_lengths_and_clocks(room, tmp_path):
    out = tmp_path / "fixed.json"
    options = ["-o", out, *LAYOUT, "--move", "CAM_3", "--focal", "--clock", "--person", "entry:0"]
    result = succeed("adjust-cameras", room / "old.toml", room / "pose", *options)
    assert max(map(len, result.stdout.splitlines()[:-1])) <= 80  # the last has the path
    assert json.loads(out.read_text())["note"].startswith("skelsplat adjust-cameras: cam3 of")
    document = json.loads(
        invoke("adjust-cameras", room / "old.toml", room / "pose", *options, "--force", "--json").stdout
    )
    assert document["output"] == str(out)
    (camera,) = [one for one in document["cameras"] if one["status"] == "adjusted"]
    assert camera["camera"] == "cam3"
    assert camera["focal"] == pytest.approx(1.0, abs=0.03)
    assert abs(camera["clock_frames"]) < 0.5


@pytest.mark.parametrize("given", [0, -1])
def test_a_late_camera_gets_a_clock(room, given):
    """The offset with which the detections were read counts."""
    found = adjust_cameras(room / "Calib.toml", room / "late", layout="h36m17", offsets={"cam2": given})
    (finding,) = found.findings
    assert (finding.kind, finding.severity, finding.remedy) == ("frame_offset", "note", ())
    assert finding.numbers["clock_frames"] == pytest.approx(4.0 + given, abs=0.2)
    assert found.adjusted == ()
    assert found.cameras.clocks == {"cam2": 4.0}


def test_clocks_are_written_and_the_commands_that_read_them_apply_them(room, tmp_path):
    """A clock may be in the calibration, given as an offset, or measured by the run."""
    out = tmp_path / "fixed.toml"
    result = invoke("adjust-cameras", room / "Calib.toml", room / "late", "-o", out, *LAYOUT)
    printed = " ".join(result.stdout.split())
    assert "cam2's frame numbers were 3.87 ± 0.13 too high, which was corrected." in printed
    assert "commands that read the file apply them" in printed
    assert read_calibration(out).clocks == {"cam2": 4.0}
    given = run(Job(room / "Calib.toml", room / "late", layout="h36m17", offsets={"cam2": -4}))
    read = run(Job(out, room / "late", layout="h36m17", output=tmp_path / "run"))
    (note,) = (finding for finding in read.findings if finding.kind == "clocks_applied")
    assert (note.numbers, note.remedy) == ({"cam2": 4}, ())
    measured = run(Job(room / "Calib.toml", room / "late", layout="h36m17", adjust_cameras=True))
    for other in (read, measured):
        np.testing.assert_array_equal(other.frames, given.frames)
        np.testing.assert_array_equal(other.detections, given.detections)
        assert other.report["input"]["offsets"] == {"cam2": -4}
    assert read_calibration(tmp_path / "run" / "cameras.json").clocks == {}  # its detections are in step
    without = run(Job(out, room / "late", layout="h36m17", offsets={"cam2": 0}))
    assert without.report["input"]["offsets"] == {"cam2": 0}
    assert "clocks_applied" not in {finding.kind for finding in without.findings}
    again = adjust_cameras(out, room / "pose", layout="h36m17")  # whose clock is another
    assert (again.changed, again.cameras.clocks) == (("cam2",), {})


def test_other_faults_come_first(room, tmp_path):
    out = tmp_path / "fixed.toml"
    result = invoke("adjust-cameras", room / "Calib.toml", room / "exchanged", "-o", out, *LAYOUT)
    assert_fails(result, 1, "exchanged: cameras: expected", f"--order {ORDER}")
    files.openpose_folders(tmp_path / "empty", RIG, np.full((5, 4, 17, 2), np.nan))
    result = invoke("adjust-cameras", room / "Calib.toml", tmp_path / "empty", "-o", out, *LAYOUT)
    assert_fails(result, 1, "empty: detections: expected")
    assert not out.exists()


def reported(**given):
    numbers = {"turn": np.zeros(3), "shift": np.zeros(3), "focal": 1.0, "clock": 0.0}
    sigmas = {f"{name}_sigma": np.nan for name in ("turn", "shift", "focal", "clock")}
    return sk.CameraAdjustment(**{**numbers, **sigmas, "before": 30.0, "after": 12.0, **given})


def found(*report):
    read_as = ReadAs(offsets={"cam2": 3})
    return list(findings_of(sk.RigAdjustment(RIG, report, 80, 20), 1.0, read_as))


TURN = {"turn": np.array([0.0, 1.3, 0.0]), "turn_sigma": 0.3}
SOUND = [reported(name=name, status="sound") for name in ("cam2", "cam4")]


def test_doubtful_cameras_are_named_with_what_helps():
    one = reported(name="cam1", status="doubtful", **TURN)
    shift = {"shift": np.array([30.0, 40.0, 0.0]), "shift_sigma": 12.0, "clock": 2.0}
    other = reported(name="cam3", status="doubtful", **shift)
    (doubt,) = found(one, SOUND[0], other)
    assert (doubt.kind, doubt.severity) == ("cameras_not_adjusted", "warning")
    assert doubt.remedy == (Remedy("move", "cam1"), Remedy("move", "cam3"))
    assert doubt.subject.cameras == ("cam1", "cam3")
    assert doubt.text.startswith(
        "cam1 (turned by 1.3 ± 0.3°) or cam3 (moved by 50 ± 12 mm and frame numbers off by +2.0) is wrong, "
    )
    assert Finding.from_dict(doubt.to_dict()) == doubt


def test_of_a_camera_that_is_wrong_besides_the_majority_is_named():
    """More than half have to stay; with both named, the others place them."""
    adjusted, besides = (
        reported(name=name, status=status, **TURN)
        for name, status in (("cam1", "adjusted"), ("cam3", "doubtful"))
    )
    assert found(adjusted, *SOUND, besides)[-1].remedy == (Remedy("move", ["cam1", "cam3"]),)
    late = reported(name="cam3", status="doubtful", clock=2.0)
    assert found(adjusted, *SOUND, late)[-1].remedy == ()  # of clocks, none has to stay
    assert found(adjusted, *SOUND, besides, reported(name="cam5", status="sound"))[-1].remedy == ()


def test_a_clock_that_may_be_off_is_for_the_recording():
    clock = {"clock": 1.9, "clock_sigma": 0.1, "status": "doubtful"}
    (doubt,) = found(reported(name="cam1", status="doubtful", **TURN), reported(name="cam2", **clock))
    assert doubt.remedy == (Remedy("move", "cam1"), Remedy("offset", "cam2=1"))
    (doubt,) = found(*(reported(name=name, **clock) for name in ("cam1", "cam2")))
    assert doubt.remedy == (Remedy("offset", "cam1=-2"), Remedy("offset", "cam2=1"))


def test_parts_of_a_frame_and_cameras_that_see_too_little():
    late = reported(name="cam2", status="adjusted", clock=-2.4, clock_sigma=0.05)
    unseen = reported(name="cam4", status="unseen", before=np.nan, after=np.nan)
    clock, about = found(late, unseen, reported(name="cam1", status="sound"))
    assert (clock.kind, clock.remedy) == ("frame_offset", (Remedy("offset", "cam2=5.4"),))
    assert (about.kind, about.subject.cameras) == ("camera_unused", ("cam4",))
    (two,) = found(reported(name="cam1", status="unseen"), unseen)
    assert two.kind == "cameras_not_adjusted"
    assert two.remedy == tuple(Remedy("move", name) for name in RIG.names)
    (little,) = found(reported(name="cam1", status="adjusted", clock=0.3, clock_sigma=0.05))
    assert little.remedy == (Remedy("offset", "cam1=-0.3"),)
    assert found(reported(name="cam1", status="adjusted", clock=0.1, clock_sigma=0.05)) == []


def test_check_cameras_ends_with_the_command_that_corrects_them(room, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["check-cameras", room / "old.toml", room / "pose", *LAYOUT]
    command += ["--offset", "cam1=0", "--without", "cam4"]
    result = invoke(*command)
    assert result.exit_code == 1
    *_, first, refined, introduction, line = result.stdout.splitlines()
    assert first == "To refine with all of this corrected:"
    wanted = shlex.join(["skelsplat", "refine", *map(str, command[1:])])
    assert refined == f"  {wanted} --adjust-cameras -o out"
    assert introduction == "To measure this, and correct what is sure in a new calibration file:"
    assert "Try skelsplat refine --adjust-cameras." in result.stdout
    words = shlex.split(line)
    assert words[:2] == ["skelsplat", "adjust-cameras"]
    assert words[-6:] == ["--offset", "cam1=0", "--without", "cam4", "-o", "fixed.toml"]
    document = json.loads(invoke(*command, "--json").stdout)
    assert (document["refine"], document["adjust"]) == (refined.strip(), line.strip())
    assert {"setting": "adjust_cameras", "value": True} in document["findings"][0]["remedy"]
    assert invoke(*words[1:]).exit_code == 0
    checked = succeed("check-cameras", "fixed.toml", room / "pose", *LAYOUT, "--json")
    assert json.loads(checked.stdout)["adjust"] is None


def test_refine_adjusts_first_and_writes_the_cameras(room, tmp_path):
    def job(detections="pose", **given):
        return Job(room / "old.toml", room / detections, layout="h36m17", html=False, **given)

    before = run(job())
    after = run(job(adjust_cameras=True, output=tmp_path / "out"))
    assert after.statistics.total["before_px"] < 0.3 * before.statistics.total["before_px"]
    (finding,) = [one for one in after.findings if one.kind == "camera_adjusted"]
    assert finding.severity == "note"
    assert finding.to_dict() in after.report["findings"]
    assert after.report["input"]["adjust_cameras"]
    assert not before.report["input"]["adjust_cameras"]
    written = read_calibration(tmp_path / "out" / "cameras.json")
    np.testing.assert_array_equal(written["cam3"].R, after.cameras["cam3"].R)
    assert not np.allclose(written["cam3"].R, before.cameras["cam3"].R, atol=1e-3)
    np.testing.assert_array_equal(written["cam1"].R, before.cameras["cam1"].R)


def test_refine_of_everybody_adjusts_once_for_all(room):
    given = {"layout": "h36m17", "fps": 50, "people": "all", "adjust_cameras": True}
    everybody = run_people(Job(room / "old.toml", room / "pose", **given))
    assert "camera_adjusted" in {one.kind for one in everybody.findings}
    (person,) = everybody.people.values()
    assert not np.allclose(person.cameras["cam3"].R, read_calibration(room / "old.toml")["cam3"].R, atol=1e-3)


def test_refine_leaves_cameras_that_another_fault_explains(room):
    found = run(Job(room / "Calib.toml", room / "exchanged", layout="h36m17", adjust_cameras=True))
    (finding,) = [one for one in found.findings if one.kind == "cameras_not_adjusted"]
    assert finding.severity == "warning"
    assert finding.numbers["fault"] == "cameras_exchanged"
    assert finding.remedy == (Remedy("order", ORDER),)
    np.testing.assert_array_equal(found.cameras["cam1"].R, read_calibration(room / "Calib.toml")["cam1"].R)
