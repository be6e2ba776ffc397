//! Pseudo ground truth: the heat map of one detection (paper §3 "Supervision from 2D Detections").
//!
//! P(p) = exp(−½ (p−d)ᵀ(Σ²)⁻¹(p−d)) around the sub-pixel detection d with the projected covariance
//! of the *initial* Gaussian, peak 1, zero below 1/255. Built once per pose.

use super::rows::{Group, LANES, Pixel, RowTable};
use super::splat::{Row, Span, Splat};

/// Zero columns on either side, so that the window contains the whole rows of nearby renders.
const MARGIN: i32 = 8;

/// A heat map on a window of pixels, zero elsewhere.
#[derive(Debug, Clone)]
pub struct HeatMap<P> {
    rows: Span,
    columns: Span,
    spans: Vec<Span>,
    values: Vec<P>,
    /// Number of non-zero pixels.
    pub count: u32,
    /// Σ P² over all pixels.
    pub energy: f64,
}

/// Number of pixels in a span, for sums.
pub(super) fn pixels(span: Span) -> u32 {
    u32::try_from(span.len()).unwrap_or(u32::MAX)
}

impl<P> HeatMap<P> {
    /// Bytes of the window of `splat`.
    pub fn bytes(splat: &Splat) -> u128 {
        let width = splat.columns.len() as u128 + 2 * u128::from(MARGIN.unsigned_abs());
        (width * size_of::<P>() as u128 + size_of::<Span>() as u128) * splat.rows.len() as u128
    }
}

impl<P: Pixel> HeatMap<P> {
    /// The heat map of `splat`, with the detection as its mean.
    pub fn new(splat: &Splat) -> Self {
        let (rows, inner) = (splat.rows, splat.columns);
        let columns = Span { start: inner.start - MARGIN, end: inner.end + MARGIN };
        let width = columns.len();
        let mut map = Self {
            rows,
            columns,
            spans: vec![Span::default(); rows.len()],
            values: vec![P::zero(); rows.len() * width + LANES],
            count: 0,
            energy: 0.0,
        };
        let table = RowTable::new(splat.conic[(0, 0)]);
        for (v, row) in splat.covered_rows() {
            let k = map.index(v);
            let offset = usize::try_from(row.span.start - columns.start).unwrap_or(0);
            let line = &mut map.values[k * width + offset..][..row.span.len()];
            fill(&table, splat, &row, line);
            map.energy += line.iter().map(|p| p.wide() * p.wide()).sum::<f64>();
            map.spans[k] = row.span;
            map.count += pixels(row.span);
        }
        map
    }

    fn index(&self, v: i32) -> usize {
        usize::try_from(v - self.rows.start).unwrap_or(usize::MAX)
    }

    /// The non-zero pixels of row `v`.
    pub fn span(&self, v: i32) -> Span {
        self.spans.get(self.index(v)).copied().unwrap_or_default()
    }

    /// The pixels of `span` in row `v`, up to whole groups of [`LANES`]: in place if the window
    /// holds them all, else copied to `line`. What lies beyond the span is unspecified.
    #[inline]
    pub fn groups<'a>(&'a self, v: i32, span: Span, line: &'a mut Vec<P>) -> &'a [P] {
        let at = |a: i32, b: i32| usize::try_from(a - b).unwrap_or(0);
        let row = at(v, self.rows.start) * self.columns.len();
        let place = |u: i32| row + at(u, self.columns.start);
        let length = span.len().next_multiple_of(LANES);
        let is_inside = self.rows.contains(v)
            && self.columns.start <= span.start
            && span.end <= self.columns.end;
        if is_inside {
            return &self.values[place(span.start)..][..length];
        }
        line.clear();
        line.resize(length, P::zero());
        let shared = span.intersection(self.span(v));
        if !shared.is_empty() {
            let values = &self.values[place(shared.start)..][..shared.len()];
            line[at(shared.start, span.start)..][..shared.len()].copy_from_slice(values);
        }
        line
    }

    /// Number of pixels that the heat map has in `span` of row `v`.
    #[inline]
    pub fn shared(&self, v: i32, span: Span) -> u32 {
        pixels(span.intersection(self.span(v)))
    }
}

/// Values of one row of a splat (not clamped to 0.99).
pub(super) fn fill<P: Pixel>(table: &RowTable<P>, splat: &Splat, row: &Row, line: &mut [P]) {
    let d = f64::from(row.span.start) - splat.mean.x - row.centre;
    table.for_each(d, row.floor, line.len(), |k, group| {
        let end = line.len().min((k + 1) * LANES);
        line[k * LANES..end].copy_from_slice(&group.lanes()[..end - k * LANES]);
    });
}
