//! Detections with their confidences, of one frame or of several.

use pyo3::Borrowed;
use pyo3::prelude::*;
use skelsplat_core::{Detections, Error};

use crate::args::{Array, Confidence, Out, place, shown};
use crate::errors::{Failure, Result, refuse};

/// A confidence up to this one counts as 1: rounding, and peaks of heat maps that are drawn to end
/// at 1.
pub(crate) const HIGHEST_CONFIDENCE: f64 = 1.05;
/// Peaks of a detector's heat maps slightly exceed the range [0, 1].
const HIGHEST_PEAK: f64 = 2.0;
const HIGHEST_PERCENTAGE: f64 = 100.0;

/// Detections ([T,] M, N, 2|3).
pub(crate) struct Frames {
    pixels: Vec<f64>,
    scores: Vec<f64>,
    /// Whether a leading axis T was given.
    pub(crate) batch: bool,
    /// T, or 1.
    pub(crate) count: usize,
    pub(crate) n_views: usize,
    pub(crate) n_joints: usize,
}

impl<'py> FromPyObject<'_, 'py> for Frames {
    type Error = Failure;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
        let array = Array::read("detections", &value)?;
        let (batch, count, n_views, n_joints) = match *array.shape.as_slice() {
            [m, n, 2 | 3] => (false, 1, m, n),
            [t, m, n, 2 | 3] => (true, t, m, n),
            _ => return Err(array.misshapen("([T,] M, N, 2|3) of one person (choose_person)")),
        };
        let array = array.bounded(", or NaN where missing")?;
        if n_views == 0 || n_joints == 0 {
            let actual = format!("shape {}", shown(&array.shape));
            return refuse("detections", "at least one view and one joint", actual);
        }
        let (pixels, scores) = split(array);
        let mut frames = Self { pixels, scores, batch, count, n_views, n_joints };
        frames.check_own_scores(value.py(), "detections", ", 2")?;
        Ok(frames)
    }
}

impl Frames {
    /// The shape of `count` frames, without detections.
    pub(crate) fn of(count: usize, n_views: usize, n_joints: usize) -> Self {
        Self { pixels: Vec::new(), scores: Vec::new(), batch: true, count, n_views, n_joints }
    }

    /// The shape of a frame by itself, without detections.
    pub(crate) fn single(n_views: usize, n_joints: usize) -> Self {
        Self { batch: false, ..Self::of(1, n_views, n_joints) }
    }

    /// The same with separate confidences ([T,] M, N).
    pub(crate) fn with(mut self, confidence: Option<Confidence>) -> Result<Self> {
        let Some(Confidence(array)) = confidence else { return Ok(self) };
        if !self.scores.is_empty() {
            let actual = "detections with a third channel as well";
            return refuse("confidence", "only one source of confidences", actual);
        }
        let shape = self.shape(&[self.n_views, self.n_joints]);
        self.scores = array.of(&shape, "")?.values;
        Python::attach(|py| self.check_own_scores(py, "confidence", ""))?;
        Ok(self)
    }

    fn check_own_scores(&mut self, py: Python<'_>, name: &str, channel: &str) -> Result<()> {
        let shape = self.shape(&[self.n_views, self.n_joints]);
        check_scores(py, name, &mut self.scores, &self.pixels, |k| place(name, &shape, k, channel))
    }

    /// The frames as core types.
    pub(crate) fn detections(&self) -> Result<Vec<Detections>> {
        let (m, n) = (self.n_views, self.n_joints);
        let frame = |t| {
            let at = t * m * n..(t + 1) * m * n;
            let scores = (!self.scores.is_empty()).then(|| &self.scores[at.clone()]);
            let found = Detections::new(m, n, &self.pixels[2 * at.start..2 * at.end], scores);
            Ok(found.map_err(|error| self.in_frame(t, error))?)
        };
        (0..self.count).map(frame).collect()
    }

    /// An error in view and joint of a frame, as one in frame, view and joint.
    fn in_frame(&self, t: usize, error: Error) -> Error {
        match error {
            Error::InvalidInput { argument, expected, actual } if self.batch => {
                Error::invalid(argument.replacen('[', &format!("[{t}, "), 1), expected, actual)
            }
            other => other,
        }
    }

