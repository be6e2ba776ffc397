//! The results: of one frame, and of many with one array per quantity, so that a long recording
//! needs no more memory than its numbers.

use std::iter::{once, zip};
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::frame::Frame;
use crate::error::{Error, Result};
use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason};

/// The quantities: for each its type in one frame, the type of its array, the values that a frame
/// adds to the array, and what such values are in a frame.
macro_rules! columns {
    ($(
        $(#[$doc:meta])*
        $name:ident: $of_frame:ty, $type:ty, |$frame:ident| $values:expr, $of:expr;
    )*) => {
        /// A refined pose, in the unit of the cameras.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Refinement {
            /// Standard deviation per axis of the detector's joints `(N)` from anatomical ones, the
            /// same in all views and frames.
            pub joint_bias: Arc<[f64]>,
            $($(#[$doc])* pub $name: $of_frame,)*
        }

        /// The refined poses of T frames, in the unit of the cameras: the fields of [`Refinement`],
        /// each one row-major array with the frames as its first dimension and the numbers of
        /// vectors and matrices as its last.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Refinements {
            /// Standard deviation per axis of the detector's joints `(N)` from anatomical ones, the
            /// same in all frames.
            pub joint_bias: Arc<[f64]>,
            $($(#[$doc])* pub $name: Vec<$type>,)*
        }

        impl Refinements {
            /// No frame yet, of joints with this bias.
            pub(crate) fn new(joint_bias: Arc<[f64]>) -> Self {
                Self { joint_bias, $($name: Vec::new(),)* }
            }

            /// Adds a frame with as many views and joints as the others.
            pub(crate) fn push(&mut self, frame: &Refinement) {
                $(
                    let $frame = frame;
                    self.$name.extend($values);
                )*
            }

            /// Adds further frames.
            pub(crate) fn append(&mut self, mut other: Self) {
                $(self.$name.append(&mut other.$name);)*
            }

            /// Frame `t`.
            ///
            /// # Panics
            /// If there are not so many.
            pub fn frame(&self, t: usize) -> Refinement {
                let joint_bias = Arc::clone(&self.joint_bias);
                $(
                    let length = self.$name.len() / self.len();
                    let $name = $of(&self.$name[t * length..(t + 1) * length]);
                )*
                Refinement { joint_bias, $($name,)* }
            }
        }
    };
}

columns! {
    /// Joint positions `(N)`; NaN where unobserved.
    pose: Vec<Vector3<f64>>, f64, |frame| numbers(&frame.pose), points;
    /// Splat covariances Σ `(N)`, unit²; not an error bar.
    covariance: Vec<Matrix3<f64>>, f64, |frame| numbers(&frame.covariance), matrices;
    /// Posterior covariances of the positions `(N)`, unit²: the scatter, what another recording of
    /// the same pose by the same detector would give. NaN where unobserved.
    uncertainty: Vec<Matrix3<f64>>, f64, |frame| numbers(&frame.uncertainty), matrices;
    /// Weight k of every detection `(M, N)`: how much it is trusted; NaN where missing.
    view_weights: Vec<f64>, f64, |frame| &frame.view_weights, <[_]>::to_vec;
    /// Detections `(M, N)` that were used with left and right swapped.
    swapped: Vec<bool>, bool, |frame| &frame.swapped, <[_]>::to_vec;
    /// ŝ, standard deviation of the detection noise across the ray, in the unit of the cameras; NaN
    /// without detections.
    noise: f64, f64, |frame| once(frame.noise), only;
    /// The initial pose that was used `(N)`.
    init_pose: Vec<Vector3<f64>>, f64, |frame| numbers(&frame.init_pose), points;
    /// Distance between detection and reprojection `(M, N)`, pixels of the original image; NaN
    /// where there is no detection or no reprojection.
    reprojection_error: Vec<f64>, f64, |frame| &frame.reprojection_error, <[_]>::to_vec;
    /// Reliability of each joint `(N)`.
    joint_status: Vec<JointStatus>, JointStatus, |frame| &frame.joint_status, <[_]>::to_vec;
    /// Loss of the returned pose over all views.
    loss: Loss, Loss, |frame| once(frame.loss), only;
    /// Loss of every step, if requested.
    loss_history: Vec<Loss>, Vec<Loss>, |frame| once(frame.loss_history.clone()), only;
    /// Steps taken.
    n_iter: usize, usize, |frame| once(frame.n_iter), only;
    /// Why the iteration ended.
    stop_reason: StopReason, StopReason, |frame| once(frame.stop_reason), only;
}

impl Refinement {
    /// Covariance of the distance from an anatomical joint `(N)`, unit²: `uncertainty` +
    /// `joint_bias`² I. NaN where unobserved.
    pub fn error_bar(&self) -> Vec<Matrix3<f64>> {
        let bar = |(scatter, bias): (&Matrix3<f64>, &f64)| {
            scatter + Matrix3::from_diagonal_element(bias * bias)
        };
        zip(&self.uncertainty, self.joint_bias.iter()).map(bar).collect()
    }

    /// `outcome` and `bars`, of which `mm` are a unit of the cameras, converted to this unit, which
    /// `joint_bias` already has.
    pub(super) fn new(
        outcome: Outcome,
        bars: &ErrorBars,
        reprojection_error: Vec<f64>,
        joint_bias: Arc<[f64]>,
        mm: f64,
    ) -> Self {
        let n = outcome.points.len();
        let m = outcome.used_for.len() / n.max(1);
        let round = |(x, sigma): (&Vector3<f64>, &f64)| {
            let variance = if x.x.is_nan() { f64::NAN } else { (sigma / mm).powi(2) };
            Matrix3::from_diagonal_element(variance)
        };
        let covariance = match &outcome.splats {
            Splats::Round(sigmas) => outcome.points.iter().zip(sigmas).map(round).collect(),
            Splats::Free(covariances) => covariances.iter().map(|c| c / (mm * mm)).collect(),
        };
        let used_for = || outcome.used_for.iter().enumerate();
        Self {
            pose: outcome.points.iter().map(|p| p / mm).collect(),
            covariance,
            uncertainty: bars.covariances.iter().map(|c| c / (mm * mm)).collect(),
            joint_bias,
            view_weights: used_for().map(|(k, j)| bars.believed[j * m + k / n]).collect(),
            swapped: used_for().map(|(k, j)| *j != k % n).collect(),
            noise: bars.noise / mm,
            init_pose: outcome.init.iter().map(|p| p / mm).collect(),
            reprojection_error,
            joint_status: bars.status.clone(),
            loss: outcome.loss,
            loss_history: outcome.loss_history,
            n_iter: outcome.n_iter,
            stop_reason: outcome.stop_reason,
        }
    }
}

impl Refinements {
    /// Number of frames T.
    pub fn len(&self) -> usize {
        self.noise.len()
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.noise.is_empty()
    }

    /// The frames in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Refinement> {
        (0..self.len()).map(|t| self.frame(t))
    }
}

impl From<Refinement> for Refinements {
    /// One frame.
    fn from(frame: Refinement) -> Self {
        let mut out = Self::new(Arc::clone(&frame.joint_bias));
        out.push(&frame);
        out
    }
}

/// Numbers of views and joints of these frames; zeros without any.
/// Errors: [`Error::InvalidInput`] if they differ.
pub(crate) fn size<'a>(frames: impl IntoIterator<Item = &'a Frame>) -> Result<(usize, usize)> {
    let of = |frame: &Frame| (frame.detections.n_views(), frame.detections.n_joints());
    let mut sizes = frames.into_iter().map(of);
    let (m, n) = sizes.next().unwrap_or_default();
    match sizes.find(|other| *other != (m, n)) {
        None => Ok((m, n)),
        Some((views, joints)) => {
            let expected = format!("{m} views and {n} joints, as in the first frame");
            let actual = format!("{views} views and {joints} joints");
            Err(Error::invalid("detections", expected, actual))
        }
    }
}

/// The numbers of vectors, and of matrices that are symmetric: columns are rows.
pub(crate) fn numbers<'a, T: 'a>(all: &'a [T]) -> impl Iterator<Item = f64> + 'a
where
    &'a T: IntoIterator<Item = &'a f64>,
{
    all.iter().flatten().copied()
}

fn only<T: Clone>(values: &[T]) -> T {
    values[0].clone()
}

fn points(numbers: &[f64]) -> Vec<Vector3<f64>> {
    numbers.chunks_exact(3).map(Vector3::from_column_slice).collect()
}

fn matrices(numbers: &[f64]) -> Vec<Matrix3<f64>> {
    numbers.chunks_exact(9).map(Matrix3::from_column_slice).collect()
}
