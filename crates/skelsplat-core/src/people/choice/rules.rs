//! What a choice depends on.

/// Of two equal explanations, the larger figures win by this much.
pub(super) const SIZE_COST: f64 = 1e-3;
/// A pair of figures proposes nothing if their rays miss each other by this many gates, in the
/// median.
pub(super) const MISSED: f64 = 1.5;
/// The usual [`Rules::most_work`]: a quarter of a second.
pub const MOST_WORK: usize = 48_000_000;
/// Work of a triangulation, compared with that of a distance.
pub(super) const TRIANGULATION: usize = 16;
/// Work of a projection, compared with that of a distance.
pub(super) const PROJECTION: usize = 4;
/// Work of a median, compared with that of a distance.
pub(super) const MEDIAN: usize = 8;

/// What a choice depends on besides figures and cameras.
#[derive(Debug, Clone)]
pub struct Rules {
    /// Per view, the largest median distance, pixels.
    pub gates_px: Vec<f64>,
    /// Detections below it are not used.
    pub min_confidence: f64,
    /// Joints that two figures, or a body and a figure, must have in common.
    pub min_joints: usize,
    /// Place of every joint's mirror image: a figure may have left and right exchanged.
    pub mirror: Vec<usize>,
    /// Choices of a frame that are kept, and by how much they may cost more than the cheapest.
    pub most: usize,
    /// See `most`.
    pub worse: f64,
    /// Work on a frame, in distances of four joints: a quarter for pairs of figures, the rest for
    /// what they propose.
    pub most_work: usize,
}
