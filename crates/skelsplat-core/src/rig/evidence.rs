//! How sure a change of a camera is, and whether one fault explains more than another.

use std::f64::consts::SQRT_2;

use nalgebra::{ArrayStorage, DMatrix, DVector, Matrix3};

use super::placed::{Change, Freedom};
use super::reduced::Judged;

/// Joints agree that one fault explains more than another from this t statistic on: by chance once
/// in twenty cases.
const AGREED: f64 = 1.7;

/// A camera is like the others where the distance of its detections from the joints is at most this
/// multiple of theirs.
pub(super) const ALIKE: f64 = 2.0;

/// The probability that a camera, or all lenses, are not as the calibration says.
pub(super) const CHANGED: f64 = 0.05;

/// What all detections of a view are off by, in multiples of the noise: no recording tells it from
/// a turn of the camera. Hourglass detections on Human3.6M: 0.14 between views, 0.3 with what all
/// views share.
const SHARED: f64 = 0.3;

/// By how much a camera seems turned about each axis of its image because all its detections are
/// off alike, rad. Of the 2 m coordinates of a joint, three place it, so that distances from it
/// are less than the noise.
pub fn shared_turn(noise: f64, reach: f64, views: usize) -> f64 {
    let seen = 2.0 * views as f64;
    SHARED * noise * (seen / (seen - 3.0)).sqrt() / reach
}

/// Adds what a camera seems to be turned by to the covariance of these parameters of it.
fn share(covariance: &mut DMatrix<f64>, parameters: &[usize], turn: f64) {
    for a in (0..parameters.len()).filter(|a| parameters[*a] < 2) {
        covariance[(a, a)] += turn * turn;
    }
}

/// Error bars of a camera's change: root-mean-square length of the error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bars {
    /// Radians.
    pub turn: f64,
    /// mm.
    pub shift: f64,
    /// Covariance of the shift along the axes of the world, mm².
    pub place: Matrix3<f64>,
    /// Of the focal length, relative.
    pub zoom: f64,
    /// Frames.
    pub clock: f64,
}

impl Bars {
    /// Of nothing that was estimated.
    pub const UNKNOWN: Self = Self {
        turn: f64::NAN,
        shift: f64::NAN,
        place: Matrix3::from_array_storage(ArrayStorage([[f64::NAN; 3]; 3])),
        zoom: f64::NAN,
        clock: f64::NAN,
    };

    /// With a turn that all detections of the view share.
    #[must_use]
    pub fn sharing(&self, turn: f64) -> Self {
        Self { turn: self.turn.hypot(SQRT_2 * turn), ..*self }
    }

    /// How far off a camera may be that stays although another place, at this change, fits best:
    /// with the estimate θ̂ ± σ of what is wrong with it, the root mean square of the error is
    /// √(θ̂² + σ²).
    #[must_use]
    pub fn besides(&self, change: &Change) -> Self {
        Self {
            turn: self.turn.hypot(change.turn.norm()),
            shift: self.shift.hypot(change.shift.norm()),
            place: self.place + change.shift * change.shift.transpose(),
            zoom: self.zoom.hypot(change.zoom.ln()),
            clock: self.clock.hypot(change.clock),
        }
    }
}

/// Error bars of one camera.
pub fn bars(covariance: &DMatrix<f64>, unknowns: &[(usize, usize)], view: usize) -> Bars {
    let of = |range: std::ops::Range<usize>| {
        let own = |(i, k): &(usize, usize)| *i == view && range.contains(k);
        let places = (0..unknowns.len()).filter(|q| own(&unknowns[*q]));
        let (n, sum) = places.fold((0, 0.0), |(n, sum), q| (n + 1, sum + covariance[(q, q)]));
        if n > 0 { sum.sqrt() } else { f64::NAN }
    };
    let at = |k: usize| unknowns.iter().position(|unknown| *unknown == (view, k));
    let place = match [3, 4, 5].map(at) {
        [Some(x), Some(y), Some(z)] => {
            Matrix3::from_fn(|a, b| covariance[([x, y, z][a], [x, y, z][b])])
        }
        _ => Bars::UNKNOWN.place,
    };
    Bars { turn: of(0..3), shift: of(3..6), place, zoom: of(6..7), clock: of(7..8) }
}

