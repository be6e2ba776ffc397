//! Masked L2 of one channel, value and gradient in one pass over the render's pixels (paper §3,
//! L_render).
//!
//! Over the union mask, Σ(R−P)² = ΣP² + Σ_R (R² − 2RP): outside the render only P contributes, and
//! ΣP² is known. The mask counts |R| + |P| − |R∩P| pixels, from the spans alone.
//!
//! For the gradient let D = R − P and w = D·R where the clamp at 0.99 is not active, else 0. With
//! R = exp(−½ xᵀAx) and x = p − m,
//!
//! ```text
//! ½ ∂/∂m Σ D²  =  A Σ w x              ½ ∂/∂A Σ D²  =  −½ Σ w x xᵀ
//! ∂/∂Σ²        = −A (∂/∂A) A           (from d(Σ⁻¹) = −Σ⁻¹ dΣ Σ⁻¹)
//! ```
//!
//! so five moments of w are all that is needed from the pixels. The mask is treated as constant.

use nalgebra::{Matrix2, Vector2};

use super::pseudo_gt::{HeatMap, pixels};
use super::rows::{Group, LANES, Pixel, RowTable, lane_numbers};
use super::splat::{ALPHA_MAX, Row, Splat};

/// Value of one channel and the moments that determine its gradient.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ChannelSums {
    /// Σ (R−P)² over the mask.
    pub squared: f64,
    /// Number of pixels of the mask.
    pub mask: u32,
    /// Moments for the gradient.
    pub moments: Moments,
}

/// First and second moments of the weights w around the splat's mean.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Moments {
    /// Σ w x.
    pub first: Vector2<f64>,
    /// Σ w x xᵀ.
    pub second: Matrix2<f64>,
}

impl Moments {
    /// Adds a pixel of weight `w` at `x` from the mean.
    pub fn add(&mut self, w: f64, x: Vector2<f64>) {
        self.first += w * x;
        self.second += w * x * x.transpose();
    }

    /// Gradient of `scale` · Σ(R−P)² with respect to the splat's mean and covariance.
    pub fn backward(&self, conic: &Matrix2<f64>, scale: f64) -> (Vector2<f64>, Matrix2<f64>) {
        let d_mean = conic * self.first * (2.0 * scale);
        let d_cov = conic * self.second * conic * scale;
        (d_mean, d_cov)
    }
}

/// Rows after which the lanes' sums are added to doubles, which limits the error of f32 sums to
/// that of a few rows.
const FLUSH: usize = 16;

/// Per-lane sums over some rows: Σ R(R−2P), Σw·{x, y, xx, xy, yy}.
struct Lanes<P: Pixel>([P::Group; 6]);

impl<P: Pixel> Lanes<P> {
    fn zero() -> Self {
        Self([P::Group::splat(P::zero()); 6])
    }

    /// Adds the sums to `total` and resets them.
    fn flush(&mut self, total: &mut [f64; 6]) {
        let lanes = std::mem::replace(self, Self::zero());
        total.iter_mut().zip(lanes.0).for_each(|(t, group)| *t += group.sum().wide());
    }
}

/// Compares the render of `splat` with `heat`. `line` is scratch for one row of the pseudo ground
/// truth.
pub fn channel<P: Pixel>(splat: &Splat, heat: &HeatMap<P>, line: &mut Vec<P>) -> ChannelSums {
    let table = RowTable::new(splat.conic[(0, 0)]);
    let (mut lanes, mut total) = (Lanes::<P>::zero(), [0.0; 6]);
    let (mut rendered, mut shared) = (0_u32, 0_u32);
    for (count, (v, row)) in splat.covered_rows().enumerate() {
        let groups = heat.groups(v, row.span, line);
        compare_row(&table, splat, &row, groups, &mut lanes);
        rendered += pixels(row.span);
        shared += heat.shared(v, row.span);
        if count % FLUSH == FLUSH - 1 {
            lanes.flush(&mut total);
        }
    }
    lanes.flush(&mut total);
    let [squared, x, y, xx, xy, yy] = total;
    ChannelSums {
        squared: heat.energy + squared,
        mask: rendered + heat.count - shared,
        moments: Moments { first: Vector2::new(x, y), second: Matrix2::new(xx, xy, xy, yy) },
    }
}

/// Adds one row's pixels to the sums. Lanes beyond the row have R = 0 and add nothing.
#[inline]
fn compare_row<P: Pixel>(
    table: &RowTable<P>,
    splat: &Splat,
    row: &Row,
    pseudo: &[P],
    sums: &mut Lanes<P>,
) {
    let group = |value: f64| P::Group::splat(P::of(value));
    let (zero, max, two, step) = (group(0.0), group(ALPHA_MAX), group(2.0), group(8.0));
    let from_mean = f64::from(row.span.start) - splat.mean.x;
    let mut x = group(from_mean) + lane_numbers::<P>();
    let (mut squared, mut s0, mut s1, mut s2) = (sums.0[0], zero, zero, zero);
    let (pseudo, _) = pseudo.as_chunks::<LANES>();
    table.for_each(from_mean - row.centre, row.floor, row.span.len(), |k, g| {
        let p = P::Group::new(pseudo[k]);
        let r = g.least(max);
        let w = g.gate(max, (g - p) * g);
        squared = squared + r * (r - two * p);
        let wx = w * x;
        s0 = s0 + w;
        s1 = s1 + wx;
        s2 = s2 + wx * x;
        x = x + step;
    });
    let y = group(row.y);
    sums.0[0] = squared;
    for (moment, row_sum) in sums.0[1..].iter_mut().zip([s1, y * s0, s2, y * s1, y * y * s0]) {
        *moment = *moment + row_sum;
    }
}
