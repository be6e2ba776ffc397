"""Reading detections: every format to the same arrays."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from broken_detections import NAMES, anybody, write_case
from detection_cases import CASES
from detection_files import Take, hourglass, slp_file
from skelsplat.findings import collected_warnings
from skelsplat.io import read_detections

T = 4
CAMERAS = ("cam1", "cam2", "cam3", "cam4")
LABELS = {  # of the views in a file of all cameras, if they are not their places
    "videopose3d": ["54138969", "55011271", "58860488", "60457274"],
    "caliscope": ["1", "2", "3", "4"],
    "caliscope_ports": ["1", "2", "3", "4"],
}


@pytest.fixture
def people():
    """Two people (T, M, 2, K, 3), the second in two views only; a joint of the first is missing once."""
    rng = np.random.default_rng(1)
    found = rng.uniform(100.0, 900.0, (T, 4, 2, 17, 3))
    found[..., 2] = rng.uniform(0.4, 1.0, found.shape[:-1])
    found[:, 2:, 1] = found[1, 3, 0, 5] = np.nan
    return found


def written(name, root, people, first=5):
    """Write a case; return the path and what is to be read (T, M, P, K, 3)."""
    case = CASES[name]
    kept = people if case.people else people[:, :, :1]
    layout = sk.layouts.get(case.layout)
    path = case.write(root, Take(kept, list(CAMERAS), list(layout.joints), first))
    expected = kept.astype(case.precision).astype(np.float64)
    if not case.confidence:
        expected[..., 2] = np.where(np.isfinite(expected[..., 0]), 1.0, np.nan)
    return path, expected


def read(name, path, cameras=CAMERAS, **options):
    case = CASES[name]
    return read_detections(path, cameras, **{"layout": case.layout, "order": case.order, **options})


@pytest.mark.parametrize("name", CASES)
def test_every_format_is_found_and_read_to_the_same_arrays(tmp_path, people, name):
    case = CASES[name]
    path, expected = written(name, tmp_path, people)
    found = read(name, path)
    np.testing.assert_array_equal(found.people, expected)
    np.testing.assert_array_equal(found.frames, np.arange(T) + (5 if case.frames else 0))
    assert (found.format, found.layout, found.camera_names) == (case.format, case.layout, CAMERAS)
    assert all(source.is_relative_to(tmp_path) for source in found.sources)
    np.testing.assert_array_equal(read(name, path, format=case.format).people, expected)


@pytest.mark.parametrize("name", CASES)
def test_views_follow_the_cameras(tmp_path, people, name):
    path, expected = written(name, tmp_path, people)
    labels = LABELS.get(name, ["0", "1", "2", "3"])
    order = None if CASES[name].order is None else labels[::-1]
    np.testing.assert_array_equal(read(name, path, CAMERAS[::-1], order=order).people, expected[:, ::-1])


@pytest.mark.parametrize("name", ["openpose", "deeplabcut_csv", "npz", "csv"])
def test_offsets_shift_a_camera_in_time(tmp_path, people, name):
    path, expected = written(name, tmp_path, people)
    found = read(name, path, offsets={"cam2": 2, "cam4": np.int64(-1)}, frames="intersection")
    np.testing.assert_array_equal(found.frames, [7])
    for m, at in enumerate((2, 0, 2, 3)):
        np.testing.assert_array_equal(found.people[0, m], expected[at, m])


def test_offsets_are_for_cameras_and_numbers(tmp_path, people):
    path, expected = written("openpose", tmp_path, people)
    strict = read("openpose", path, offsets={"cam1": 1})
    np.testing.assert_array_equal(strict.frames, [6, 7, 8])
    np.testing.assert_array_equal(strict.people[:, 0], expected[:3, 0])
    np.testing.assert_array_equal(strict.people[:, 1], expected[1:, 1])
    union = read("openpose", path, offsets={"cam1": 1}, frames="union")
    np.testing.assert_array_equal(union.frames, [5, 6, 7, 8, 9])
    assert np.isnan(union.people[0, 0]).all()
    with pytest.raises(sk.InvalidInputError, match="offsets"):
        read("openpose", path, offsets={"cam9": 1})
    with pytest.raises(sk.InvalidInputError, match=r"offsets\[\w+\]"):
        read("openpose", path, offsets={"cam1": "3"})
    with pytest.raises(sk.DatasetError, match="frames"):
        read("openpose", path, offsets={"cam1": 10})


@pytest.mark.parametrize("name", ["coco", "csv", "sleap_csv"])
def test_a_frame_without_people_is_not_listed_and_not_an_error(tmp_path, people, name):
    people[2, 1] = np.nan
    path, expected = written(name, tmp_path, people)
    np.testing.assert_array_equal(read(name, path).people, expected)


@pytest.mark.parametrize("name", ["rtmlib_frames", "mmpose", "coco", "sleap"])
def test_scores_that_are_no_probabilities_are_clipped(tmp_path, people, name):
    people[0, 2, 0, 3, 2], people[0, 2, 0, 4, 2] = 1.7, -0.2
    found = read(name, written(name, tmp_path, people)[0]).people
    np.testing.assert_array_equal(found[0, 2, 0, 3], [*people[0, 2, 0, 3, :2], 1.0])
    assert np.isnan(found[0, 2, 0, 4]).all()


@pytest.mark.parametrize("name", ["openpose", "npz_cameras", "csv"])
def test_parts_of_the_image_for_pixels(tmp_path, people, name):
    path, _ = written(name, tmp_path, people / [1000.0, 1000.0, 1.0])
    with pytest.raises(sk.DatasetError, match="keypoints: expected pixels"):
        read(name, path)


def test_deeplabcut_writes_minus_one_for_an_individual_that_it_does_not_find(tmp_path):
    people = anybody()
    people[1, 0, 1] = -1.0
    path = write_case(tmp_path, "deeplabcut_csv_multi", people=people)
    found = read_detections(path, NAMES, layout="h36m17").people
    assert np.isnan(found[1, 0, 1]).all()
    np.testing.assert_array_equal(found[1, 0, 0], people[1, 0, 0])


def test_zeros_with_a_confidence_are_missing_if_there_are_several(tmp_path):
    people = anybody()
    people[0, 0, 0, 3, :2] = people[2, 0, 1, 5, :2] = people[1, 1, 0, 7, :2] = 0.0  # two in camA, one in camB
    path = write_case(tmp_path, "openpose", people=people)
    found = read_detections(path, NAMES, layout="h36m17").people
    people[0, 0, 0, 3] = people[2, 0, 1, 5] = np.nan
    np.testing.assert_array_equal(found, people)


def test_a_wide_csv_of_mediapipe_has_parts_of_the_image_and_places(tmp_path):
    rng = np.random.default_rng(2)
    K = np.diag([900.0, 900.0, 1.0])
    rig = sk.CameraRig(
        [sk.Camera(K=K, R=np.eye(3), t=[i, 0, 5], size=(1920, 1080), name=f"cam{i}") for i in (1, 2)]
    )
    values = rng.uniform(0.1, 0.9, (3, 2, 33, 4))
    header = ",".join(f"L{k}_{part}" for k in range(33) for part in ("x", "y", "z", "visibility"))
    for m, name in enumerate(rig.names):
        np.savetxt(
            tmp_path / f"{name}.csv", values[:, m].reshape(3, -1), "%.17g", ",", header=header, comments=""
        )
    found = read_detections(tmp_path, rig)
    assert (found.format, found.layout) == ("wide_csv", "mediapipe33")
    np.testing.assert_array_equal(found.people[:, :, 0], values[..., [0, 1, 3]] * [1920, 1080, 1])
    with pytest.raises(sk.DatasetError, match="keypoints: expected pixels"):
        read_detections(tmp_path, rig.names)


def test_joints_of_a_wide_csv_without_the_confidence_that_others_have_are_named(tmp_path):
    joints = sk.layouts.get("h36m17").joints
    parts = [f"{joint}_{part}" for joint in joints for part in ("x", "y", "likelihood")]
    parts.remove(f"{joints[3]}_likelihood")
    line = ",".join("0.5" if part.endswith("likelihood") else "700" for part in parts)
    for name in NAMES:
        (tmp_path / f"{name}.csv").write_text(f"{','.join(parts)}\n{line}\n")
    with collected_warnings() as told:
        found = read_detections(tmp_path, NAMES, layout="h36m17")
    assert {(one.kind, one.subject.joints) for one in told} == {("confidence_lacking", joints[3:4])}
    np.testing.assert_array_equal(found.people[0, 0, 0, 2:5, 2], [0.5, 1.0, 0.5])


@pytest.mark.parametrize(("first", "kinds"), [("Timestamp", ["times_unused"]), ("frame,time", [])])
def test_times_of_a_wide_csv_are_said_to_number_no_frames(tmp_path, first, kinds):
    values = ",".join("7" for _ in first.split(","))
    (tmp_path / "cam1.csv").write_text(f"{first},a_x,a_y\n{values},400,300\n")
    layout = sk.layouts.from_names("one", ["a"], [])
    with collected_warnings() as told:
        found = read_detections(tmp_path, ["cam1"], layout=layout)
    assert [one.kind for one in told] == kinds
    assert found.frames.tolist() == ([0] if kinds else [7])


def test_a_wide_csv_of_pixels_with_many_zeros_is_none_of_parts(tmp_path):
    (tmp_path / "cam1.csv").write_text("a_x,a_y,b_x,b_y\n" + "0,0,0,0\n" * 30 + "400,300,0,0\n")
    camera = sk.Camera(K=np.diag([9e2, 9e2, 1]), R=np.eye(3), t=[0, 0, 5], size=(1920, 1080), name="cam1")
    layout = sk.layouts.from_names("two", ["a", "b"], [(0, 1)])
    found = read_detections(tmp_path, [camera], layout=layout).people
    np.testing.assert_array_equal(found[30, 0, 0, 0], [400, 300, 1])


@pytest.mark.parametrize("of_anipose", ["", ",nose_error,nose_ncams,nose_score"])
def test_a_csv_of_points_in_3d_is_no_detections(tmp_path, of_anipose):
    values = ",0.1,2,0.9" if of_anipose else ""
    (tmp_path / "cam1.csv").write_text(f"frame,nose_x,nose_y,nose_z{of_anipose}\n0,1,2,3{values}\n")
    with pytest.raises(sk.DatasetError, match="content"):
        read_detections(tmp_path, ["cam1"])


@pytest.mark.filterwarnings("ignore:The layout is that")
@pytest.mark.parametrize("track", [-1, 3])
def test_a_users_instance_in_sleaps_project_replaces_its_prediction(tmp_path, track):
    people = anybody()[:, :, :1]
    people[1, 0, 0, 4] = np.nan
    joints = [f"node{k}" for k in range(17)]
    take = Take(people, NAMES, joints)
    slp_file(tmp_path / "labels.slp", take, [0, 1], users=[0], track=track)
    found = read_detections(tmp_path / "labels.slp", NAMES, layout="file")
    assert found.skeleton.joints == tuple(joints[::-1])
    assert found.skeleton.limbs == ((14, 16), (16, 15))
    people[..., 2] = np.where(np.isfinite(people[..., 0]), 1.0, np.nan)
    np.testing.assert_array_equal(found.people, people[..., ::-1, :])


@pytest.mark.filterwarnings("ignore:The layout is that")
def test_sleaps_pixels_were_corners_before_version_1_1(tmp_path):
    people = anybody()[:, :, :1]
    slp_file(
        tmp_path / "labels.slp", Take(people, NAMES, [f"n{k}" for k in range(17)]), [0, 1], format_id=1.0
    )
    found = read_detections(tmp_path / "labels.slp", NAMES, layout="file").people
    np.testing.assert_allclose(found[..., :2], people[..., ::-1, :2] - 0.5, atol=1e-12)


def test_nwb_without_poses_is_told(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "session.nwb", "w") as file:
        file.create_group("processing/behavior/Position")
    with pytest.raises(sk.DatasetError, match="a container PoseEstimation of ndx-pose"):
        read_detections(tmp_path / "session.nwb", CAMERAS)


@pytest.mark.filterwarnings("ignore:The layout is that")
def test_nwb_states_rate_and_edges(tmp_path, people):
    path, _ = written("ndx_pose", tmp_path, people)
    found = read_detections(path, CAMERAS, layout="file")
    assert found.frame_rate == pytest.approx(30.0, rel=1e-5)
    assert (0, 1) in found.skeleton.limbs
    with pytest.raises(sk.DatasetError, match=r"a calibration .* got detections \(ndx_pose\)"):
        sk.io.read_calibration(path)


@pytest.mark.filterwarnings("ignore:The layout is that")
def test_hourglasses_have_mpiis_joints(tmp_path, people):
    people = people[..., :1, :16, :]
    path = hourglass(tmp_path, Take(people, list(CAMERAS), []))
    found = read_detections(path, CAMERAS, layout="file")
    assert (found.format, found.camera_names) == ("hourglass", CAMERAS)
    assert found.skeleton.joints[6:10] == ("pelvis", "thorax", "upper_neck", "head_top")
    np.testing.assert_array_equal(found.people[..., :2], people[..., :2])
    hourglass(tmp_path, Take(people[..., :15, :], ["cam2"], []))
    with pytest.raises(sk.DatasetError, match=r"Walking 1\.cam2\.h5: poses"):
        read_detections(path, CAMERAS, layout="file")
