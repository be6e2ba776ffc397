//! Central differences.

/// (f(x + h) − f(x − h)) / 2h for every entry of `x`; the error is O(h²).
pub fn central_differences(x: &[f64], h: f64, mut f: impl FnMut(&[f64]) -> f64) -> Vec<f64> {
    let mut at = x.to_vec();
    (0..x.len())
        .map(|k| {
            at[k] = x[k] + h;
            let above = f(&at);
            at[k] = x[k] - h;
            let below = f(&at);
            at[k] = x[k];
            (above - below) / (2.0 * h)
        })
        .collect()
}

/// Largest |a − b| relative to the largest |b|.
pub fn relative_error(a: &[f64], b: &[f64]) -> f64 {
    let scale = b.iter().fold(f64::MIN_POSITIVE, |m, v| m.max(v.abs()));
    a.iter().zip(b).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) / scale
}
