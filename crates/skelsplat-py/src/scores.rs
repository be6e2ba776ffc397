//! Confidences as they are given: refused by the place in the array that they came in.

use pyo3::prelude::*;

use crate::args::Array;
use crate::errors::invalid;

/// Peaks of a detector's maps run a little over 1 and under 0.
const HIGHEST_PEAK: f64 = 2.0;
const HIGHEST_PERCENTAGE: f64 = 100.0;

/// The array of scores that a message names: `scores` of `shape`, whose places end in `channel`.
pub(crate) struct Place<'a> {
    pub(crate) name: &'a str,
    pub(crate) shape: &'a [usize],
    pub(crate) channel: &'a str,
}

/// Refuses a confidence outside [0, 1]; that of a missing detection, whose pixel is not finite, does not count.
pub(crate) fn check(
    py: Python<'_>,
    scores: &[f64],
    pixels: &[f64],
    place: &Place<'_>,
) -> PyResult<()> {
    let wrong = |(score, pixel): (&f64, &[f64])| {
        (*score < 0.0 || *score > 1.0) && pixel.iter().all(|p| p.is_finite())
    };
    let Some(k) = scores.iter().zip(pixels.chunks_exact(2)).position(wrong) else { return Ok(()) };
    let expected = format!("a value in [0, 1]{}", advice(scores[k]));
    Err(invalid(py, &place.of(k), &expected, scores[k].to_string()))
}

/// What to do about such a score; nothing about what is none, but a pixel.
fn advice(score: f64) -> &'static str {
    if score.abs() <= HIGHEST_PEAK {
        " (clip scores: np.clip(scores, 0, 1))"
    } else if (0.0..=HIGHEST_PERCENTAGE).contains(&score) {
        " (divide percentages by 100)"
    } else {
        ""
    }
}

impl Place<'_> {
    /// `name[…]` of the entry `k`, counted row-major.
    pub(crate) fn of(&self, mut k: usize) -> String {
        let mut places = Vec::with_capacity(self.shape.len());
        for n in self.shape.iter().rev() {
            places.push((k % n).to_string());
            k /= n;
        }
        places.reverse();
        format!("{}[{}{}]", self.name, places.join(", "), self.channel)
    }
}

/// Refuse a confidence outside [0, 1] in people (T, M, P, K, 3), which the message calls ``people``.
#[pyfunction]
pub(crate) fn check_people(py: Python<'_>, people: &Bound<'_, PyAny>) -> PyResult<()> {
    let shape = [None, None, None, None, Some(3)];
    let array = Array::of_shape("people", people, &shape, "(T, M, P, K, 3)")?;
    let (pixels, scores) = crate::args::split(array.values(), 3);
    let place = Place { name: "people", shape: &array.shape[..4], channel: ", 2" };
    check(py, &scores, &pixels, &place)
}
