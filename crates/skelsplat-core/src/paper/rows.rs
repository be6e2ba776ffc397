//! exp(−½ (a x² + e)) along a row of pixels by recurrence, eight pixels at a time in vector
//! registers, with two calls of exp per row instead of one per pixel.
//!
//! For lane l of a group of L pixels that starts at x = d,
//!
//! ```text
//! g(d+l)   = exp(−½ (a d² + e)) · exp(−a d)^l · exp(−½ a l²)
//! g(d+l+L) = g(d+l) · r_l        r_l = exp(−a d)^L · exp(−a (L l + L²/2))
//! r_l      ← r_l · exp(−a L²)    from one group to the next
//! ```
//!
//! Each step multiplies rounding into both g and r, so the relative error after k groups is about
//! k²/2 ulp, plus k times that of the first r; the recurrence restarts every `RESTART` groups, when
//! k²/2 reaches 32 ulp.

use std::ops::{Add, Mul, Sub};

use num_traits::Float;
use wide::{f32x8, f64x8};

/// Pixels processed at once.
pub const LANES: usize = 8;
/// Groups after which the recurrence restarts.
const RESTART: usize = 8;

/// A floating-point type for pixels: `f32` in the solver, `f64` to study gradients.
pub trait Pixel: Float + Default + Send + Sync + std::fmt::Debug + 'static {
    /// [`LANES`] of them in vector registers.
    type Group: Group<Self>;
    /// Rounds a double.
    fn of(value: f64) -> Self;
    /// Widens to a double.
    fn wide(self) -> f64;
}

/// [`LANES`] pixels in vector registers.
pub trait Group<P>: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// From one value per lane.
    fn new(lanes: [P; LANES]) -> Self;
    /// The same value in every lane.
    fn splat(value: P) -> Self;
    /// One value per lane.
    fn lanes(self) -> [P; LANES];
    /// The minimum of both, lane by lane.
    fn least(self, other: Self) -> Self;
    /// The lanes of `value` where `self` is below `limit`, zero elsewhere.
    fn gate(self, limit: Self, value: Self) -> Self;
    /// Σ over the lanes.
    fn sum(self) -> P;
}

macro_rules! pixel {
    ($pixel:ty, $group:ty) => {
        impl Pixel for $pixel {
            type Group = $group;
            #[allow(clippy::cast_possible_truncation, reason = "rounding is the purpose")]
            #[inline]
            fn of(value: f64) -> Self {
                value as Self
            }
            #[inline]
            fn wide(self) -> f64 {
                self.into()
            }
        }

        impl Group<$pixel> for $group {
            #[inline]
            fn new(lanes: [$pixel; LANES]) -> Self {
                <$group>::new(lanes)
            }
            #[inline]
            fn splat(value: $pixel) -> Self {
                <$group>::splat(value)
            }
            #[inline]
            fn lanes(self) -> [$pixel; LANES] {
                self.to_array()
            }
            #[inline]
            fn least(self, other: Self) -> Self {
                self.fast_min(other)
            }
            #[inline]
            fn gate(self, limit: Self, value: Self) -> Self {
                self.simd_lt(limit) & value
            }
            #[inline]
            fn sum(self) -> $pixel {
                self.reduce_add()
            }
        }
    };
}
pixel!(f32, f32x8);
pixel!(f64, f64x8);

/// [`LANES`] as a double.
const WIDTH: f64 = LANES as f64;

/// 0, 1, …, 7 in the lanes of a group.
#[inline]
pub fn lane_numbers<P: Pixel>() -> P::Group {
    P::Group::new(std::array::from_fn(|l| P::of(l as f64)))
}

/// Factors of the recurrence that depend on `a` alone: one table per window.
#[derive(Debug, Clone, Copy)]
pub struct RowTable<P: Pixel> {
    a: f64,
    /// exp(−½ a l²)
    lane: P::Group,
    /// exp(−a (L l + L²/2))
    ratio: P::Group,
    /// exp(−a L²)
    ratio_step: P::Group,
}

/// The recurrence at one group of a row: the group, and the ratio to the next.
type Recurrence<P> = (<P as Pixel>::Group, <P as Pixel>::Group);

impl<P: Pixel> RowTable<P> {
    /// The table of a row's curvature `a` (pixels⁻²).
    pub fn new(a: f64) -> Self {
        let group = |f: fn(f64) -> f64| {
            P::Group::new(std::array::from_fn(|l| P::of((-a * f(l as f64)).exp())))
        };
        Self {
            a,
            lane: group(|l| 0.5 * l * l),
            ratio: group(|l| WIDTH * (l + 0.5 * WIDTH)),
            ratio_step: P::Group::splat(P::of((-a * WIDTH * WIDTH).exp())),
        }
    }

    /// Calls `visit(k, group)` for the consecutive groups of `len` pixels, the first of which lies
    /// at `d` from the row's centre; `floor` is e. Lanes beyond `len` are zero.
    #[inline(always)]
    #[allow(clippy::inline_always, reason = "the visitor's sums must stay in registers")]
    pub fn for_each(&self, d: f64, floor: f64, len: usize, mut visit: impl FnMut(usize, P::Group)) {
        let groups = len.div_ceil(LANES);
        if groups == 0 {
            return;
        }
        let mut run = self.start(d, floor);
        for k in 0..groups - 1 {
            visit(k, run.0);
            run = self.next(run, k, d, floor);
        }
        let kept = len - (groups - 1) * LANES;
        visit(groups - 1, keep::<P>(run.0, kept));
    }

    #[inline]
    fn next(&self, (group, ratio): Recurrence<P>, k: usize, d: f64, floor: f64) -> Recurrence<P> {
        if (k + 1).is_multiple_of(RESTART) {
            return self.start(d + ((k + 1) * LANES) as f64, floor);
        }
        (group * ratio, ratio * self.ratio_step)
    }

    #[inline]
    fn start(&self, d: f64, floor: f64) -> Recurrence<P> {
        let base = (-0.5 * (self.a * d * d + floor)).exp();
        let step = (-self.a * d).exp();
        let (two, four) = (step * step, step.powi(4));
        let low = [base, base * step, base * two, base * two * step];
        let powers: [f64; LANES] =
            std::array::from_fn(|l| if l < 4 { low[l] } else { low[l - 4] * four });
        let group = P::Group::new(powers.map(P::of)) * self.lane;
        (group, self.ratio * P::Group::splat(P::of(four * four)))
    }
}

/// The first `n` lanes of a group, zero in the others.
#[inline]
fn keep<P: Pixel>(group: P::Group, n: usize) -> P::Group {
    let limit = P::Group::splat(P::from(n).unwrap_or_else(P::max_value));
    lane_numbers::<P>().gate(limit, group)
}
