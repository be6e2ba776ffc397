//! 2D detections of one frame.

use nalgebra::Vector2;

use crate::camera::Camera;
use crate::error::{Error, Result};

/// Largest accepted coordinate of a pixel or a world point: larger values are not measurements, and
/// products of a few such numbers stay finite. Generous because simulated points close to a camera
/// can be projected very far.
pub const FARTHEST: f64 = 1e30;

/// Index of the first value outside ±[`FARTHEST`]; NaN is none.
pub fn too_far(values: &[f64]) -> Option<usize> {
    // No branch per value: refining a frame takes only microseconds.
    if !values.iter().fold(false, |far, v| far | (v.abs() > FARTHEST)) {
        return None;
    }
    values.iter().position(|v| v.abs() > FARTHEST)
}

/// One frame's detections, `(M, N)`: pixel and confidence of joint `j` in view `i`.
///
/// A detection is missing when a coordinate is NaN or its confidence is below 1e-30.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detections {
    n_views: usize,
    n_joints: usize,
    points: Vec<Vector2<f64>>,
    confidence: Vec<f64>,
}

impl Detections {
    /// From row-major `(M, N, 2)` pixels and optional `(M, N)` confidences in [0, 1] (default 1).
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if a length does not match, a confidence is outside [0, 1], a pixel
    /// outside ±[`FARTHEST`], or two joints of a view at exactly (0, 0). A confidence that is not a
    /// number marks the detection as missing; that of a missing one is ignored.
    pub fn new(
        n_views: usize,
        n_joints: usize,
        pixels: &[f64],
        confidence: Option<&[f64]>,
    ) -> Result<Self> {
        let n = n_views * n_joints;
        if pixels.len() != 2 * n {
            let expected = format!("{n_views} x {n_joints} x 2 values");
            return Err(Error::invalid("detections", expected, pixels.len().to_string()));
        }
        let confidence = confidence.map_or_else(|| vec![1.0; n], <[f64]>::to_vec);
        if confidence.len() != n {
            let expected = format!("{n_views} x {n_joints} values");
            return Err(Error::invalid("confidence", expected, confidence.len().to_string()));
        }
        let points: Vec<Vector2<f64>> =
            pixels.chunks_exact(2).map(|p| Vector2::new(p[0], p[1])).collect();
        if let Some(k) = too_far(pixels) {
            return Err(Error::invalid(
                format!("detections[{}, {}]", k / 2 / n_joints, k / 2 % n_joints),
                format!("pixels within ±{FARTHEST:e}, or NaN where missing"),
                format!("{:e}", pixels[k]),
            ));
        }
        let seen = |p: &Vector2<f64>| p.x.is_finite() && p.y.is_finite();
        let wrong = |(c, p): (&f64, &Vector2<f64>)| (*c < 0.0 || *c > 1.0) && seen(p);
        if let Some(bad) = confidence.iter().zip(&points).position(wrong) {
            return Err(Error::invalid(
                format!("confidence[{}, {}]", bad / n_joints, bad % n_joints),
                "a value in [0, 1]",
                confidence[bad].to_string(),
            ));
        }
        // A smaller confidence is none: products of a few such numbers would be 0.
        let confidence =
            confidence.into_iter().map(|c| if c < 1.0 / FARTHEST { 0.0 } else { c }).collect();
        Self { n_views, n_joints, points, confidence }.without_corners()
    }

    /// Refuses two joints of a view at exactly (0, 0): so some detectors write that there is none.
    fn without_corners(self) -> Result<Self> {
        let corner = |i, j| self.get(i, j).is_some_and(|(p, _)| p == Vector2::zeros());
        for i in 0..self.n_views {
            if let Some(j) = (0..self.n_joints).filter(|&j| corner(i, j)).nth(1) {
                let at = format!("detections[{i}, {j}]");
                return Err(Error::invalid(at, "NaN where missing", "the second joint at (0, 0)"));
            }
        }
        Ok(self)
    }

    /// From `get(view, joint)`, which has been checked before.
    pub(crate) fn gathered(
        n_views: usize,
        n_joints: usize,
        get: impl Fn(usize, usize) -> Option<(Vector2<f64>, f64)>,
    ) -> Self {
        let nothing = (Vector2::repeat(f64::NAN), 0.0);
        let all = (0..n_views * n_joints).map(|k| get(k / n_joints, k % n_joints));
        let (points, confidence) = all.map(|found| found.unwrap_or(nothing)).unzip();
        Self { n_views, n_joints, points, confidence }
    }

    /// Number of views `M`.
    pub fn n_views(&self) -> usize {
        self.n_views
    }

    /// Number of joints `N`.
    pub fn n_joints(&self) -> usize {
        self.n_joints
    }

    /// The detection of joint `j` in view `i` as (pixel, confidence), or `None` where it is
    /// missing.
    pub fn get(&self, view: usize, joint: usize) -> Option<(Vector2<f64>, f64)> {
        let k = view * self.n_joints + joint;
        let (p, c) = (self.points[k], self.confidence[k]);
        (p.x.is_finite() && p.y.is_finite() && c > 0.0).then_some((p, c))
    }

    /// The same detections with lens distortion removed: ideal pixels of the same K.
    /// A pixel that no ray through the lens reaches becomes missing.
    #[must_use]
    pub fn undistorted(&self, cameras: &[Camera]) -> Self {
        self.map(|view, p| cameras[view].undistort(p))
    }

    /// The same detections without those with a confidence below `threshold`.
    #[must_use]
    pub fn above(&self, threshold: f64) -> Self {
        let kept = |i, j| self.get(i, j).filter(|(_, c)| *c >= threshold);
        Self::gathered(self.n_views, self.n_joints, kept)
    }

    /// Applies `f(view, pixel)` to every detection; `None` makes it missing.
    pub fn map(&self, f: impl Fn(usize, Vector2<f64>) -> Option<Vector2<f64>>) -> Self {
        let moved = |i, j| self.get(i, j).and_then(|(p, c)| Some((f(i, p)?, c)));
        Self::gathered(self.n_views, self.n_joints, moved)
    }
}
