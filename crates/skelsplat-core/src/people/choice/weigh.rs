//! Which views a body explains, and what that costs.

use wide::f64x4;

use super::figures::{Figures, LANES};
use super::kept::Kept;
use super::rules::{MEDIAN, PROJECTION, Rules, SIZE_COST};
use crate::camera::{Camera, Distortion, NEAR};

/// Farther than any joint.
const FAR: f64x4 = f64x4::splat(f64::INFINITY);
/// A joint that is not known.
const MISSING: f64x4 = f64x4::splat(f64::NAN);

/// A body, projected and compared; its memory serves all bodies of a frame.
#[derive(Debug, Default)]
pub(super) struct Hypothesis {
    /// Coordinates of its joints in the world; NaN where unknown.
    pub(super) joints: Vec<[f64x4; 3]>,
    /// The figure of each view, if it is explained.
    pub(super) figures: Vec<Option<usize>>,
    /// Registers that were compared.
    pub(super) work: usize,
    pixels: Vec<[f64x4; 2]>,
    /// Squared distances from the figures of the explained views, those of the last figure at the
    /// end.
    squares: Vec<f64x4>,
    explained: Vec<Distances>,
    errors: Vec<f64>,
}

/// Squared distances of joints from those of a figure.
#[derive(Debug, Clone, Copy)]
struct Distances {
    start: usize,
    /// How many are known.
    known: usize,
    gate: f64,
}

impl Hypothesis {
    /// Explains every view by its nearest figure, those of `last` at the end; the cost. `None` if
    /// fewer than two views are explained, or if it is of no interest to those that are kept.
    pub(super) fn weighed(
        &mut self,
        figures: &Figures,
        cameras: &[Camera],
        rules: &Rules,
        last: [usize; 2],
        kept: &Kept,
    ) -> Option<f64> {
        let (n, limit) = (cameras.len(), kept.limit());
        self.figures.clear();
        self.figures.resize(n, None);
        self.explained.clear();
        self.squares.clear();
        let (mut unexplained, mut costly) = (0.0, 0);
        for view in (0..n).filter(|view| !last.contains(view)).chain(last) {
            match self.nearest(figures, view, &cameras[view], rules) {
                Some((figure, distances)) => {
                    self.figures[view] = Some(figure);
                    self.explained.push(distances);
                    costly += usize::from(!self.is_below(&distances, limit - unexplained));
                }
                None => unexplained += 1.0,
            }
            // If most errors are above what is left of the limit, so is their median.
            if unexplained > limit || 2 * costly > n {
                return None;
            }
        }
        if self.explained.len() < 2 {
            return None;
        }
        let n = self.explained.len();
        let size: f64 = self.figures.iter().flatten().map(|k| figures.all[*k].share).sum();
        let cost = unexplained + SIZE_COST * (1.0 - size / n as f64);
        let left = kept.cost(&self.figures) - cost;
        if 2 * self.explained.iter().filter(|far| !self.is_below(far, left)).count() > n {
            return None;
        }
        let mut errors = std::mem::take(&mut self.errors);
        errors.clear();
        errors.extend(self.explained.iter().map(|distances| self.error(distances)));
        let cost = cost + median(&mut errors);
        self.errors = errors;
        Some(cost)
    }

    /// The figure of a view with the smallest error below 1, which is a part of the gate.
    fn nearest(
        &mut self,
        figures: &Figures,
        view: usize,
        camera: &Camera,
        rules: &Rules,
    ) -> Option<(usize, Distances)> {
        let gate = rules.gates_px[view];
        let [low, high] = self.project(camera);
        self.work += figures.views[view].len();
        let mut best: Option<(usize, Distances)> = None;
        for k in figures.views[view].clone() {
            let figure = &figures.all[k];
            // Nothing within the gate of anything.
            let outside = |axis: usize| {
                figure.low[axis] > high[axis] + gate || figure.high[axis] < low[axis] - gate
            };
            if outside(0) || outside(1) {
                continue;
            }
            for mirrored in [false, true] {
                if mirrored && !figures.has_sides {
                    break;
                }
                let Some(new) = self.compare(figures.pixels(k, mirrored), gate, rules.min_joints)
                else {
                    continue;
                };
                self.work += MEDIAN * usize::from(best.is_some()) * self.pixels.len();
                if best.is_none_or(|(_, old)| self.is_nearer(&new, &old)) {
                    best = Some((k, new));
                }
            }
        }
        best
    }

