"""Small cases of what fuzzing found (`tests/fuzz`)."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calibration_files
import skelsplat as sk
from array_forms import LAYOUT, PIXELS, POSES, RIG, SEEN
from command_line import assert_fails, invoke
from pose_sample import sample
from skelsplat import datasets, synthetic
from skelsplat.datasets._files import Value, camera_at_centre
from skelsplat.datasets.human36m._adafuse import _misfit, _world
from skelsplat.datasets.panoptic import _bodies
from skelsplat.datasets.shelf_campus import _actor
from skelsplat.datasets.synthetic import write_simulated
from skelsplat.evaluation import baselines
from skelsplat.io import read_calibration, read_pose, write_pose
from skelsplat.io._arrays import as_numbers as of_file
from skelsplat.io.calibration._xml import _is_plausible
from skelsplat.io.poses._xarray import to_xarray
from skelsplat.run import Job
from takes import hand_made


def test_detections_of_images_of_twice_the_size_do_not_make_a_recording_nan():
    found = sk.refine_sequence(2.0 * PIXELS, RIG, layout=LAYOUT, fps=50.0)
    assert np.isfinite(found.pose).all()
    assert (found.joint_status == "weak").all()
    assert np.isfinite(found.noise).all()


@pytest.mark.parametrize(
    "fps",
    [memoryview(np.array(50.0)), np.array("2000", "M8[s]"), np.zeros(0), [50.0, 50.0], "50", 10**400],
)
@pytest.mark.parametrize("name", ["refine_sequence", "Refiner", "Tracker", "track"])
def test_a_rate_that_is_no_number_is_named(name, fps):
    calls = {
        "refine_sequence": lambda: sk.refine_sequence(PIXELS, RIG, layout=LAYOUT, fps=fps),
        "Refiner": lambda: sk.Refiner(RIG, layout=LAYOUT, fps=fps),
        "Tracker": lambda: sk.Tracker(RIG, layout=LAYOUT, fps=fps),
        "track": lambda: sk.track(SEEN[:, :, None], RIG, layout=LAYOUT, fps=fps),
    }
    with pytest.raises(sk.InvalidInputError, match=r"^fps: expected a positive number, got .+$"):
        calls[name]()


@pytest.mark.parametrize("fps", [1e308, 1e7, 1e-4])
def test_the_rate_of_a_job_is_one_that_its_files_can_state(fps):
    with pytest.raises(sk.InvalidInputError, match=r"^fps: expected a number from 1e-3 to 1e6, got "):
        Job("Calib.toml", "pose", fps=fps)


@pytest.mark.parametrize("seed", [-1, 1.5, "x"])
def test_a_seed_that_is_none_is_named(seed):
    with pytest.raises(sk.InvalidInputError, match=r"^seed: expected a whole number of at least 0, or a gen"):
        synthetic.motion("walk", 3, seed=seed)


def test_simulated_poses_have_a_limit():
    with pytest.raises(sk.InvalidInputError, match=r"^poses: expected at most 10000000, got "):
        synthetic.simulate_set("human36m-like", poses=10**400)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"root": np.zeros((3, 3))}, r"root: expected shape \(2, 3\) or \(3,\), got \(3, 3\)"),
        ({"heading_deg": np.zeros(3)}, r"heading_deg: expected shape \(2,\) or \(\), got \(3,\)"),
        (
            {"angles": {"knee_flexion_l": np.zeros(3)}},
            r"angles\['knee_flexion_l'\]: expected shape \(2,\) or",
        ),
    ],
)
def test_angles_of_another_number_of_frames_are_named(given, text):
    with pytest.raises(sk.InvalidInputError, match="^" + text):
        synthetic.forward_kinematics(**{"angles": {}, "n_frames": 2, **given})


def test_a_layout_is_printed_in_one_form():
    assert_fails(
        invoke("layouts", "coco17", "--toml", "--json"), 2, "--toml: expected --toml or --json, got both"
    )


def test_no_frames_are_triangulated():
    assert baselines.dlt(SEEN[:0], RIG).shape == (0, 17, 3)


def test_what_files_hold_is_shortened_in_messages():
    said = str(sk.DatasetError("a.csv", "line 1", "frame", "x" * 5000))
    assert len(said) < 1100
    assert said.startswith("a.csv: line 1: expected frame, got xxx")


@pytest.mark.parametrize("confidence", [1e-29, 1e-31, 1e-150, 5e-324])
def test_tiny_confidences_do_not_make_a_pose_nan(confidence):
    seen = SEEN.copy()
    seen[..., 2] = confidence
    for found in (
        sk.refine(None, seen, RIG, layout=LAYOUT),
        sk.refine_sequence(seen, RIG, layout=LAYOUT, fps=50.0),
    ):
        there = found.joint_status != "unobserved"
        assert there.all() == (confidence > 1e-30)
        assert np.isfinite(found.pose[there]).all()


def test_a_calibrations_name_of_numbers_that_are_no_characters(tmp_path):
    np.savez(
        tmp_path / "a.npz",
        **{name: np.zeros(3) for name in "KRt"},
        names=np.array([0x110000], "<u4").view("<U1"),
    )
    with pytest.raises(sk.DatasetError, match=r"a\.npz: names: expected "):
        read_calibration(tmp_path / "a.npz")


@pytest.mark.parametrize("value", [np.inf, -1e31, 1e308])
def test_data_sets_have_numbers_that_can_be_computed_with(value):
    truth = hand_made().truth.copy()
    truth[0, 3, 1] = value
    with pytest.raises(
        sk.DatasetError, match=r"truth: expected numbers within ±1e\+30, NaN where missing, got "
    ):
        replace(hand_made(), truth=truth)


def test_actors_of_shelf_beyond_numbers_are_read_without_a_warning():
    cells = np.empty(1, object)
    cells[0] = np.full((14, 3), 1e306)
    with np.errstate(all="raise"):
        _, joints = _actor(Path("a.mat"), "actor3D{1}", cells, 14)
    assert np.isinf(joints).all()  # which the take refuses


def test_boxes_of_data_sets_beyond_numbers_name_the_file_of_the_truth():
    take = replace(hand_made(), files={"truth": Path("a.pkl")})
    boxes = np.full((len(take), len(take.rig), 4), np.inf)
    with pytest.raises(sk.DatasetError, match=r"^a\.pkl: boxes: expected numbers within "):
        replace(take, boxes=boxes)


def test_complex_numbers_of_data_sets_are_no_coordinates(tmp_path):
    with pytest.raises(sk.DatasetError, match="x: expected real numbers, got an array of complex128"):
        Value(tmp_path, "x", np.ones(3, complex)).array()


def test_occluders_over_a_body_without_joints():
    noise = synthetic.DetectionNoise(occluded_views=1)
    assert synthetic.draw_occluders(PIXELS[:, :, :0], noise=noise, seed=0) is not None


def test_covariances_of_the_start_are_not_as_good_as_singular():
    narrow = np.broadcast_to(np.diag([1e-320, 500.0, 600.0]), (17, 3, 3))
    with pytest.raises(sk.InvalidInputError, match=r"^init_sigma\[0\]: expected a symmetric pos"):
        sk.refine(POSES[0], PIXELS[0], RIG, init_sigma=narrow)
    for least in (1e-29, 1e-20, 1e-12):
        spread = np.broadcast_to(np.diag([least, 500.0, 600.0]), (17, 3, 3))
        assert np.isfinite(sk.refine(POSES[0], PIXELS[0], RIG, init_sigma=spread).pose).all()


def test_people_in_a_memory_view_are_an_array():
    people = np.stack([SEEN, SEEN[::-1]], axis=2)
    found = sk.track(memoryview(people), RIG, layout=LAYOUT, fps=50.0)
    expected = sk.track(people, RIG, layout=LAYOUT, fps=50.0)
    assert [one.id for one in found] == [one.id for one in expected]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.refinement.pose, other.refinement.pose)


def test_poses_of_adafuse_that_are_far_away_name_their_file():
    poses, pixels = np.full((1, len(RIG), 17, 3), 1e40), np.zeros((1, len(RIG), 17, 2))
    with pytest.raises(sk.DatasetError, match=r"^a\.pkl: points.*: expected values within ±1e30, got "):
        _world(Value(Path("a.pkl"), "S9/Walking", poses), pixels, RIG)


def test_pixels_of_adafuse_that_are_far_away_are_no_warning():
    poses, pixels = np.repeat(POSES[:1, None], len(RIG), axis=1), np.full((1, len(RIG), 17, 2), 1e306)
    with np.errstate(all="raise"):
        assert _misfit(poses, pixels, RIG) == np.inf


def test_error_bars_of_which_the_square_is_no_number_name_the_line(tmp_path):
    columns = "frame,joint,x,y,z,error_bar_x,error_bar_y,error_bar_z,unit"
    (tmp_path / "p.csv").write_text(f"{columns}\n0,a,1,2,3,1,1,1,mm\n0,b,1,2,3,1,1e200,1,mm\n")
    with pytest.raises(
        sk.DatasetError, match=r"line 3: expected standard deviations of at most 1e\+100, got "
    ):
        read_pose(tmp_path / "p.csv")


@pytest.mark.parametrize("name", ["loss", "reprojection_error", "view_weights", "uncertainty"])
def test_poses_with_infinite_numbers_name_the_file_and_the_array(tmp_path, name):
    write_pose(tmp_path / "pose.npz", sample())
    with np.load(tmp_path / "pose.npz") as arrays:
        held = dict(arrays)
    held[name].reshape(-1)[0] = -np.inf
    np.savez(tmp_path / "pose.npz", **held)
    with pytest.raises(sk.DatasetError, match=rf"pose\.npz: {name}: expected finite numbers"):
        read_pose(tmp_path / "pose.npz")


def test_numbers_of_nan_that_signal_are_missing(tmp_path):
    signals = np.array([0x7FA00000], np.uint32).view(np.float32)
    with np.errstate(all="raise"):
        assert np.isnan(of_file(tmp_path, "x", signals)).all()
        assert np.isnan(Value(tmp_path, "x", signals).array()).all()


def test_a_lens_that_leaves_the_numbers_is_not_plausible():
    with np.errstate(all="raise"):
        assert not _is_plausible((1000, 1000), np.array([500.0, 500.0]), np.array([1e305, -1e305]), 1.0)


def test_detections_of_several_people_beyond_numbers_name_their_file(tmp_path):
    write_simulated(tmp_path / "set", synthetic.simulate_people_set(2, 3, 1, frames=3))
    index = datasets.read("synthetic", tmp_path / "set")
    path = index.takes[0].files["detections"]
    with np.load(path) as arrays:
        held = dict(arrays)
    for values in held.values():
        if values.dtype.kind == "f" and values.ndim > 3:
            values[..., 1][np.isfinite(values[..., 1])] = np.inf
    np.savez(path, **held)
    with pytest.raises(sk.DatasetError, match=rf"{path.name}: .*expected numbers within"):
        datasets.read("synthetic", tmp_path / "set")


def test_frames_of_people_in_memory_views_are_arrays():
    people = np.stack([SEEN, SEEN[::-1]], axis=2)
    found = sk.track([memoryview(frame) for frame in people], RIG, layout=LAYOUT, fps=50.0)
    expected = sk.track(people, RIG, layout=LAYOUT, fps=50.0)
    assert [one.id for one in found] == [one.id for one in expected]
    np.testing.assert_array_equal(found[0].refinement.pose, expected[0].refinement.pose)
    for wrong in (memoryview(people), memoryview(np.array(1.0))):
        with pytest.raises(sk.InvalidInputError, match=r"^people: expected "):
            sk.Tracker(RIG, layout=LAYOUT, fps=50.0).step([wrong])


@pytest.mark.parametrize("value", [np.inf, np.nan, 0.5])
def test_owners_of_simulated_detections_are_whole_numbers(tmp_path, value):
    write_simulated(tmp_path / "set", synthetic.simulate_people_set(2, 3, 1, frames=3))
    path = datasets.read("synthetic", tmp_path / "set").takes[0].files["detections"]
    with np.load(path) as arrays:
        held = dict(arrays)
    held["owner"] = np.full(held["owner"].shape, value)
    np.savez(path, **held)
    with pytest.raises(sk.DatasetError, match=rf"{path.name}: owner: expected whole numbers, got others"):
        datasets.read("synthetic", tmp_path / "set")


def test_frames_of_netcdf_are_whole_numbers(tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    found = to_xarray(sample())
    found["frame"] = xarray.full_like(found["frame"], np.nan, dtype=float)
    found.to_netcdf(tmp_path / "pose.nc", engine="h5netcdf")
    with pytest.raises(
        sk.DatasetError, match=r"pose\.nc: variables: .*frames: expected whole numbers, got nan"
    ):
        read_pose(tmp_path / "pose.nc")


def test_people_who_are_a_list_of_masked_numbers_are_named():
    with pytest.raises(sk.InvalidInputError, match=r"^people: expected a list of views in every frame, got "):
        sk.track([np.ma.masked], RIG, layout=LAYOUT, fps=50.0)


@pytest.mark.parametrize(
    ("bodies", "text"),
    [
        ("true", "bodies: expected a list, got bool"),
        (f'[{{"id": [], "joints19": {[1] * 76}}}]', "id: expected a whole number"),
    ],
)
def test_bodies_of_panoptic_that_are_no_list_and_ids_that_are_no_number(tmp_path, bodies, text):
    path = tmp_path / "body3DScene_00000001.json"
    path.write_text(f'{{"bodies": {bodies}}}')
    with pytest.raises(sk.DatasetError, match=rf"{path.name}: .*{text}"):
        _bodies(path)


def test_bodies_of_panoptic_beyond_numbers_are_read_without_a_warning(tmp_path):
    path = tmp_path / "body3DScene_00000001.json"
    path.write_text(f'{{"bodies": [{{"id": 3, "joints19": {[1.5e308, 1, 1, 1] * 19}}}]}}')
    with np.errstate(all="raise"):
        assert np.isinf(_bodies(path)[3][:, 0]).all()  # which the take refuses


def test_a_camera_of_a_calibration_at_1e308_is_no_warning(tmp_path):
    path, rig = tmp_path / "Calib.qca.txt", calibration_files.reference(calibration_files.NAMES)
    calibration_files.qualisys(tmp_path, rig)
    path.write_text(re.sub(r' x="[^"]*"', ' x="1.5e308"', path.read_text()))
    refused = pytest.raises(
        sk.DatasetError, match=r"Calib\.qca\.txt: t of camera .*: expected values within "
    )
    with np.errstate(all="raise"), refused:
        read_calibration(path)


def test_a_camera_of_a_data_set_at_1e308():
    entry = {"R": np.eye(3).tolist(), "T": [1e308] * 3, "fx": 1, "fy": 1, "cx": 0, "cy": 0}
    with pytest.raises(sk.DatasetError, match=r"T: expected 3 numbers within ±1e\+30, got"):
        camera_at_centre(Value(Path("a.json"), "a", entry), size=(9, 9), name="a")
