//! Triangulation from the views that agree: random sample consensus over pairs of views.

use nalgebra::Vector3;

use crate::camera::Camera;
use crate::detections::Detections;

use super::Triangulated;
use super::dlt::point;

/// At most this many pairs of views are tried per joint: all pairs of up to five views.
pub const ITERATIONS: usize = 10;
/// A view agrees with a point that projects at most this far from its detection, in ideal pixels.
pub const INLIER_PX: f64 = 20.0;

/// Triangulates each joint from the largest set of views that agree on it (Fischler and Bolles,
/// 1981).
///
/// Two views make a hypothesis by [`dlt()`](super::dlt()); its inliers are the views that have the
/// point in front of them and detect it at most [`INLIER_PX`] away. The hypothesis with the most
/// inliers wins; ties go to the smaller sum of errors, then to the first. The joint is
/// [`dlt()`](super::dlt()) over its inliers. All pairs are tried if there are at most
/// [`ITERATIONS`], else as many different ones, drawn by a generator seeded with the joint's index:
/// the result depends only on the arguments.
///
/// A detection outside the winning set is rejected. Where no hypothesis has two inliers, or they do
/// not determine the point, the joint is [`dlt()`](super::dlt()) over all its views and nothing is
/// rejected. NaN as there.
///
/// `detections` are ideal pixels.
pub fn ransac(detections: &Detections, cameras: &[Camera]) -> Triangulated {
    let (m, n) = (detections.n_views(), detections.n_joints());
    let mut rejected = vec![false; m * n];
    let mut views = Vec::with_capacity(m);
    let points = (0..n)
        .map(|joint| {
            views.clear();
            views.extend((0..m).filter(|&i| detections.get(i, joint).is_some()));
            let seen = JointViews { cameras, detections, joint, views: &views };
            let Some((point, hypothesis)) = seen.consensus() else {
                return point(detections, cameras, joint, |_| true);
            };
            for &i in &views {
                rejected[i * n + joint] = seen.inlier_error(i, &hypothesis).is_none();
            }
            point
        })
        .collect();
    Triangulated { points, rejected }
}

/// One joint and the views that detect it.
struct JointViews<'a> {
    cameras: &'a [Camera],
    detections: &'a Detections,
    joint: usize,
    views: &'a [usize],
}

impl JointViews<'_> {
    /// The point over the inliers of the best hypothesis, and that hypothesis.
    fn consensus(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let mut best: Option<(Vector3<f64>, usize, f64)> = None;
        let n = self.views.len();
        sampled_pairs(n * n.saturating_sub(1) / 2, self.joint, |pair| {
            let x = self.hypothesis(pair);
            let (count, error) = self.support(&x);
            let better = best.is_none_or(|(_, c, e)| count > c || (count == c && error < e));
            if count >= 2 && better {
                best = Some((x, count, error));
            }
        });
        let (x, _, _) = best?;
        let inlier = |i| self.inlier_error(i, &x).is_some();
        let point = point(self.detections, self.cameras, self.joint, inlier);
        point.iter().all(|v| v.is_finite()).then_some((point, x))
    }

    /// The point triangulated from the two views of a pair.
    fn hypothesis(&self, pair: usize) -> Vector3<f64> {
        let (a, b) = pair_of(pair);
        let (a, b) = (self.views[a], self.views[b]);
        point(self.detections, self.cameras, self.joint, |i| i == a || i == b)
    }

    /// Number and summed error of a point's inliers.
    fn support(&self, x: &Vector3<f64>) -> (usize, f64) {
        let errors = self.views.iter().filter_map(|&i| self.inlier_error(i, x));
        errors.fold((0, 0.0), |(count, sum), error| (count + 1, sum + error))
    }

    /// The reprojection error in a view, or `None` if the view does not agree with the point.
    fn inlier_error(&self, view: usize, x: &Vector3<f64>) -> Option<f64> {
        let (pixel, _) = self.detections.get(view, self.joint)?;
        let error = (self.cameras[view].project_ideal(x)? - pixel).norm();
        (error <= INLIER_PX).then_some(error)
    }
}

/// Pair `k` of (0, 1), (0, 2), (1, 2), (0, 3), …: `b (b−1)/2` pairs have a later member below `b`.
fn pair_of(k: usize) -> (usize, usize) {
    let mut b = 1;
    while b * (b + 1) / 2 <= k {
        b += 1;
    }
    (k - b * (b - 1) / 2, b)
}

/// Calls `visit` with each of `n` pairs, or with [`ITERATIONS`] different ones if there are more.
///
/// Floyd's sampling: of `0..=last`, for each of the last few values of `last`, a number at random,
/// or `last` itself if that number has been drawn before. Every subset is equally likely.
fn sampled_pairs(n: usize, joint: usize, mut visit: impl FnMut(usize)) {
    if n <= ITERATIONS {
        (0..n).for_each(visit);
        return;
    }
    let mut random = SplitMix64(joint as u64);
    let mut drawn = [usize::MAX; ITERATIONS];
    for k in 0..ITERATIONS {
        let last = n - ITERATIONS + k;
        let candidate = random.below(last + 1);
        drawn[k] = if drawn[..k].contains(&candidate) { last } else { candidate };
        visit(drawn[k]);
    }
}

/// `SplitMix64` (Steele, Lea and Flood, 2014).
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `n`, by the remainder; its bias, n / 2⁶⁴, is negligible.
    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}
