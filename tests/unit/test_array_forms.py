"""Every function that takes arrays gives the same bits for the same numbers, in whatever form they come."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from array_forms import ARGUMENTS, CALLS, FORMS, MASKED, PIXELS, POSES, RIG, outcome, unaligned
from skelsplat import metrics, synthetic, temporal, viz
from skelsplat.evaluation import baselines
from skelsplat.rig_check import check_rig


@pytest.mark.parametrize(("call", "argument"), ARGUMENTS)
def test_the_form_of_an_array_does_not_matter(call, argument):
    array = CALLS[call][1][argument]
    plain = outcome(call)
    assert not isinstance(plain, str), plain
    for form, change in FORMS.items():
        given = change(array)
        assert outcome(call, **{argument: given}) == plain, form


@pytest.mark.parametrize(("call", "argument"), ARGUMENTS)
def test_a_mask_is_nan(call, argument):
    array = CALLS[call][1][argument]
    hidden = np.random.default_rng(0).random(array.shape) < 0.2
    hidden.flat[0] = True
    plain = outcome(call, **{argument: np.where(hidden, np.nan, array)})
    for form, change in MASKED.items():
        assert outcome(call, **{argument: change(array, hidden)}) == plain, form


@pytest.mark.filterwarnings("ignore")  # rounded to bool and the like they are no pose and no camera
@pytest.mark.parametrize(("call", "argument"), ARGUMENTS)
def test_other_numbers_are_doubles(call, argument):
    array = CALLS[call][1][argument]
    for kind in (np.float32, np.float16, np.longdouble, np.int64, np.int32, np.bool_):
        with np.errstate(all="ignore"):
            given = np.nan_to_num(array, posinf=0.0, neginf=0.0).astype(kind)
            given = np.nan_to_num(given, posinf=0.0, neginf=0.0) if given.dtype.kind == "f" else given
        plain = outcome(call, **{argument: given.astype(np.float64)})
        assert outcome(call, **{argument: given}) == plain, kind
        masked = np.ma.array(given, mask=np.zeros(given.shape, bool))
        masked[(0,) * given.ndim] = np.ma.masked
        plain = outcome(call, **{argument: masked.astype(np.float64).filled(np.nan)})
        assert outcome(call, **{argument: masked}) == plain, kind


NO_NUMBERS = {
    "complex": (lambda a: a + 2j, r"complex numbers \(complex128\)"),
    "text": (lambda a: a.astype(str), r"text \(<U\d+\)"),
    "text among objects": (lambda a: np.vectorize(str, otypes=[object])(a), "an object of type str"),
    "complex among objects": (lambda a: (a + 2j).astype(object), "an object of type complex"),
    "records": (lambda a: a.astype([("x", "f8"), ("y", "f8")]), r"records with the fields x, y .*\['x'\]"),
    "masked records": (
        lambda a: np.ma.array(a.astype([("x", "f8")]), mask=True),
        r"records with the fields x ",
    ),
    "times": (lambda a: np.zeros(a.shape, "M8[s]"), r"an array of datetime64\[s\]"),
    "spans of time": (lambda a: np.zeros(a.shape, "m8[s]"), r"an array of timedelta64\[s\]"),
    "None": (lambda _: None, "None"),
    "a dict": (lambda a: {"x": a}, ".*dict.*"),
    "ragged": (lambda _: [[1.0], [1.0, 2.0]], ".*inhomogeneous.*"),
}
OPTIONAL = {"confidence", "init_pose", "init_sigma", "distortion", "joint_sigmas_mm", "view_weights"}


@pytest.mark.parametrize(("call", "argument"), ARGUMENTS)
def test_what_is_no_number_is_refused(call, argument):
    array = CALLS[call][1][argument]
    for form, (change, words) in NO_NUMBERS.items():
        if form == "None" and argument in OPTIONAL:
            continue
        said = rf"{argument}: expected an array of numbers, got {words}"
        if call == "RefineConfig":
            said = rf"config\.{argument}: expected a sequence of numbers, or None, got "
        with pytest.raises(sk.InvalidInputError, match=r"^" + said):
            CALLS[call][0](**(CALLS[call][1] | {argument: change(array)}))


def test_an_array_that_cannot_be_read_says_why():
    class Remote:
        def __array__(self, dtype=None, copy=None):
            raise RuntimeError("it lies on another\nmachine")

    said = "points: expected an array of numbers, got it lies on another machine"
    with pytest.raises(sk.InvalidInputError, match=said):
        sk.project(Remote(), RIG)


def test_confidences_of_zero_count_when_they_are_unaligned():
    none = np.zeros(PIXELS.shape[:-1])
    statuses = sk.refine(None, PIXELS, RIG, layout="h36m17", confidence=unaligned(none)).joint_status
    assert (statuses == "unobserved").all()
    with pytest.raises(sk.InvalidInputError, match=r"confidence\[0, 0, 0\]: expected a value in \[0, 1\]"):
        sk.refine(None, PIXELS, RIG, confidence=unaligned(none + 7.0))


def test_a_memory_map_with_an_odd_header(tmp_path):
    path = tmp_path / "detections.bin"
    path.write_bytes(b"odd" + PIXELS.tobytes())
    mapped = np.memmap(path, dtype=np.float64, mode="r", offset=3, shape=PIXELS.shape)
    assert not mapped.flags.aligned
    assert np.array_equal(sk.triangulate(mapped, RIG), sk.triangulate(PIXELS, RIG))


def test_a_mask_is_nan_to_check_rig():
    hidden = np.random.default_rng(1).random(PIXELS.shape) < 0.1
    masked = np.ma.array(unaligned(np.where(hidden, 5.0, PIXELS)), mask=hidden)
    plain = check_rig(RIG, np.where(hidden, np.nan, PIXELS))
    assert repr(check_rig(RIG, masked)) == repr(plain)


def test_pictures_leave_out_what_is_masked():
    hidden = np.random.default_rng(2).random(PIXELS.shape[:3]) < 0.3
    weights = np.ma.array(np.ones(hidden.shape, dtype=np.float32), mask=hidden)
    data = viz.WeightData(weights, np.arange(len(PIXELS)), RIG.names, sk.layouts.H36M17.joints, 0.25)
    assert np.array_equal(np.isnan(data.weights), hidden)
    assert type(data.weights) is np.ndarray
    with pytest.raises(sk.InvalidInputError, match="median_px: expected an array of numbers, got text"):
        viz.ErrorMapData(np.array([["a"]]), np.zeros((1, 1)), (), ())


def test_pandas_frames_with_missing_numbers():
    pandas = pytest.importorskip("pandas")
    points = pandas.DataFrame(POSES[0]).astype("Float64")
    points.iloc[2, 1] = pandas.NA
    plain = POSES[0].copy()
    plain[2, 1] = np.nan
    assert np.array_equal(sk.project(points, RIG), sk.project(plain, RIG), equal_nan=True)
    assert metrics.missing_rate(points, POSES[0]) == pytest.approx(1 / 17)


def test_masked_frames_and_flags_are_refused():
    masked = np.ma.array(np.arange(len(POSES)), mask=[1, *[0] * (len(POSES) - 1)])
    for call in (
        lambda: temporal.fill_gaps(POSES, 2, method="linear", frames=masked),
        lambda: check_rig(RIG, PIXELS, frames=masked),
    ):
        with pytest.raises(sk.InvalidInputError, match=r"^frames: expected whole numbers, got nan$"):
            call()
    with pytest.raises(sk.InvalidInputError, match=r"^frames: expected whole numbers, got 0\.5$"):
        temporal.fill_gaps(POSES, 2, method="linear", frames=np.arange(len(POSES)) + 0.5)
    weak = np.ma.array(np.zeros(POSES.shape[:2], dtype=bool), mask=False)
    weak[1, 2] = np.ma.masked
    with pytest.raises(sk.InvalidInputError, match=r"^gaps: expected True or False everywhere, got nan$"):
        temporal.fill_gaps(POSES, 2, method="linear", gaps=weak)
    with pytest.raises(sk.InvalidInputError, match=r"^root: expected a joint index"):
        metrics.root_relative_mpjpe(POSES, POSES, root=np.ma.array([0, 1], mask=[0, 1]))


@pytest.mark.parametrize("size", [1.5e100, 1e155, -1e155, 1e300])
def test_metrics_refuse_what_their_squares_cannot_hold(size):
    large = POSES.copy()
    large[1, 2, 0] = size
    said = r"pred\[1, 2, 0\]: expected numbers from -1e\+100 to 1e\+100, got "
    for metric in (metrics.mpjpe, metrics.pa_mpjpe, metrics.pck, metrics.auc, metrics.missing_rate):
        with pytest.raises(sk.InvalidInputError, match=said):
            metric(large, POSES)


def test_sigma_coverage_refuses_covariances_of_such_poses():
    covariance = np.broadcast_to(np.eye(3), (*POSES.shape, 3)).copy()
    covariance[1, 2, 0, 0] = 1e201
    said = r"covariance\[1, 2, 0, 0\]: expected numbers from -1e\+200 to 1e\+200, got 1e\+201"
    with pytest.raises(sk.InvalidInputError, match=said):
        metrics.sigma_coverage(POSES, covariance, POSES)


def test_metrics_of_the_largest_poses_are_numbers():
    large = np.random.default_rng(0).uniform(-1e100, 1e100, POSES.shape)
    for metric in (metrics.mpjpe, metrics.pa_mpjpe):
        assert np.isfinite(metric(large, POSES))
        assert np.isfinite(metric(POSES, large))
        assert np.isfinite(metric(large, large[::-1]))


def test_baselines_refuse_pixels_that_their_equations_cannot_hold():
    far = PIXELS.copy()
    far[1, 2, 3, 0] = -1e160
    said = r"^detections: expected pixels from -1e\+50 to 1e\+50, got -1e\+160$"
    with pytest.raises(sk.InvalidInputError, match=said):
        baselines.dlt(far, RIG)


def test_a_camera_of_vectors_and_points_that_are_none():
    with pytest.raises(sk.InvalidInputError, match=r"^up: expected three finite numbers, got \[0.0, 1.0\]$"):
        synthetic.look_at([0.0, 0, 0], [1.0, 0, 0], [0.0, 1.0])
    with pytest.raises(sk.InvalidInputError, match=r"^eye: expected three finite numbers, got \[nan, "):
        synthetic.look_at(np.ma.array([0.0, 0, 0], mask=[1, 0, 0]), [1.0, 0, 0])
