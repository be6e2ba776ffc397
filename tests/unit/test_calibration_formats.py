"""Every calibration format against OpenCV's projection of known points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.io

import calibration_files as files
import skelsplat as sk
from calibration_files import FORMATS_WRITTEN, FULL, NAMES
from skelsplat.cameras import without_distortion
from skelsplat.io import read_calibration, sample
from skelsplat.io.calibration import find_format

MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0}


@pytest.fixture
def views():
    return files.reference(NAMES)


@pytest.mark.parametrize("name", FORMATS_WRITTEN)
def test_known_points_fall_where_opencv_projects_them(tmp_path, views, name):
    write, options, names, unit, tolerance = FORMATS_WRITTEN[name]
    path = write(tmp_path, views)
    assert find_format(path) == name
    rig = read_calibration(path, **options)
    assert rig.names == tuple(names)
    assert rig.unit == unit
    pixels = sk.project(files.points() / MM[unit], rig)
    np.testing.assert_allclose(pixels, files.projected(views), atol=tolerance, rtol=0)
    for camera, view in zip(rig, views, strict=True):
        assert camera.size == ((1000, 1002) if "size" in options else view.size)
        np.testing.assert_allclose(camera.centre * MM[unit], view.centre, atol=1e-2)


def test_an_older_file_of_caliscope_has_matrices_pairs_of_cameras_and_cameras_left_out(tmp_path, views):
    path = files.pyxy3d(tmp_path, views)
    assert find_format(path) == "caliscope"
    rig = read_calibration(path)
    assert (rig.names, rig.unit) == (("cam_0", "cam_1", "cam_2", "cam_3"), "m")
    np.testing.assert_allclose(sk.project(files.points() / 1000, rig), files.projected(views), atol=FULL)
    path.write_text(path.read_text().replace("cam_id =", "port ="))
    assert read_calibration(path).names[0] == "port_0"


@pytest.mark.parametrize("name", ["calibration.toml", "Calib.toml"])
def test_the_offset_of_aniposes_cropped_videos_is_taken_off_the_centre(tmp_path, views, name):
    """Anipose adds it to the detections of the crop before it triangulates; others have no such project."""
    folder = tmp_path / "project" / "session" / "calibration"
    folder.mkdir(parents=True)
    path = files.anipose(folder, views).rename(folder / name)
    project = tmp_path / "project" / "config.toml"
    project.write_text(f'model_folder = "a"\n[cameras.{NAMES[1]}]\noffset = [224, 120]\nprefix = "x"\n')
    (tmp_path / "project" / "session" / "config.toml").write_text("[cameras.other]\noffset = [1, 1]\n")
    (folder / "config.toml").write_text("[broken")
    if name == "Calib.toml":
        assert read_calibration(path, unit="m")[1].size == views[1].size
        return
    with pytest.warns(UserWarning, match=f"offset: {NAMES[1]}") as caught:
        rig = read_calibration(path, unit="m")
    assert caught[0].message.finding.kind == "crop_applied"
    assert str(caught[0].message).startswith(str(project))
    expected = files.projected(views)
    expected[1] -= [224, 120]
    np.testing.assert_allclose(sk.project(files.points() / 1000, rig), expected, atol=FULL)
    assert (rig[0].size, rig[1].size) == (views[0].size, (1000 - 224, 1000 - 120))


@pytest.mark.parametrize("form", ["session", "files", "one file"])
def test_opencap_by_session_by_folder_and_by_file(tmp_path, views, form):
    folder = files.opencap(tmp_path, views) / "Videos"
    if form in ("files", "one file"):
        for path in sorted(folder.glob("*/*.pickle")):
            path.rename(tmp_path / f"{path.parent.name}.pickle")
        (folder / "mappingCamDevice.pickle").unlink()
    rig = read_calibration(tmp_path / f"{NAMES[2]}.pickle" if form == "one file" else tmp_path)
    assert rig.names == ((NAMES[2],) if form == "one file" else tuple(NAMES))
    np.testing.assert_array_equal(rig[NAMES[2]].K, views[2].K)


@pytest.mark.parametrize("named", [True, False])
def test_dannce_by_files_of_single_cameras_and_without_names(tmp_path, views, named):
    if named:
        for v in views:
            scipy.io.savemat(tmp_path / f"{v.name}_params.mat", files.matlab_camera(v))
    else:
        scipy.io.savemat(tmp_path / "x.mat", {"params": files.cell([files.matlab_camera(v) for v in views])})
    rig = read_calibration(tmp_path if named else tmp_path / "x.mat", size=(1000, 1000))
    assert rig.names == (tuple(NAMES) if named else ("Camera1", "Camera2", "Camera3", "Camera4"))
    np.testing.assert_allclose(sk.project(files.points(), rig), files.projected(views), atol=FULL)


def test_skew_is_followed_by_half_turning_the_camera(tmp_path, views):
    path = files.dannce(tmp_path, views, skew=2.0)
    with pytest.warns(UserWarning, match="skew is not supported") as caught:
        rig = read_calibration(path, size=(1000, 1000))
    skewed = [replace(v, K=v.K + 2 * np.eye(3, k=1) * [[1], [0], [0]], distortion=np.zeros(5)) for v in views]
    plain = [without_distortion(camera) for camera in rig]
    error = np.abs(sk.project(files.points(), plain) - files.projected(skewed)).max()
    assert 0.1 < error < caught[0].message.finding.numbers["error_px"]


@pytest.mark.parametrize("radial", ["-6e-8 3e-14 -1e-21"])
def test_vicons_lens_maps_measured_pixels_to_ideal_ones_about_its_own_centre(tmp_path, radial):
    views = files.reference(NAMES, distortion=False)
    rig = read_calibration(files.vicon(tmp_path, views, radial))
    k = np.array([float(part) for part in radial.split()])
    measured = np.random.default_rng(1).uniform(0, 1000, (200, 2))
    for camera, view in zip(rig, views, strict=True):
        aspect = view.K[0, 0] / view.K[1, 1]
        offset = (measured - view.K[:2, 2] - [4, -3]) * [1, aspect]
        r2 = (offset**2).sum(axis=1, keepdims=True)
        ideal = offset * (1 + k[0] * r2 + k[1] * r2**2 + k[2] * r2**3) / [1, aspect] + view.K[:2, 2] + [4, -3]
        assert np.abs(ideal - measured).max() > 5.0
        rays = (np.c_[ideal, np.ones(200)] @ np.linalg.inv(view.K).T) * 3000.0
        world = (rays - view.t) @ view.R
        # the fit is good to 0.1 px or warns
        np.testing.assert_allclose(sk.project(world, [camera])[0], measured, atol=0.1)


def test_a_wide_vicon_lens_is_followed_by_opencvs_rational_model(tmp_path):
    K = np.array([[900.0, 0.0, 950.0], [0.0, 900.0, 545.0], [0.0, 0.0, 1.0]])
    view = replace(files.reference(NAMES[:1], distortion=False)[0], K=K, size=(1920, 1080))
    path = files.vicon(tmp_path, [view])
    old = f'VICON_RADIAL2="Vicon3Parameter {K[0, 2] + 4} {K[1, 2] - 3} 0 0 0"'
    path.write_text(path.read_text().replace(old, 'VICON_RADIAL="3e-7 3e-13"'))
    (camera,) = read_calibration(path)
    measured = np.random.default_rng(1).uniform([0, 0], [1919, 1079], (300, 2))
    r2 = ((measured - K[:2, 2]) ** 2).sum(axis=1, keepdims=True)
    ideal = (measured - K[:2, 2]) * (1 + 3e-7 * r2 + 3e-13 * r2**2) + K[:2, 2]
    assert np.abs(ideal - measured).max() > 400.0
    rays = np.c_[ideal, np.ones(300)] @ np.linalg.inv(K).T * 3000.0
    np.testing.assert_allclose(sk.project((rays - view.t) @ view.R, [camera])[0], measured, atol=0.05)


# Camera 1 of Pose2Sim's demo (BSD-3-Clause): the .qca.txt from which its Calib.toml, our sample, was made.
DEMO = """<calibration><cameras><camera active="1" avg-residual="0.402000" model="none" serial="cam01"
 viewrotation="0"><fov_video bottom="1919" left="0" right="1087" top="0"/>
