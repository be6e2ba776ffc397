//! Four joints at a time.

use std::ops::{Add, Mul};

use wide::f64x4;

use crate::matrix3::{Number, Symmetric};

/// A value of each of four joints.
pub(super) type Four = f64x4;
/// A symmetric matrix of each.
pub(super) type FourSymmetric = Symmetric<Four>;
/// 0 of each.
pub(super) const ZERO: FourSymmetric = Symmetric([Four::ZERO; 6]);
/// Joints in a [`Four`].
pub(super) const LANES: usize = 4;

/// Below this, exp is smaller than any weight that matters, and would leave the normal numbers.
const LEAST_EXPONENT: f64 = -700.0;
/// 1.5 · 2⁵², which moves the integer part of a sum into the last bits.
const TO_INTEGER: f64 = 6_755_399_441_055_744.0;
/// ln 2 in two parts, the first with few bits (W. J. Cody and W. Waite, "Software Manual for the
/// Elementary Functions", 1980).
const LN_2: [f64; 2] = [6.931_471_803_691_238e-1, 1.908_214_929_270_587_7e-10];
/// 1/k! from k = 0: Taylor's polynomial is exact to 1e-9 for |x| ≤ ½ ln 2.
const TAYLOR: [f64; 9] = [
    1.0,
    1.0,
    1.0 / 2.0,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5040.0,
    1.0 / 40_320.0,
];

/// exp of a reduced argument and, in its last bits, the power of 2 that it lacks.
#[inline(always)]
fn reduced<T: Number + Add<f64, Output = T> + Mul<f64, Output = T>>(x: T) -> [T; 2] {
    let shifted = x * std::f64::consts::LOG2_E + TO_INTEGER;
    let whole = shifted + -TO_INTEGER;
    let r = (x - whole * LN_2[0]) - whole * LN_2[1];
    let (r2, t) = (r * r, TAYLOR);
    let r4 = r2 * r2;
    let low = (r + t[0]) + r2 * (r * t[3] + t[2]);
    let middle = (r * t[5] + t[4]) + r2 * (r * t[7] + t[6]);
    [low + r4 * (middle + r4 * t[8]), shifted]
}

#[inline(always)]
fn scaled(p: f64, shifted: f64) -> f64 {
    f64::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 52))
}

/// exp of values that are not positive, to 1e-9.
#[inline(always)]
pub(super) fn exp(x: Four) -> Four {
    let [p, n] = reduced(x.fast_max(Four::splat(LEAST_EXPONENT))).map(Four::to_array);
    Four::new(std::array::from_fn(|l| scaled(p[l], n[l])))
}

/// exp of one value that is not positive, to 1e-9.
#[inline(always)]
pub(crate) fn exp_of_one(x: f64) -> f64 {
    let [p, n] = reduced(x);
    if x < LEAST_EXPONENT { 0.0 } else { scaled(p, n) }
}

/// √½, of which logarithms take multiples by powers of 2: its first 20 bits.
const ROOT_HALF: u64 = 0x3fe6_a09e_0000_0000;
/// The bits of 1.
const ONE: u64 = 0x3ff0_0000_0000_0000;
/// The bits of 2⁵², which holds integers in its last bits.
const TO_BITS: u64 = 0x4330_0000_0000_0000;

/// The natural logarithm of positive normal numbers, to 1e-9: of 2ᵏ m with m from √½ to √2, that
/// of m = (1 + s)/(1 − s) is 2 (s + s³/3 + s⁵/5 + …).
#[inline(always)]
pub(super) fn ln(x: Four) -> Four {
    let bits = x.to_array().map(f64::to_bits);
    let exponent = bits.map(|b| b.wrapping_add(ONE - ROOT_HALF) >> 52);
    let whole = Four::new(exponent.map(|k| f64::from_bits(k | TO_BITS)));
    let whole = whole - f64::from_bits((ONE >> 52) | TO_BITS);
    let of_unit = |l: usize| bits[l].wrapping_sub(exponent[l] << 52).wrapping_add(ONE);
    let m = Four::new([0, 1, 2, 3].map(|l| f64::from_bits(of_unit(l))));
    let s = (m - 1.0) / (m + 1.0);
    let t = s * s;
    let (t2, odd) = (t * t, |n: f64| t * (1.0 / (n + 2.0)) + 1.0 / n);
    let series = odd(1.0) + t2 * (odd(5.0) + t2 * (1.0 / 9.0));
    whole * std::f64::consts::LN_2 + (s + s) * series
}

/// The sum of the four.
#[inline(always)]
pub(super) fn added(m: &FourSymmetric) -> Symmetric {
    Symmetric(m.0.map(Four::reduce_add))
}

/// The value of one of the four.
#[inline(always)]
pub(super) fn lane(v: &Four, l: usize) -> f64 {
    v.as_array()[l]
}

/// Sets the value of one of the four.
#[inline(always)]
pub(super) fn set_lane(v: &mut Four, l: usize, to: f64) {
    v.as_mut_array()[l] = to;
}

/// Sets the values of one of the four.
#[inline(always)]
pub(super) fn set_lanes(v: &mut [Four], l: usize, to: &[f64]) {
    v.iter_mut().zip(to).for_each(|(v, to)| set_lane(v, l, *to));
}
