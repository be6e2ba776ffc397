//! The radius at which a radial model stops being one-to-one, and its inverse up to there.

/// Largest r² considered: rays 89.99° off the axis.
const MAX_SQUARED_RADIUS: f64 = 1e8;
/// Every second step at least halves the bracket or the error, both down to rounding well before
/// this many.
const MAX_STEPS: usize = 200;

/// Radius at which r·n(r²)/d(r²) first turns back or meets a pole; infinite if it never does.
/// The derivative's sign is that of n d + 2q (n' d − n d').
pub(super) fn rational(n: &[f64; 4], d: &[f64; 4]) -> f64 {
    let mut slope = [0.0; 7];
    for (i, a) in n.iter().enumerate() {
        for (j, b) in d.iter().enumerate() {
            slope[i + j] += a * b * (1.0 + 2.0 * (i as f64 - j as f64));
        }
    }
    let turn = first_sign_change(&slope, MAX_SQUARED_RADIUS).unwrap_or(f64::INFINITY);
    // Just inside the pole, where the value is still finite.
    let pole = first_sign_change(d, MAX_SQUARED_RADIUS).unwrap_or(f64::INFINITY) * (1.0 - 1e-9);
    turn.min(pole).sqrt()
}

/// Smallest q in (0, limit) where Σ cᵢ qⁱ changes sign.
pub(super) fn first_sign_change(c: &[f64], limit: f64) -> Option<f64> {
    sign_changes(c, limit).first().copied()
}

/// Every sign change, one at most between neighbouring ones of the derivative.
fn sign_changes(c: &[f64], limit: f64) -> Vec<f64> {
    if c.len() < 2 {
        return Vec::new();
    }
    let derivative: Vec<f64> = c.iter().enumerate().skip(1).map(|(i, v)| i as f64 * v).collect();
    let mut ends = vec![0.0];
    ends.extend(sign_changes(&derivative, limit));
    ends.push(limit);
    ends.windows(2).filter_map(|w| bisect(c, w[0], w[1])).collect()
}

fn bisect(c: &[f64], mut lo: f64, mut hi: f64) -> Option<f64> {
    let positive = |q: f64| c.iter().rev().fold(0.0, |sum, v| sum * q + v) > 0.0;
    let at_lo = positive(lo);
    if at_lo == positive(hi) {
        return None;
    }
    loop {
        let mid = 0.5 * (lo + hi);
        if mid <= lo || mid >= hi {
            return Some(lo);
        }
        if positive(mid) == at_lo {
            lo = mid;
        } else {
            hi = mid;
        }
    }
}

/// The x in [0, max] with g(x) = target, for `g` (value, derivative) that rises there from g(0) =
/// 0: Newton, bisecting where it would leave the bracket or where a step did not halve the error
/// (Newton alone can cycle around an inflection). `None` if the target is not reached.
pub(super) fn invert_rising(g: impl Fn(f64) -> (f64, f64), max: f64, target: f64) -> Option<f64> {
    let (mut lo, mut hi) = (0.0, bracket(&g, max, target)?);
    let mut x = target.min(hi);
    let mut last_error = f64::INFINITY;
    for _ in 0..MAX_STEPS {
        let (value, slope) = g(x);
        let error = value - target;
        if error > 0.0 {
            hi = x;
        } else {
            lo = x;
        }
        let newton = x - error / slope;
        let trusted = newton >= lo && newton <= hi && error.abs() <= 0.5 * last_error;
        let next = if trusted { newton } else { 0.5 * (lo + hi) };
        if (next - x).abs() <= f64::EPSILON * x || (newton - x).abs() <= f64::EPSILON * x {
            return Some(x);
        }
        last_error = error.abs();
        x = next;
    }
    Some(x)
}

fn bracket(g: &impl Fn(f64) -> (f64, f64), max: f64, target: f64) -> Option<f64> {
    let mut hi = if max.is_finite() { max } else { target.max(1.0) };
    while g(hi).0 < target {
        if hi >= max || hi * hi > MAX_SQUARED_RADIUS {
            return None;
        }
        hi *= 2.0;
    }
    Some(hi)
}