/// The Wald statistic of a change of what is free in one camera: √(θᵀC⁻¹θ/p), of p parameters and
/// with the covariance from G clusters widened as in Hotelling's test, (G−p)/(G−1), and by the turn
/// that detections share.
pub fn wald(
    judged: &Judged,
    unknowns: &[(usize, usize)],
    view: usize,
    of: Freedom,
    change: &Change,
    shared: f64,
) -> f64 {
    let clusters = judged.costs.len();
    let own: Vec<usize> = of.columns().collect();
    let place = |k: &usize| unknowns.iter().position(|unknown| *unknown == (view, *k));
    let Some(rows) = own.iter().map(place).collect::<Option<Vec<usize>>>() else { return 0.0 };
    let (p, g) = (rows.len(), clusters as f64);
    let mut part = DMatrix::from_fn(p, p, |a, b| judged.covariance[(rows[a], rows[b])]);
    share(&mut part, &own, shared);
    let theta = DVector::from_fn(p, |a, _| change.parameter(own[a]));
    let Some(inverse) = part.try_inverse().filter(|_| clusters > p) else { return 0.0 };
    let square = theta.dot(&(inverse * &theta)) / p as f64;
    (square * (g - p as f64) / (g - 1.0)).max(0.0).sqrt()
}

/// The logarithm of the odds that what is free in one camera has changed: it is as given, or with
/// the probability ε anywhere, θ ~ N(0, V). The solution ± C explains ΔF more, which counts κ/φ:
/// ln ε/(1−ε) + κ ΔF/φ − ½ ln |V|/|C| (Laplace). With a turn T that detections of the view
/// share in either case, C is C + T, and of ΔF the part θᵀ(C + T)⁻¹θ/θᵀC⁻¹θ is left.
pub fn odds_changed(
    [before, after]: [&Judged; 2],
    unknowns: &[(usize, usize)],
    view: usize,
    of: Freedom,
    change: &Change,
    shared: f64,
    prior_sigma: impl Fn(usize) -> f64,
) -> f64 {
    let place = |k: usize| unknowns.iter().position(|unknown| *unknown == (view, k));
    let (own, rows): (Vec<usize>, Vec<usize>) =
        of.columns().filter_map(|k| Some((k, place(k)?))).unzip();
    let alone = DMatrix::from_fn(rows.len(), rows.len(), |a, b| after.steady[(rows[a], rows[b])]);
    let mut part = alone.clone();
    share(&mut part, &own, shared);
    let theta = DVector::from_fn(rows.len(), |a, _| change.parameter(own[a]));
    let square = |c: DMatrix<f64>| Some(theta.dot(&c.cholesky()?.solve(&theta)));
    let left = square(part.clone()).zip(square(alone)).map_or(1.0, |(less, all)| less / all);
    let wide: f64 = of.columns().map(|k| prior_sigma(k).ln()).sum();
    let explained = (total(&before.costs) - total(&after.costs)) * after.evidence * left;
    (CHANGED / (1.0 - CHANGED)).ln() + explained + 0.5 * part.determinant().ln() - wide
}

/// The cost of all clusters.
pub fn total(costs: &[f64]) -> f64 {
    costs.iter().sum()
}

/// Whether clusters agree that costs are higher than others.
pub fn is_worse(costs: &[f64], others: &[f64]) -> bool {
    excess(costs, others) > AGREED
}

/// The logarithm of the odds that a difference of T standard errors over G clusters is not due to
/// chance, ½ G ln(1 + T²/(G − 1)).
pub fn log_odds(t: f64, clusters: usize) -> f64 {
    let g = clusters as f64;
    t.signum() * 0.5 * g * (t * t / (g - 1.0)).ln_1p()
}

/// By how many standard errors the costs of clusters are higher than others (paired); 0 if all are
/// the same.
pub fn excess(costs: &[f64], others: &[f64]) -> f64 {
    let difference: Vec<f64> = costs.iter().zip(others).map(|(a, b)| a - b).collect();
    let n = difference.len() as f64;
    let mean = total(&difference) / n;
    let squares: f64 = difference.iter().map(|d| (d - mean).powi(2)).sum();
    let error = (squares / (n * (n - 1.0).max(1.0))).sqrt();
    if mean == 0.0 { 0.0 } else { mean / error }
}

/// The place up to which an explanation that costs so much `more` than another is the better one.
pub(super) fn turning_point(more: impl IntoIterator<Item = f64>) -> usize {
    let (mut sum, mut least, mut best) = (0.0, 0.0, 0);
    for (k, difference) in more.into_iter().enumerate() {
        sum += difference;
        if sum < least {
            (least, best) = (sum, k + 1);
        }
    }
    best
}
