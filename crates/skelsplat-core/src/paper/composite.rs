//! The ablation's shared channel: joints composited front to back by depth, as 3D Gaussian
//! splatting does.
//!
//! C(p) = Σ_j a_j T_j with T_j = ∏ (1 − a_l) over the joints l nearer than j. Walking back to front
//! with S_j = Σ_{l behind j} a_l T_l,
//!
//! ```text
//! ∂C/∂a_j = T_j − S_j / (1 − a_j)
//! ```
//!
//! since every term behind j holds the factor (1 − a_j); a ≤ 0.99 bounds the divisor away from
//! zero. The pseudo ground truth is the sum of the joints' heat maps, scaled to peak 1. Canvases
//! cover the person's window, never the whole image. This path is for ablations and uses only
//! doubles. Once `cancel` is set, no further row is rendered and the result is invalid.

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::Vector2;

use super::masked_l2::Moments;
use super::pseudo_gt::fill;
use super::rows::{Pixel, RowTable};
use super::splat::{ALPHA_MAX, Span, Splat};

/// Doubles on a window of pixels, zero elsewhere.
#[derive(Debug, Clone, Default)]
pub struct Canvas {
    /// Rows of the window.
    pub rows: Span,
    /// Columns of the window.
    pub columns: Span,
    values: Vec<f64>,
}

impl Canvas {
    /// Resizes this canvas to `rows` × `columns`, filled with `value`.
    pub fn reset(&mut self, rows: Span, columns: Span, value: f64) {
        (self.rows, self.columns) = (rows, columns);
        self.values.clear();
        self.values.resize(rows.len() * columns.len(), value);
    }

    /// The pixels `span` of row `v`, both inside the window.
    pub fn line(&mut self, v: i32, span: Span) -> &mut [f64] {
        let start = self.index(v, span.start);
        &mut self.values[start..start + span.len()]
    }

    fn index(&self, v: i32, u: i32) -> usize {
        let at = |a: i32, b: i32| usize::try_from(a - b).unwrap_or(0);
        at(v, self.rows.start) * self.columns.len() + at(u, self.columns.start)
    }

    fn at(&self, v: i32, u: i32) -> f64 {
        let inside = self.rows.contains(v) && self.columns.contains(u);
        if inside { self.values[self.index(v, u)] } else { 0.0 }
    }

    /// All values, row by row.
    pub fn values(&self) -> &[f64] {
        &self.values
    }
}

/// Canvases of a [`Composite`].
const CANVASES: usize = 4;

/// One view's shared channel: its pseudo ground truth and the buffers of the compositing.
#[derive(Debug, Clone, Default)]
pub struct Composite {
    pub(super) pseudo: Canvas,
    /// C − P after [`Composite::compare`].
    difference: Canvas,
    transmittance: Canvas,
    behind: Canvas,
    line: Vec<f64>,
}

/// The smallest window that holds all splats.
fn hull<'a>(splats: impl Iterator<Item = &'a Splat>) -> (Span, Span) {
    splats.fold((Span::default(), Span::default()), |(rows, columns), s| {
        if s.rows.is_empty() || s.columns.is_empty() {
            return (rows, columns);
        }
        (rows.hull(s.rows), columns.hull(s.columns))
    })
}

/// Bytes of the buffers for the shared channel of `splats`.
pub fn bytes<'a>(splats: impl Iterator<Item = &'a Splat>) -> u128 {
    let (rows, columns) = hull(splats);
    (CANVASES * size_of::<f64>()) as u128 * rows.len() as u128 * columns.len() as u128
}

/// Calls `visit(v, span, a)` for every covered row of `splat` with its values, cut at `limit`,
/// until `cancel` is set. `line` is the buffer for the values.
pub(super) fn each_row<P: Pixel>(
    splat: &Splat,
    limit: f64,
    line: &mut Vec<P>,
    cancel: &AtomicBool,
    mut visit: impl FnMut(i32, Span, &[P]),
) {
    let table = RowTable::new(splat.conic[(0, 0)]);
    for (v, row) in splat.covered_rows() {
        if cancel.load(Ordering::Relaxed) {
            return;
        }
        line.clear();
        line.resize(row.span.len(), P::zero());
        fill(&table, splat, &row, line);
        line.iter_mut().for_each(|a| *a = a.min(P::of(limit)));
        visit(v, row.span, line);
    }
}

