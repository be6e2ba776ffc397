//! How well a figure fits a body, or another view's figure; and who gets which figure.

use nalgebra::Vector3;
use pathfinding::kuhn_munkres::kuhn_munkres;
use pathfinding::matrix::Matrix;

use super::crowd::Figure;
use crate::annealed::rays::meet;

/// Pseudo-joints that do not fit.
const DOUBT: f64 = 1.5;
/// |e|²/σ² from which k is taken to be 0; it is 3·10⁻⁴ there.
const FARTHEST: f64 = 32.0;
/// Scores as whole numbers.
const SCALE: u32 = 1_000_000_000;

/// The score of a figure at a body `(N)`, NaN where unknown, under kernels of width `sigma`; the
/// better one of its two sides, where `mirror` has the mirror image of each joint.
pub fn at_body(figure: &Figure, body: &[Vector3<f64>], sigma: f64, mirror: &[usize]) -> f64 {
    let farthest = FARTHEST * sigma * sigma;
    let score = |side: &dyn Fn(usize) -> usize| {
        let (mut fits, mut all) = (0.0, DOUBT * figure.confidence);
        for (j, ray) in figure.rays.iter().enumerate() {
            let x = &body[side(j)];
            if ray.is_there() && !x.x.is_nan() {
                let offset = ray.offset(x);
                // Most figures are somebody else's: no exp for them.
                if offset.across.norm_squared() < farthest {
                    fits += ray.weight * offset.weight(sigma);
                }
                all += ray.weight;
            }
        }
        if all > 0.0 { fits / all } else { 0.0 }
    };
    let straight = score(&|j| j);
    // The other side is only tried where it can matter: a figure that fits well is not mirrored.
    if mirror.is_empty() || straight > 0.6 {
        return straight;
    }
    straight.max(score(&|j| mirror[j]))
}

/// The score of two figures of different views, and the number of joints whose rays meet.
pub fn of_pair(a: &Figure, b: &Figure, sigma: f64) -> (f64, usize) {
    let (mut fits, mut all, mut common) = (0.0, DOUBT * a.confidence * b.confidence, 0);
    for (p, q) in a.rays.iter().zip(&b.rays) {
        if p.is_there() && q.is_there() {
            let weight = p.weight * q.weight;
            if let Some((_, distance)) = meet(p, q) {
                fits += weight * (-0.25 * (distance / sigma).powi(2)).exp();
                common += 1;
            }
            all += weight;
        }
    }
    (if all > 0.0 { fits / all } else { 0.0 }, common)
}

/// The assignment with the largest sum of scores above `least`: the column of each row, each at
/// most once.
pub fn assign(scores: &[Vec<f64>], least: f64) -> Vec<Option<usize>> {
    let (rows, columns) = (scores.len(), scores.first().map_or(0, Vec::len));
    let gain = |r: usize, c: usize| ((scores[r][c] - least).max(0.0) * f64::from(SCALE)) as i64;
    let mut found = vec![None; rows];
    if (0..rows).all(|r| (0..columns).all(|c| gain(r, c) == 0)) {
        return found;
    }
    // The side with fewer chooses.
    let cell = |(a, b): (usize, usize)| if rows <= columns { (a, b) } else { (b, a) };
    let (few, many) = (rows.min(columns), rows.max(columns));
    let table = Matrix::from_fn(few, many, |at| gain(cell(at).0, cell(at).1));
    for (r, c) in kuhn_munkres(&table).1.into_iter().enumerate().map(cell) {
        found[r] = (gain(r, c) > 0).then_some(c);
    }
    found
}
