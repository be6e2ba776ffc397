//! Medians and odds.

use std::f64::consts::LN_2;

/// Odds of strong evidence (Jeffreys, Theory of Probability, appendix B).
pub(crate) const STRONG: f64 = 10.0;

/// The median, of an even number the upper of the two in the middle; NaN of nothing.
pub(crate) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The variance per axis of normal errors in a plane with this median of their squares.
pub(crate) fn variance_of(median_square: f64) -> f64 {
    median_square / (2.0 * LN_2)
}

/// Sorts by the value of each item and returns the first value up to which half of the weights lie;
/// `of` is the value and the weight of an item. NaN of nothing.
pub(crate) fn weighted_median<T>(items: &mut [T], of: impl Fn(&T) -> (f64, f64)) -> f64 {
    items.sort_by(|a, b| of(a).0.total_cmp(&of(b).0));
    let half = 0.5 * items.iter().map(|item| of(item).1).sum::<f64>();
    let mut sum = 0.0;
    let reaches = |item: &&T| {
        sum += of(item).1;
        sum >= half
    };
    items.iter().find(reaches).map_or(f64::NAN, |item| of(item).0)
}
