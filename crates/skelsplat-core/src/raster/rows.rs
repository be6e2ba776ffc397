//! exp(−½ (a x² + e)) along a row of pixels by recurrence: lanes that the compiler turns into vector
//! instructions, and two calls of exp per row instead of one per pixel.
//!
//! For lane l of a group of L = 8 pixels that starts at x = d,
//!
//! ```text
//! g(d+l)   = exp(−½(a d² + e)) · exp(−a d)^l · exp(−½ a l²)
//! g(d+l+L) = g(d+l) · r_l        r_l = exp(−a d)^L · exp(−a (L l + L²/2))
//! r_l      ← r_l · exp(−a L²)    from one group to the next
//! ```
//!
//! Each step multiplies rounding into both g and r, so the relative error after k groups is about
//! k²/2 ulp; the recurrence starts anew every [`RESTART`] groups and stays below 2⁷ ulp (8e-6 in f32).

use num_traits::Float;

/// Pixels that are worked on at once.
pub const LANES: usize = 8;
/// Groups after which the recurrence starts anew.
const RESTART: usize = 16;

/// A floating-point type for pixels: `f32` in the solver, `f64` where gradients are studied.
pub trait Pixel: Float + Default + Send + Sync + std::fmt::Debug + 'static {
    /// Rounds a double.
    fn of(value: f64) -> Self;
    /// Widens to a double.
    fn wide(self) -> f64;
}

#[allow(clippy::cast_possible_truncation, reason = "rounding to the pixel type is the purpose")]
impl Pixel for f32 {
    fn of(value: f64) -> Self {
        value as Self
    }
    fn wide(self) -> f64 {
        self.into()
    }
}

impl Pixel for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn wide(self) -> f64 {
        self
    }
}

/// Factors of the recurrence that depend on `a` alone: one table per window.
#[derive(Debug, Clone, Copy)]
pub struct RowTable<P> {
    a: f64,
    /// exp(−½ a l²)
    lane: [P; LANES],
    /// exp(−a (L l + L²/2))
    ratio: [P; LANES],
    /// exp(−a L²)
    ratio_step: P,
}

impl<P: Pixel> RowTable<P> {
    /// The table of a row's curvature `a` (pixels⁻²).
    #[must_use]
    pub fn new(a: f64) -> Self {
        let width = Self::lane_number(LANES);
        // exp(−½ a l²) and exp(−a L l) by powers: two exps and the step for the whole table.
        let lane = std::array::from_fn(|l| P::of((-0.5 * a * Self::lane_number(l).powi(2)).exp()));
        let ratio = std::array::from_fn(|l| {
            P::of((-a * width * (Self::lane_number(l) + 0.5 * width)).exp())
        });
        Self { a, lane, ratio, ratio_step: P::of((-a * width * width).exp()) }
    }

    fn lane_number(l: usize) -> f64 {
        // At most LANES, exact in a double.
        #[allow(clippy::cast_precision_loss, reason = "l <= 8")]
        let l = l as f64;
        l
    }

    /// Calls `visit(first, group)` for consecutive groups of `len` pixels, the first of which lies at
    /// `d` from the row's centre; `floor` is e. Lanes beyond `len` are zero.
    #[inline]
    pub fn for_each(
        &self,
        d: f64,
        floor: f64,
        len: usize,
        mut visit: impl FnMut(usize, &[P; LANES]),
    ) {
        let mut first = 0;
        while first < len {
            let stop = len.min(first + RESTART * LANES);
            first = self.run(d, floor, first..stop, &mut visit);
        }
    }

    #[inline]
    fn run(
        &self,
        d: f64,
        floor: f64,
        pixels: std::ops::Range<usize>,
        visit: &mut impl FnMut(usize, &[P; LANES]),
    ) -> usize {
        #[allow(clippy::cast_precision_loss, reason = "pixel counts are far below 2^52")]
        let d = d + pixels.start as f64;
        let base = P::of((-0.5 * (self.a * d * d + floor)).exp());
        let step = P::of((-self.a * d).exp());
        let mut group = [P::zero(); LANES];
        let mut power = P::one();
        for (g, lane) in group.iter_mut().zip(&self.lane) {
            *g = base * power * *lane;
            power = power * step;
        }
        let mut ratio = self.ratio.map(|r| r * power);
        let mut first = pixels.start;
        while first + LANES <= pixels.end {
            visit(first, &group);
            for l in 0..LANES {
                group[l] = group[l] * ratio[l];
                ratio[l] = ratio[l] * self.ratio_step;
            }
            first += LANES;
        }
        if first < pixels.end {
            for lane in &mut group[pixels.end - first..] {
                *lane = P::zero();
            }
            visit(first, &group);
        }
        pixels.end
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest relative error against exp, over rows of every width from one pixel to a whole image.
    fn worst<P: Pixel>() -> f64 {
        let mut worst = 0.0_f64;
        for sigma in [0.55, 1.0, 2.4, 5.0, 20.0, 100.0, 300.0] {
            let a = 1.0 / (sigma * sigma);
            let reach = (2.0 * 255.0_f64.ln() / a).sqrt();
            let (d, e) = (-reach + 0.3, 0.01);
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "small and positive"
            )]
            let len = (2.0 * reach - 0.3).floor() as usize + 1;
            RowTable::<P>::new(a).for_each(d, e, len, |first, group| {
                for (l, g) in group.iter().enumerate().take(len - first) {
                    #[allow(clippy::cast_precision_loss, reason = "small")]
                    let x = d + (first + l) as f64;
                    let exact = (-0.5 * (a * x * x + e)).exp();
                    worst = worst.max((g.wide() - exact).abs() / exact);
                }
            });
        }
        worst
    }

    #[test]
    fn recurrence_follows_exp() {
        // 2^7 ulp by the module's estimate: 128 · 2^-24 and 128 · 2^-53, both with the factor 2 that the
        // start's own eight multiplications add.
        assert!(worst::<f32>() < 2.0 * 128.0 * 2.0_f64.powi(-24), "{}", worst::<f32>());
        assert!(worst::<f64>() < 2.0 * 128.0 * 2.0_f64.powi(-53), "{}", worst::<f64>());
    }

    #[test]
    fn lanes_beyond_the_row_are_zero() {
        RowTable::<f64>::new(0.1).for_each(-2.0, 0.0, 11, |first, group| {
            if first == 8 {
                assert!(
                    group[..3].iter().all(|g| *g > 0.0) && group[3..].iter().all(|g| *g == 0.0)
                );
            }
        });
    }
}
