//! The results of many frames: one array per quantity, so that a long recording needs no more
//! memory than its numbers.

use std::iter::once;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use super::frame::Frame;
use super::refiner::Refiner;
use super::result::Refinement;
use crate::error::{Error, Result};
use crate::outcome::{JointStatus, Loss, StopReason};

/// The columns: for each its type, the value before it is written, its length per frame of M views
/// and N joints, the values of a frame, and what these are in a frame.
macro_rules! columns {
    ($(
        $(#[$doc:meta])*
        $name:ident: $type:ty = $blank:expr, $length:expr, |$frame:ident| $values:expr, $of:expr;
    )*) => {
        /// The refined poses of T frames, in the unit of the cameras: the fields of [`Refinement`],
        /// each one row-major array.
        #[derive(Debug, Clone, PartialEq)]
        pub struct Refinements {
            frames: usize,
            views: usize,
            joints: usize,
            /// Standard deviation per axis of the detector's joints `(N)` from anatomical ones, the
            /// same in all frames.
            pub joint_bias: Arc<[f64]>,
            $($(#[$doc])* pub $name: Vec<$type>,)*
        }

        impl Refinements {
            fn blank(frames: usize, views: usize, joints: usize, joint_bias: Arc<[f64]>) -> Self {
                $(
                    let length: fn(usize, usize) -> usize = $length;
                    let $name = vec![$blank; frames * length(views, joints)];
                )*
                Self { frames, views, joints, joint_bias, $($name,)* }
            }

            /// Frame `t`.
            ///
            /// # Panics
            /// If there are not so many.
            pub fn frame(&self, t: usize) -> Refinement {
                let joint_bias = Arc::clone(&self.joint_bias);
                $(
                    let length: fn(usize, usize) -> usize = $length;
                    let length = length(self.views, self.joints);
                    let $name = $of(&self.$name[t * length..(t + 1) * length]);
                )*
                Refinement { joint_bias, $($name,)* }
            }

            /// All frames, to write to.
            pub(crate) fn part(&mut self) -> Part<'_> {
                Part { views: self.views, joints: self.joints, $($name: &mut self.$name,)* }
            }
        }

        /// Consecutive frames of [`Refinements`] to write to.
        pub(crate) struct Part<'a> {
            views: usize,
            joints: usize,
            $($name: &'a mut [$type],)*
        }

        impl<'a> Part<'a> {
            /// Number of frames.
            pub(crate) fn len(&self) -> usize {
                self.noise.len()
            }

            /// Splits off the first `frames` frames.
            ///
            /// # Panics
            /// If there are fewer.
            pub(crate) fn take(&mut self, frames: usize) -> Part<'a> {
                let (views, joints) = (self.views, self.joints);
                $(
                    let length: fn(usize, usize) -> usize = $length;
                    let $name = first(&mut self.$name, frames * length(views, joints));
                )*
                Part { views, joints, $($name,)* }
            }

            /// Writes frame `t` of these.
            pub(crate) fn write(&mut self, t: usize, frame: &Refinement) {
                $(
                    let length: fn(usize, usize) -> usize = $length;
                    let length = length(self.views, self.joints);
                    let $frame = frame;
                    put(&mut self.$name[t * length..(t + 1) * length], $values);
                )*
            }
        }
    };
}

columns! {
    /// Joint positions `(T, N, 3)`; NaN where unobserved.
    pose: f64 = 0.0, |_, n| 3 * n, |frame| numbers(&frame.pose), points;
    /// Splat covariances Σ `(T, N, 3, 3)`, unit²; not an error bar.
    covariance: f64 = 0.0, |_, n| 9 * n, |frame| numbers(&frame.covariance), matrices;
    /// Posterior covariances of the positions `(T, N, 3, 3)`, unit²: the scatter. NaN where
    /// unobserved.
    uncertainty: f64 = 0.0, |_, n| 9 * n, |frame| numbers(&frame.uncertainty), matrices;
    /// Weights k of the detections `(T, M, N)`; NaN where missing.
    view_weights: f64 = 0.0, |m, n| m * n,
        |frame| frame.view_weights.iter().copied(), <[_]>::to_vec;
    /// Detections `(T, M, N)` that were used with left and right swapped.
    swapped: bool = false, |m, n| m * n, |frame| frame.swapped.iter().copied(), <[_]>::to_vec;
    /// ŝ `(T)`, standard deviation of the detection noise across the ray; NaN without detections.
    noise: f64 = 0.0, |_, _| 1, |frame| once(frame.noise), only;
    /// The initial poses that were used `(T, N, 3)`.
    init_pose: f64 = 0.0, |_, n| 3 * n, |frame| numbers(&frame.init_pose), points;
    /// Distances between detections and reprojections `(T, M, N)`, pixels of the original image;
    /// NaN where there is none.
    reprojection_error: f64 = 0.0, |m, n| m * n,
        |frame| frame.reprojection_error.iter().copied(), <[_]>::to_vec;
    /// Reliability of the joints `(T, N)`.
    joint_status: JointStatus = JointStatus::Unobserved, |_, n| n,
        |frame| frame.joint_status.iter().copied(), <[_]>::to_vec;
    /// Loss of the returned poses `(T)` over all views.
    loss: Loss = Loss::default(), |_, _| 1, |frame| once(frame.loss), only;
    /// Loss of every step of each frame `(T)`, if requested.
    loss_history: Vec<Loss> = Vec::new(), |_, _| 1, |frame| once(frame.loss_history.clone()), only;
    /// Steps taken `(T)`.
    n_iter: usize = 0, |_, _| 1, |frame| once(frame.n_iter), only;
    /// Why the iterations ended `(T)`.
    stop_reason: StopReason = StopReason::NoObservations, |_, _| 1,
        |frame| once(frame.stop_reason), only;
}

impl Refinements {
    /// Room for the results of `refiner` for these frames.
    /// Errors: [`Error::InvalidInput`] if they differ in the number of views or joints.
    pub(crate) fn room(frames: &[Frame], refiner: &Refiner) -> Result<Self> {
        let (m, n) = size(frames)?;
        Ok(Self::blank(frames.len(), m, n, refiner.joint_bias(n)))
    }

    /// Number of frames T.
    pub fn len(&self) -> usize {
        self.frames
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.frames == 0
    }

    /// The frames in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Refinement> {
        (0..self.frames).map(|t| self.frame(t))
    }
}

impl From<Refinement> for Refinements {
    /// One frame.
    fn from(frame: Refinement) -> Self {
        let n = frame.pose.len();
        let bias = Arc::clone(&frame.joint_bias);
        let mut out = Self::blank(1, frame.view_weights.len() / n.max(1), n, bias);
        out.part().write(0, &frame);
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

/// Splits off the first `n` values.
pub(crate) fn first<'a, T>(values: &mut &'a mut [T], n: usize) -> &'a mut [T] {
    values.split_off_mut(..n).expect("as many values as frames were asked for")
}

/// Overwrites `out` with `values`.
pub(crate) fn put<T>(out: &mut [T], values: impl Iterator<Item = T>) {
    out.iter_mut().zip(values).for_each(|(out, value)| *out = value);
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
