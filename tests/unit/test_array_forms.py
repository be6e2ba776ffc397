"""Every function that takes arrays gives the same bits for the same numbers, in whatever form they come."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from array_forms import ARGUMENTS, CALLS, FORMS, MASKED, POSES, RIG, outcome
from skelsplat import metrics


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


NO_NUMBERS = {
    "complex": lambda a: a + 2j,
    "text": lambda a: a.astype(str),
    "records": lambda a: a.astype([("x", "f8"), ("y", "f8")]),
    "times": lambda a: np.zeros(a.shape, "M8[s]"),
    "None": lambda _: None,
    "ragged": lambda _: [[1.0], [1.0, 2.0]],
}
OPTIONAL = {"confidence", "init_pose", "init_sigma", "distortion", "joint_sigmas_mm", "view_weights"}


@pytest.mark.parametrize(("call", "argument"), ARGUMENTS)
def test_what_is_no_number_is_refused(call, argument):
    array = CALLS[call][1][argument]
    for form, change in NO_NUMBERS.items():
        if form == "None" and argument in OPTIONAL:
            continue
        said = f"{argument}"
        if call == "RefineConfig":
            said = rf"config\.{argument}"
        with pytest.raises(sk.InvalidInputError, match=r"^" + said):
            CALLS[call][0](**(CALLS[call][1] | {argument: change(array)}))


def test_pandas_frames_with_missing_numbers():
    pandas = pytest.importorskip("pandas")
    points = pandas.DataFrame(POSES[0]).astype("Float64")
    points.iloc[2, 1] = pandas.NA
    plain = POSES[0].copy()
    plain[2, 1] = np.nan
    assert np.array_equal(sk.project(points, RIG), sk.project(plain, RIG), equal_nan=True)
    assert metrics.missing_rate(points, POSES[0]) == pytest.approx(1 / 17)