impl Composite {
    /// Sets the pseudo ground truth from the detections' heat maps: their sum, scaled to peak 1.
    pub fn new(heats: &[Splat], cancel: &AtomicBool) -> Self {
        let mut out = Self::default();
        let (rows, columns) = hull(heats.iter());
        out.pseudo.reset(rows, columns, 0.0);
        for heat in heats {
            each_row(heat, 1.0, &mut out.line, cancel, |v, span, values| {
                let target = out.pseudo.line(v, span);
                target.iter_mut().zip(values).for_each(|(t, p)| *t += p);
            });
        }
        let peak = out.pseudo.values.iter().copied().fold(0.0, f64::max);
        if peak > 0.0 {
            out.pseudo.values.iter_mut().for_each(|p| *p /= peak);
        }
        out
    }

    /// Composites `splats`, nearest first, and compares with the pseudo ground truth: Σ (C−P)² over
    /// the union mask, and its number of pixels, where C or P is not zero.
    pub fn compare(&mut self, splats: &[Splat], cancel: &AtomicBool) -> (f64, u32) {
        self.forward(splats, cancel);
        let Self { pseudo, difference, .. } = self;
        let (rows, columns) = (difference.rows, difference.columns);
        let mut mask = 0;
        for v in rows.start..rows.end {
            for (u, c) in (columns.start..columns.end).zip(difference.line(v, columns)) {
                let p = pseudo.at(v, u);
                mask += u32::from(p > 0.0 || *c > 0.0);
                *c -= p;
            }
        }
        (self.difference.values.iter().map(|d| d * d).sum(), mask)
    }

    /// C in `difference`, and the transmittance behind all joints in `transmittance`.
    fn forward(&mut self, splats: &[Splat], cancel: &AtomicBool) {
        let (rows, columns) = hull(splats.iter());
        let rows = rows.hull(self.pseudo.rows);
        let columns = columns.hull(self.pseudo.columns);
        self.difference.reset(rows, columns, 0.0);
        self.transmittance.reset(rows, columns, 1.0);
        self.behind.reset(rows, columns, 0.0);
        for splat in splats {
            each_row(splat, ALPHA_MAX, &mut self.line, cancel, |v, span, values| {
                let colour = self.difference.line(v, span).iter_mut();
                let light = self.transmittance.line(v, span).iter_mut();
                for ((c, t), a) in colour.zip(light).zip(values) {
                    *c += *t * a;
                    *t *= 1.0 - a;
                }
            });
        }
    }

    /// Moments of every splat after [`Composite::compare`] with the same `splats`, nearest first;
    /// passes them to `give(index, moments)`, farthest first.
    pub fn backward(
        &mut self,
        splats: &[Splat],
        cancel: &AtomicBool,
        mut give: impl FnMut(usize, Moments),
    ) {
        for (k, splat) in splats.iter().enumerate().rev() {
            let mut moments = Moments::default();
            each_row(splat, ALPHA_MAX, &mut self.line, cancel, |v, span, values| {
                let difference = self.difference.line(v, span).iter();
                let light = self.transmittance.line(v, span).iter_mut();
                let behind = self.behind.line(v, span).iter_mut();
                let mut x = Vector2::new(f64::from(span.start), f64::from(v)) - splat.mean;
                for (((a, d), t), s) in values.iter().zip(difference).zip(light).zip(behind) {
                    let before = *t / (1.0 - a);
                    if *a < ALPHA_MAX {
                        moments.add(d * (before - *s / (1.0 - a)) * a, x);
                    }
                    *s += a * before;
                    *t = before;
                    x.x += 1.0;
                }
            });
            give(k, moments);
        }
    }

    /// The composite of `splats`, nearest first, on the window that holds them.
    pub fn render(splats: &[Splat], cancel: &AtomicBool) -> Canvas {
        let mut out = Self::default();
        out.forward(splats, cancel);
        out.difference
    }
}
