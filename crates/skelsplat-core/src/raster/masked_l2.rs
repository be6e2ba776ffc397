//! Masked L2 of one channel, value and gradient in one pass over the render's pixels (paper §3, L_render).
//!
//! Over the union mask, Σ(R−P)² = ΣP² + Σ_R (R² − 2RP): outside the render only P contributes, and ΣP² is
//! known. The mask counts |R| + |P| − |R∩P| pixels, from the spans alone.
//!
//! For the gradient let D = R − P and w = D·R where the clamp at 0.99 is not active, else 0. With
//! R = exp(−½ xᵀAx) and x = p − m,
//!
//! ```text
//! ½ ∂/∂m Σ D²  =  A Σ w x              ½ ∂/∂A Σ D²  =  −½ Σ w x xᵀ
//! ∂/∂Σ²        = −A (∂/∂A) A           (from d(Σ⁻¹) = −Σ⁻¹ dΣ Σ⁻¹)
//! ```
//!
//! so five moments of w are all that the pixels have to give. The mask is a constant.

use nalgebra::{Matrix2, Vector2};

use super::pseudo_gt::HeatMap;
use super::rows::{LANES, Pixel, RowTable};
use super::splat::{ALPHA_MAX, Row, Splat};

/// Value of one channel and the moments that its gradient is made of.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ChannelSums {
    /// Σ (R−P)² over the mask.
    pub squared: f64,
    /// Number of pixels of the mask.
    pub mask: u32,
    /// Number of pixels that render and pseudo ground truth share.
    pub shared: u32,
    /// What the gradient needs of the pixels.
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

impl ChannelSums {
    /// A channel whose render is empty: all of the pseudo ground truth is missed.
    #[must_use]
    pub fn unseen<P>(heat: &HeatMap<P>) -> Self {
        Self { squared: heat.energy, mask: heat.count, ..Self::default() }
    }
}

impl Moments {
    /// Adds a pixel of weight `w` at `x` from the mean.
    pub fn add(&mut self, w: f64, x: Vector2<f64>) {
        self.first += w * x;
        self.second += w * x * x.transpose();
    }

    /// Gradient of `scale` · Σ(R−P)² with respect to the splat's mean and covariance.
    #[must_use]
    pub fn backward(&self, conic: &Matrix2<f64>, scale: f64) -> (Vector2<f64>, Matrix2<f64>) {
        let d_mean = conic * self.first * (2.0 * scale);
        let d_cov = conic * self.second * conic * scale;
        (d_mean, d_cov)
    }
}

/// Per-lane sums over a window: Σ R(R−2P), Σw·{x, y, xx, xy, yy}.
#[derive(Clone, Copy)]
struct Lanes<P> {
    squared: [P; LANES],
    moments: [[P; LANES]; 5],
}

/// Compares the render of `splat` with `heat`. `line` is scratch for one row of the pseudo ground truth.
#[must_use]
pub fn channel<P: Pixel>(splat: &Splat, heat: &HeatMap<P>, line: &mut Vec<P>) -> ChannelSums {
    let table = RowTable::new(splat.conic[(0, 0)]);
    let mut lanes = Lanes { squared: [P::zero(); LANES], moments: [[P::zero(); LANES]; 5] };
    let (mut rendered, mut shared) = (0_u32, 0_u32);
    for (v, row) in splat.covered_rows() {
        let (offset, pseudo) = heat.line(v, row.span);
        load(line, row.span.len(), offset, pseudo);
        compare_row(&table, splat, &row, line, &mut lanes);
        rendered += u32::try_from(row.span.len()).unwrap_or(u32::MAX);
        shared += u32::try_from(pseudo.len()).unwrap_or(u32::MAX);
    }
    let sum = |lane: &[P; LANES]| lane.iter().map(|p| p.wide()).sum::<f64>();
    let [x, y, xx, xy, yy] = std::array::from_fn(|k| sum(&lanes.moments[k]));
    ChannelSums {
        squared: heat.energy + sum(&lanes.squared),
        mask: rendered + heat.count - shared,
        shared,
        moments: Moments { first: Vector2::new(x, y), second: Matrix2::new(xx, xy, xy, yy) },
    }
}

/// Fills `line` with one row of the pseudo ground truth, zero where there is none, up to whole groups.
#[inline]
fn load<P: Pixel>(line: &mut Vec<P>, len: usize, offset: usize, pseudo: &[P]) {
    line.clear();
    line.resize(len.next_multiple_of(LANES), P::zero());
    line[offset..offset + pseudo.len()].copy_from_slice(pseudo);
}

/// Adds one row's pixels to the sums. Lanes beyond the row have R = 0 and add nothing.
#[inline]
fn compare_row<P: Pixel>(
    table: &RowTable<P>,
    splat: &Splat,
    row: &Row,
    line: &[P],
    sums: &mut Lanes<P>,
) {
    let (zero, max, two) = (P::zero(), P::of(ALPHA_MAX), P::of(2.0));
    let from_mean = f64::from(row.span.start) - splat.mean.x;
    let mut s = [[zero; LANES]; 3];
    let mut x: [P; LANES] = std::array::from_fn(|l| P::of(from_mean) + P::from(l).unwrap_or(zero));
    let step = P::from(LANES).unwrap_or(zero);
    table.for_each(from_mean - row.centre, row.floor, row.span.len(), |first, group| {
        let pseudo = &line[first..first + LANES];
        for l in 0..LANES {
            let (g, p) = (group[l], pseudo[l]);
            let r = if g < max { g } else { max };
            let w = if g < max { (g - p) * g } else { zero };
            sums.squared[l] = sums.squared[l] + r * (r - two * p);
            s[0][l] = s[0][l] + w;
            let wx = w * x[l];
            s[1][l] = s[1][l] + wx;
            s[2][l] = s[2][l] + wx * x[l];
            x[l] = x[l] + step;
        }
    });
    let y = P::of(row.y);
    for l in 0..LANES {
        let [x, y_, xx, xy, yy] = [s[1][l], y * s[0][l], s[2][l], y * s[1][l], y * y * s[0][l]];
        for (m, value) in sums.moments.iter_mut().zip([x, y_, xx, xy, yy]) {
            m[l] = m[l] + value;
        }
    }
}