    /// Projects all joints into a view; the corners of the box around them.
    fn project(&mut self, camera: &Camera) -> [[f64; 2]; 2] {
        let (r, t) = (camera.rotation(), camera.translation());
        let ([fx, fy], [cx, cy]) = (camera.focal(), camera.principal_point());
        let (mut left, mut top) = (FAR, FAR);
        let (mut right, mut bottom) = (-FAR, -FAR);
        self.pixels.clear();
        for &[x, y, z] in &self.joints {
            let row = |k: usize| x * r[(k, 0)] + y * r[(k, 1)] + z * r[(k, 2)] + t[k];
            let depth = row(2);
            let over = depth.simd_gt(f64x4::splat(NEAR)).bitselect(f64x4::ONE / depth, MISSING);
            let (u, v) = through(camera.distortion(), row(0) * over, row(1) * over);
            let (u, v) = (u * fx + cx, v * fy + cy);
            left = u.simd_lt(left).bitselect(u, left);
            right = u.simd_gt(right).bitselect(u, right);
            top = v.simd_lt(top).bitselect(v, top);
            bottom = v.simd_gt(bottom).bitselect(v, bottom);
            self.pixels.push([u, v]);
        }
        self.work += PROJECTION * self.pixels.len();
        [[least(left), least(top)], [-least(-right), -least(-bottom)]]
    }

    /// Distances from a figure; `None` if their median is above the gate, or with too few joints.
    #[inline]
    fn compare(
        &mut self,
        [x, y]: [&[f64x4]; 2],
        gate: f64,
        min_joints: usize,
    ) -> Option<Distances> {
        let start = self.squares.len();
        let (mut known, mut below) = (f64x4::ZERO, f64x4::ZERO);
        let gate2 = f64x4::splat(gate * gate);
        for (g, [u, v]) in self.pixels.iter().enumerate() {
            let (x, y) = (*u - x[g], *v - y[g]);
            let square = x * x + y * y;
            known += square.simd_lt(FAR) & f64x4::ONE;
            below += square.simd_lt(gate2) & f64x4::ONE;
            self.squares.push(square);
        }
        self.work += self.pixels.len();
        let (known, below) = (known.reduce_add() as usize, below.reduce_add() as usize);
        let distances = Distances { start, known, gate };
        let enough = known >= min_joints.max(1);
        // Of an even number, the median is the mean of the two in the middle.
        if enough && (2 * below > known || (2 * below == known && self.error(&distances) < 1.0)) {
            return Some(distances);
        }
        self.squares.truncate(start);
        None
    }

    fn of(&self, distances: &Distances) -> &[f64x4] {
        &self.squares[distances.start..distances.start + self.joints.len()]
    }

    /// How many distances are below a part of the gate.
    fn below(&self, distances: &Distances, part: f64) -> usize {
        let limit = f64x4::splat((distances.gate * part).powi(2));
        count(self.of(distances), |square| square.simd_lt(limit)) as usize
    }

    /// Whether the error may be below `part`.
    fn is_below(&self, distances: &Distances, part: f64) -> bool {
        // Those that are explained are below 1.
        part > 1.0 || part > 0.0 && self.below(distances, part) > (distances.known - 1) / 2
    }