<transform r11="0.5536380477336265" r12="0.8046719867383512" r13="0.2144479094331626"
 r21="-0.4345300743838753" r22="0.05946489349975602" r23="0.8986921279821063" r31="0.7104002579937896"
 r32="-0.5907342212870501" r33="0.3825762057979294" x="1460.2323709212087" y="-1909.1590482454608"
 z="1896.5058524092062"/><intrinsic centerPointU="34110.316406" centerPointV="60680.792969"
 focalLengthU="107599.671875" focalLengthV="107588.828125" radialDistortion1="-0.046183"
 radialDistortion2="0.139983" radialDistortion3="0.000000" skew="0.000000" tangentalDistortion1="0.000608"
 tangentalDistortion2="0.00069"/></camera></cameras></calibration>"""


def test_qualisys_conventions_are_those_of_a_real_pair_of_files(tmp_path):
    path = tmp_path / "Calib.qca.txt"
    path.write_text(DEMO)
    camera = read_calibration(path)["cam01"]
    theirs = read_calibration(sample.extract(tmp_path / "s").calibration, unit="m")["cam_01"]
    assert camera.size == theirs.size
    np.testing.assert_allclose(camera.K, theirs.K, atol=1e-6)
    np.testing.assert_allclose(camera.R, theirs.R, atol=1e-7)  # they keep eight decimals
    np.testing.assert_allclose(camera.t / 1000, theirs.t, atol=1e-7)
    # they divide dimensionless coefficients by 64
    np.testing.assert_allclose(camera.distortion[:4], np.array(theirs.distortion) * 64, atol=1e-9)


def test_qualisys_binning_and_a_part_of_the_sensor(tmp_path, views):
    path = files.qualisys(tmp_path, views, binning=2.0, left=100, top=40)
    rig = read_calibration(path, binning=2.0)
    np.testing.assert_allclose(sk.project(files.points(), rig), files.projected(views), atol=5e-3)
    assert rig[0].size == views[0].size


def test_a_video_of_fewer_lines_than_the_sensor_needs_the_binning(tmp_path, views):
    path = files.qualisys(tmp_path, views, extra=' video_resolution="540p"')
    text = path.read_text().replace("<fov_video ", '<fov_video_max bottom="1087"/><fov_video ')
    path.write_text(text)
    with pytest.raises(sk.DatasetError, match=r"video_resolution: .*1088 lines.*option binning.*got 540p"):
        read_calibration(path)
    path.write_text(text.replace("540p", "1080p"))
    assert len(read_calibration(path)) == 4


@pytest.mark.parametrize(("binning", "left"), [(1.0, 0), (2.0, 100)])
def test_qualisys_in_pixels_is_recognised_and_said(tmp_path, views, binning, left):
    path = files.qualisys(tmp_path, views, binning=binning, left=left, parts=1.0)
    with pytest.warns(UserWarning, match="focal length and centre of 54138969, "):
        rig = read_calibration(path, binning=binning)
    np.testing.assert_allclose(sk.project(files.points(), rig), files.projected(views), atol=5e-3)


def test_theia_states_its_sensors_in_either_of_two_ways(tmp_path, views):
    rig = read_calibration(files.theia(tmp_path, views))
    assert read_calibration(files.theia(tmp_path, views, dimensions=True)) == rig
    path = tmp_path / "calibration.txt"
    # Qualisys' own file without fields of view has sensors in 1/64 px
    path.write_text(path.read_text().replace('sensorDimU="', 'sensorDimU="64'))
    assert find_format(path) == "qualisys"


def test_a_turned_view_is_a_warning(tmp_path, views):
    path = files.qualisys(tmp_path, views)
    path.write_text(path.read_text().replace('viewrotation="0"><fov', 'viewrotation="90"><fov'))
    with pytest.warns(UserWarning, match="viewrotation: images of 54138969, ") as caught:
        read_calibration(path)
    assert caught[0].message.finding.kind == "calibration_read_as"
    assert caught[0].message.finding.subject.cameras[0] == "54138969"


def test_human36m_subjects(tmp_path, views):
    path = files.human36m(tmp_path, views)
    one, nine = (read_calibration(path, subject=subject) for subject in ("S1", "S9"))
    np.testing.assert_allclose(one[0].t, nine[0].t + 50.0)
    assert [camera.size[1] for camera in nine] == [1002, 1000, 1000, 1002]
    for subject in (None, "S7"):
        with pytest.raises(sk.InvalidInputError, match="subject"):
            read_calibration(path, subject=subject)


@pytest.mark.parametrize(
    ("given", "header"), [("", "%YAML 1.2"), ("intri.yml", "%YAML:1.0"), ("extri.yml", "")]
)
def test_easymocap_by_folder_or_by_either_file(tmp_path, views, given, header):
    folder = files.easymocap(tmp_path, views, header)
    rig = read_calibration(folder / given, unit="m")
    np.testing.assert_allclose(sk.project(files.points() / 1000, rig), files.projected(views), atol=FULL)


def test_easymocap_has_the_cameras_that_are_in_both_files(tmp_path, views):
    files.easymocap(tmp_path, views)
    every = (tmp_path / "intri.yml").read_text()
    files.easymocap(tmp_path, views[:3])
    (tmp_path / "intri.yml").write_text(every)
    with pytest.warns(UserWarning, match=f"{NAMES[3]}: not in both"):
        assert read_calibration(tmp_path, unit="m").names == tuple(NAMES[:3])
    files.easymocap(tmp_path, [replace(views[0], name="other")])
    (tmp_path / "intri.yml").write_text(every)
    with pytest.raises(sk.DatasetError, match=r"extri\.yml: names"):
        read_calibration(tmp_path, unit="m")


def test_easymocap_as_its_own_program_writes_it(tmp_path):
    def matrix(key, rows, cols, data):
        return f"{key}: !!opencv-matrix\r\n  rows: {rows}\r\n  cols: {cols}\r\n  dt: d\r\n  data: {data}\r\n"

    K = "[1000.000000, 0.000000, 500.000000, 0.000000, 1000.000000, 400.000000, 0.000000, 0.000000, 1.000000]"
    intri, extri = (
        '%YAML:1.0\r\n---\r\nnames:\r\n  - "01"\r\n  - "2"\r\n',
        '%YAML:1.0\n---\nnames: [ "01", "2" ]\n',
    )
    for n in ("01", "2"):
        intri += matrix(f"K_{n}", 3, 3, K) + matrix(f"D_{n}", 5, 1, "[0.1, 0, 0, 0, 0]")
        extri += matrix(f"R_{n}", 3, 1, "[0, 0, 0.1]") + matrix(f"T_{n}", 3, 1, f"[{n}, 0.000000, 3.000000]")
    (tmp_path / "intri.yml").write_bytes(intri.encode())
    (tmp_path / "extri.yml").write_bytes(extri.encode())
    rig = read_calibration(tmp_path, unit="m", size=(1000, 800))
    assert rig.names == ("01", "2")
    assert rig[1].size == (1000, 800)
    np.testing.assert_array_equal(rig[1].distortion, [0.1, 0, 0, 0, 0])
    np.testing.assert_array_equal(rig[1].t, [2, 0, 3])


@pytest.mark.parametrize("pose", ["T_cn_cnm1", "T_cam_imu", "T_imu_cam"])
def test_kalibrs_chain_begins_at_the_first_camera_or_at_the_imu(tmp_path, views, pose):
    views = [replace(v, distortion=v.distortion * [1, 1, 1, 1, 0]) for v in views]
    rig = read_calibration(files.kalibr(tmp_path, views, pose))
    world = files.points() / 1000
    if pose == "T_cn_cnm1":
        world = world @ views[0].R.T + views[0].t / 1000
    np.testing.assert_allclose(sk.project(world, rig), files.projected(views), atol=FULL)
    assert (rig.names, rig.unit) == (("cam0", "cam1", "cam2", "cam3"), "m")


def test_kalibrs_equidistant_lens_is_opencvs_fisheye(tmp_path, views):
    rig = read_calibration(files.kalibr(tmp_path, views, model="equidistant"))
    assert all(camera.fisheye for camera in rig)
    np.testing.assert_array_equal(rig[1].distortion, views[1].distortion[:4])


@pytest.mark.parametrize("form", ["one.yml", "one.xml", "pair.yml", "pair.xml"])
@pytest.mark.parametrize("names", [("M", "D"), ("K", "D"), ("cameraMatrix", "distCoeffs")])
def test_opencvs_stereo_files_begin_at_the_first_camera(tmp_path, views, form, names):
    path = files.stereo(tmp_path, views[:2], form, names)
    rig = read_calibration(path, unit="m", size={"cam1": (1000, 1002), "cam2": (1000, 1000)})
    world = (files.points() @ views[0].R.T + views[0].t) / 1000
    np.testing.assert_allclose(sk.project(world, rig), files.projected(views[:2]), atol=FULL)
    if form.startswith("pair"):
        for file in tmp_path.iterdir():
            assert read_calibration(file, unit="m", size=(1000, 1000)).names == ("cam1", "cam2")


@pytest.mark.parametrize("form", ["json", "txt"])
def test_projection_matrices_are_taken_apart(tmp_path, form):
    views = files.reference(NAMES, distortion=False)
    path = files.matrices(tmp_path, views, form)
    with pytest.warns(UserWarning, match="no lens distortion"):
        rig = read_calibration(path, unit="m", size=(1000, 1000))
    assert rig.names == tuple(NAMES)
    np.testing.assert_allclose(sk.project(files.points() / 1000, rig), files.projected(views), atol=1e-7)


@pytest.mark.parametrize(
    ("model", "numbers", "lens", "fisheye"),
    [
        ("SIMPLE_PINHOLE", "900 500.5 400.5", None, False),
        ("PINHOLE", "900 900 500.5 400.5", None, False),
        ("SIMPLE_RADIAL", "900 500.5 400.5 0.1", [0.1, 0, 0, 0], False),
        ("RADIAL", "900 500.5 400.5 0.1 0.2", [0.1, 0.2, 0, 0], False),
        ("OPENCV", "900 900 500.5 400.5 0.1 0.2 0.3 0.4", [0.1, 0.2, 0.3, 0.4], False),
        ("OPENCV_FISHEYE", "900 900 500.5 400.5 0.1 0.2 0.3 0.4", [0.1, 0.2, 0.3, 0.4], True),
        ("RADIAL_FISHEYE", "900 500.5 400.5 0.1 0.2", [0.1, 0.2, 0, 0], True),
    ],
)
def test_colmaps_models_are_opencvs(tmp_path, model, numbers, lens, fisheye):
    (tmp_path / "cameras.txt").write_text(f"3 {model} 1000 800 {numbers}\n")
    (tmp_path / "images.txt").write_text(
        "1 1 0 0 0 0 0 4 3 left/0001.png\n\n2 1 0 0 0 1 0 4 3 right/0001.png\n\n"
    )
    rig = read_calibration(tmp_path / "images.txt", unit="m")
    assert (rig.names, rig[0].fisheye) == (("left", "right"), fisheye)
    np.testing.assert_array_equal(rig[0].K, [[900, 0, 500], [0, 900, 400], [0, 0, 1]])
    np.testing.assert_array_equal([] if rig[1].distortion is None else rig[1].distortion, lens or [])


def test_colmaps_images_may_be_without_lines_of_points(tmp_path, views):
    images = files.colmap(tmp_path, views) / "images.txt"
    rig = read_calibration(tmp_path, unit="m")
    images.write_text("".join(line for line in images.read_text().splitlines(True) if ".jpg" in line))
    found = read_calibration(tmp_path, unit="m")
    assert found.names == rig.names
    np.testing.assert_array_equal([camera.t for camera in found], [camera.t for camera in rig])


def test_a_size_that_the_file_contradicts_is_named_as_options_take_it(tmp_path, views):
    files.easymocap(tmp_path, views)
    with pytest.raises(sk.InvalidInputError, match=r"size: expected none or \d+x\d+, .* got 640x480"):
        read_calibration(tmp_path, size=(640, 480))


def test_openpose_files_are_in_natural_order_and_one_file_is_a_camera(tmp_path, views):
    files.openpose(
        tmp_path, [replace(v, name=name) for v, name in zip(views, ["10", "2", "1", "x"], strict=True)]
    )
    assert read_calibration(tmp_path, size=(1000, 1000)).names == ("1", "2", "10", "x")
    assert read_calibration(tmp_path / "2.xml", size=(1000, 1000)).names == ("2",)
    with pytest.raises(sk.InvalidInputError, match="size"):
        read_calibration(tmp_path)