    /// The frames as core types; their sizes stay.
    pub(crate) fn take(&mut self) -> Result<Vec<Detections>> {
        let detections = self.detections()?;
        (self.pixels, self.scores) = Default::default();
        Ok(detections)
    }

    /// Pixels, with confidences if there are any, as one array.
    pub(crate) fn numbers(self) -> Out<f64> {
        if self.scores.is_empty() {
            let shape = self.shape(&[self.n_views, self.n_joints, 2]);
            return Out(self.pixels, shape);
        }
        let shape = self.shape(&[self.n_views, self.n_joints, 3]);
        let rows = self.pixels.chunks_exact(2).zip(&self.scores);
        Out(rows.flat_map(|(p, score)| [p[0], p[1], *score]).collect(), shape)
    }

    /// The frames of a recording.
    pub(crate) fn recording(self) -> Result<Self> {
        if self.batch {
            return Ok(self);
        }
        refuse("detections", "the frames of a recording (T, M, N, 2|3)", "one frame")
    }

    /// The only frame.
    pub(crate) fn only(&self) -> Result<Detections> {
        if self.batch {
            let actual = format!("{} frames", self.count);
            return refuse("detections", "one frame (M, N, 2|3) of one person", actual);
        }
        Ok(self.detections()?.swap_remove(0))
    }

    /// `shape` with the leading T if there was one.
    pub(crate) fn shape(&self, shape: &[usize]) -> Vec<usize> {
        let lead = self.batch.then_some(self.count);
        lead.into_iter().chain(shape.iter().copied()).collect()
    }

    /// `values` of all frames as one array; `shape` is that of one frame.
    pub(crate) fn out<T>(&self, values: Vec<T>, shape: &[usize]) -> Out<T> {
        Out(values, self.shape(shape))
    }

    /// Rejects detections with another number of views than cameras.
    pub(crate) fn expect_views(&self, n_cameras: usize) -> Result<()> {
        if self.n_views == n_cameras {
            return Ok(());
        }
        let expected = format!("one view per camera ({n_cameras})");
        refuse("detections", expected, format!("{} views", self.n_views))
    }
}

/// Pixels, and the third channel if there is one.
pub(crate) fn split(array: Array) -> (Vec<f64>, Vec<f64>) {
    if array.shape.ends_with(&[2]) {
        return (array.values, Vec::new());
    }
    let rows = || array.values.chunks_exact(3);
    (rows().flat_map(|d| [d[0], d[1]]).collect(), rows().map(|d| d[2]).collect())
}

/// Rejects a confidence outside [0, 1], located by `place`, except for missing detections (pixel
/// not finite). What is slightly above 1 becomes 1, with a warning that names the argument.
pub(crate) fn check_scores(
    py: Python<'_>,
    name: &str,
    scores: &mut [f64],
    pixels: &[f64],
    place: impl Fn(usize) -> String,
) -> Result<()> {
    let above = |limit: f64| {
        let wrong = move |(score, pixel): (&f64, &[f64])| {
            (*score < 0.0 || *score > limit) && pixel.iter().all(|p| p.is_finite())
        };
        scores.iter().zip(pixels.chunks_exact(2)).position(wrong)
    };
    if above(1.0).is_none() {
        return Ok(());
    }
    if let Some(k) = above(HIGHEST_CONFIDENCE) {
        let expected = format!("a value in [0, 1]{}", advice(scores[k]));
        return refuse(place(k), expected, scores[k].to_string());
    }
    for score in scores.iter_mut().filter(|score| **score > 1.0) {
        *score = 1.0; // not `min`, which makes 1 of NaN
    }
    py.import("skelsplat.findings")?.call_method1("warn_of_clipped", (name, HIGHEST_CONFIDENCE))?;
    Ok(())
}

/// Advice for such a score; empty if the value is clearly a pixel coordinate.
fn advice(score: f64) -> &'static str {
    if score.abs() <= HIGHEST_PEAK {
        " (clip scores: np.clip(scores, 0, 1))"
    } else if (0.0..=HIGHEST_PERCENTAGE).contains(&score) {
        " (divide percentages by 100)"
    } else {
        ""
    }
}