    /// Whether the error of `new` is smaller than that of `old`, of the same view.
    fn is_nearer(&self, new: &Distances, old: &Distances) -> bool {
        for part in [0.125, 0.25, 0.5] {
            let [new, old] =
                [new, old].map(|distances| (self.below(distances, part), distances.known));
            let [is_new, is_old] = [new, old].map(|(below, known)| 2 * below > known);
            let [may_new, may_old] = [new, old].map(|(below, known)| below > (known - 1) / 2);
            if (is_new && !may_old) || (is_old && !may_new) {
                return is_new;
            }
        }
        self.error(new) < self.error(old)
    }

    /// Median distance, as a part of the gate.
    fn error(&self, distances: &Distances) -> f64 {
        let (all, last) = (self.of(distances), distances.known - 1);
        let n = last.div_ceil(2) as f64;
        let high = nth(all, n, distances.gate * distances.gate);
        // Of an even number, the other in the middle is the largest below, unless they are equal.
        let is_other =
            last % 2 == 1 && count(all, |squares| squares.simd_lt(f64x4::splat(high))) == n;
        let low = if is_other { largest(all, high) } else { high };
        0.5 * (low.sqrt() + high.sqrt()) / distances.gate
    }
}

/// Normalised coordinates through a lens.
fn through(lens: &Distortion, x: f64x4, y: f64x4) -> (f64x4, f64x4) {
    if lens.is_none() {
        return (x, y);
    }
    let (x, y) = (x.to_array(), y.to_array());
    let mut out = [[0.0; LANES]; 2];
    for k in 0..LANES {
        [out[0][k], out[1][k]] = lens.distort(&[x[k], y[k]].into()).into();
    }
    (f64x4::new(out[0]), f64x4::new(out[1]))
}

fn least(all: f64x4) -> f64 {
    let [a, b, c, d] = all.to_array();
    a.min(b).min(c.min(d))
}

#[inline]
fn count(all: &[f64x4], is: impl Fn(&f64x4) -> f64x4) -> f64 {
    let mut sum = f64x4::ZERO;
    for group in all {
        sum += is(group) & f64x4::ONE;
    }
    sum.reduce_add()
}

/// The number that n are below, of those that are not NaN and not negative; `limit` is above it, or
/// not far below.
///
/// Bounds around it close in on where it would be if those between them were evenly spread: no
/// branch depends on a single one.
fn nth(all: &[f64x4], n: f64, limit: f64) -> f64 {
    let below = |limit: f64| count(all, |squares| squares.simd_lt(f64x4::splat(limit)));
    let (mut low, mut high) = ((0.0, 0.0), (limit, below(limit)));
    while high.1 <= n {
        (low, high) = (high, (4.0 * high.0, below(4.0 * high.0)));
    }
    for step in 1.. {
        let part = if step % 4 == 0 { 0.5 } else { (n + 0.5 - low.1) / (high.1 - low.1) };
        let at = low.0 + (high.0 - low.0) * part;
        // It is alone between the bounds, or equal to all that are.
        if high.1 == n + 1.0 || !(low.0 < at && at < high.0) {
            break;
        }
        let fewer = below(at);
        *(if fewer > n { &mut high } else { &mut low }) = (at, fewer);
    }
    largest(all, high.0)
}

/// The largest number below a limit, of those that are not negative.
fn largest(all: &[f64x4], limit: f64) -> f64 {
    let limit = f64x4::splat(limit);
    let mut largest = f64x4::ZERO;
    for group in all {
        largest = largest.fast_max(group.simd_lt(limit) & *group);
    }
    -least(-largest)
}

/// The median of at least one finite number.
pub(super) fn median(values: &mut [f64]) -> f64 {
    let last = values.len() - 1;
    let (lower, high, _) = values.select_nth_unstable_by(last.div_ceil(2), f64::total_cmp);
    let high = *high;
    match last % 2 {
        0 => high,
        _ => (lower.iter().copied().fold(f64::NEG_INFINITY, f64::max) + high) / 2.0,
    }
}
