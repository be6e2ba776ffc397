//! What became of the cameras.

use super::evidence::Bars;
use super::placed::Change;
use crate::camera::Camera;
use crate::names::named;

/// What became of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraStatus {
    /// It stays as it is.
    Sound,
    /// It was set right.
    Adjusted,
    /// Its clock is off, and nothing else: the camera stays as it is.
    Late,
    /// Its clock changes while it records: it stays.
    Unsteady,
    /// It was moved while it recorded: it stays.
    Knocked,
    /// It or another is wrong, which cannot be told.
    Doubtful,
    /// It sees too little to say, or is one of two cameras only, of which nothing tells which is
    /// wrong.
    Unseen,
}

named!(CameraStatus {
    Sound: "sound",
    Adjusted: "adjusted",
    Late: "late",
    Unsteady: "unsteady",
    Knocked: "knocked",
    Doubtful: "doubtful",
    Unseen: "unseen",
});

/// What is said of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraAdjustment {
    /// What became of it.
    pub status: CameraStatus,
    /// From the given camera to the adjusted one; to the supposed one of a late or doubtful camera,
    /// which is not applied, and to where one is that was moved meanwhile. Lengths in the unit of
    /// the cameras.
    pub change: Change,
    /// Error bars of the change; of a sound camera, how far off it may be all the same.
    pub bars: Bars,
    /// The time from which on its clock or its place is another.
    pub since: Option<usize>,
    /// Median distance of its detections from where the other cameras place the joints, in frames
    /// that were left out, px: as given and as returned.
    pub before: f64,
    /// After.
    pub after: f64,
}

/// Cameras set right.
#[derive(Debug, Clone, PartialEq)]
pub struct RigAdjustment {
    /// Cameras, in the unit of the given ones.
    pub cameras: Vec<Camera>,
    /// One for each.
    pub report: Vec<CameraAdjustment>,
    /// Number of frames on which they were adjusted and judged.
    pub frames: [usize; 2],
}

/// A camera that is another from a time on.
#[derive(Debug, Clone)]
pub struct Changes {
    /// Its view.
    pub view: usize,
    /// The time.
    pub since: usize,
    /// What it is.
    pub status: CameraStatus,
    /// By how much it changes.
    pub change: Change,
    /// Of the change, if known.
    pub bars: Option<Bars>,
}
