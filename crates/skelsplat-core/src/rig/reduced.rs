//! The reduced equations of the cameras by clusters of detections, and how far these scatter the
//! solution.
//!
//! Errors are independent neither over time, since detectors err in the same direction for seconds,
//! nor quite over joints, which move together. The scatter is therefore that of two-way clusters:
//! by leaving out joints, and by what leaving out parts of the recording adds to it (Cameron,
//! Gelbach and Miller 2011).

use nalgebra::{DMatrix, DVector};

/// Fewer parts of a recording say nothing about errors that joints have in common for a while.
const LEAST_PARTS: usize = 5;
/// Most parts into which a recording is divided; their errors count as independent.
const MOST_PARTS: usize = 12;

/// The equations of the cameras from a part of the detections, joints eliminated.
#[derive(Debug, Clone, PartialEq)]
pub struct Reduced {
    /// S.
    pub matrix: DMatrix<f64>,
    /// s.
    pub gradient: DVector<f64>,
    /// What the detections cost, mm².
    pub cost: f64,
    /// Sums over the detections of W, and of W (1 − |e|²/4σ²): its mean over directions with the
    /// curvature of the kernel itself.
    pub weights: [f64; 2],
}

impl Reduced {
    pub(super) fn nothing(q: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(q, q),
            gradient: DVector::zeros(q),
            cost: 0.0,
            weights: [0.0; 2],
        }
    }

    /// The equations of all clusters together.
    pub fn sum<'a>(clusters: impl IntoIterator<Item = &'a Self>) -> Self {
        let mut all = clusters.into_iter();
        let Some(mut sum) = all.next().cloned() else { return Self::nothing(0) };
        all.for_each(|cluster| sum.add(cluster));
        sum
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.matrix += &other.matrix;
        self.gradient += &other.gradient;
        self.cost += other.cost;
        self.weights = [0, 1].map(|k| self.weights[k] + other.weights[k]);
    }
}

/// What a solution costs, and how sure it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Judged {
    /// Cost of every cluster.
    pub costs: Vec<f64>,
    /// Covariance of the unknowns: for tests, which know its degrees of freedom. Infinite with a
    /// single cluster.
    pub covariance: DMatrix<f64>,
    /// The same from the size of all its elements: for error bars.
    pub steady: DMatrix<f64>,
    /// What costs count in logarithms of odds, as errors last: κ/φ, mm⁻².
    pub evidence: f64,
    /// Cost of every cluster without the errors of detections that last: of clocks; empty where
    /// none is free.
    pub moving: Vec<f64>,
}

impl Judged {
    /// Nothing is known of q unknowns.
    pub fn unknown(costs: Vec<f64>, q: usize) -> Self {
        let covariance = DMatrix::from_diagonal_element(q, q, f64::INFINITY);
        Self { costs, steady: covariance.clone(), covariance, evidence: 0.0, moving: Vec::new() }
    }

    /// With clocks as another solution judges them: the unknowns for which `is_clock` holds.
    pub(super) fn timed(self, clocks: Self, is_clock: &[bool]) -> Self {
        let q = is_clock.len();
        let place: Vec<usize> = (0..q)
            .map(|k| is_clock[..k].iter().filter(|other| **other == is_clock[k]).count())
            .collect();
        let joined = |places: &DMatrix<f64>, times: &DMatrix<f64>| {
            DMatrix::from_fn(q, q, |a, b| match (is_clock[a], is_clock[b]) {
                (true, true) => times[(place[a], place[b])],
                (false, false) => places[(place[a], place[b])],
                _ => 0.0,
            })
        };
        Self {
            covariance: joined(&self.covariance, &clocks.covariance),
            steady: joined(&self.steady, &clocks.steady),
            costs: self.costs,
            evidence: self.evidence,
            moving: clocks.costs,
        }
    }
}

/// The equations of every cluster, of all parts of the recording.
pub(super) fn summed(cells: &[Vec<Reduced>]) -> Vec<Reduced> {
    let count = cells.first().map_or(0, Vec::len);
    (0..count).map(|k| Reduced::sum(cells.iter().map(|part| &part[k]))).collect()
}

/// Scatter of the solution by leaving out one of the clusters after the other; `None` if fewer than
/// two say anything, or one says all.
pub(super) fn jackknife<'a>(
    whole: &DMatrix<f64>,
    clusters: impl IntoIterator<Item = &'a Reduced>,
) -> Option<DMatrix<f64>> {
    let there = clusters.into_iter().filter(|cluster| cluster.matrix.trace() > 0.0);
    let moved: Option<Vec<DVector<f64>>> = there
        .map(|cluster| Some((whole - &cluster.matrix).cholesky()?.solve(&cluster.gradient)))
        .collect();
    let moved = moved.filter(|all| all.len() > 1)?;
    let (q, g) = (whole.nrows(), moved.len() as f64);
    let scatter = moved.iter().fold(DMatrix::zeros(q, q), |sum, d| sum + d * d.transpose());
    Some(scatter * ((g - 1.0) / g))
}

/// What errors that joints have in common for a while add to their scatter: that of leaving out
/// parts of the recording, less that of leaving out a joint in a part, where it is positive
/// (two-way clusters).
pub(super) fn lasting(whole: &DMatrix<f64>, cells: &[Vec<Reduced>]) -> DMatrix<f64> {
    let q = whole.nrows();
    let parts: Vec<Vec<Reduced>> =
        cells.chunks(cells.len().div_ceil(MOST_PARTS).max(1)).map(summed).collect();
    let none = || DMatrix::zeros(q, q);
    if parts.len() < LEAST_PARTS {
        return none();
    }
    let of_parts: Vec<Reduced> = parts.iter().map(Reduced::sum).collect();
    let both = (jackknife(whole, &of_parts), jackknife(whole, parts.iter().flatten()));
    let ((Some(of_parts), Some(of_cells)), Some(factor)) = (both, whole.clone().cholesky()) else {
        return none();
    };
    // In units of what each direction is known by, in which turns and movements compare.
    let lower = factor.l();
    let scaled = lower.transpose() * (of_parts - of_cells) * &lower;
    let mut more = scaled.symmetric_eigen();
    more.eigenvalues.apply(|value| *value = value.max(0.0));
    let Some(back) = lower.try_inverse() else { return none() };
    back.transpose() * more.recompose() * back
}
