//! Validation of a camera's parameters.

use nalgebra::{Matrix3, Vector3};

use crate::error::{Error, Result};
use crate::settings::{MOST, ROUNDING};

/// Largest entry of `RᵀR − I` accepted: files with three decimals and more pass, a scaled or
/// sheared R does not.
const ORTHONORMAL: f64 = 1e-3;
/// Largest entry of `RᵀR − I` of a rotation in double precision, which stays as it is, to the bit.
const EXACT: f64 = 1e-12;

/// Largest coordinate of the translation, in any unit: a million kilometres in mm.
const TRANSLATION: f64 = 1e12;
/// Largest width and height, pixels: the limit of JPEG. The number of pixels then fits in 32 bits.
const SIDE: u32 = 65_535;

/// Adds the camera's name to the argument of an input error, for use in `map_err`.
pub fn for_camera(name: &str) -> impl FnOnce(Error) -> Error + '_ {
    move |error| {
        let named = |argument| format!("{argument} of camera '{name}'");
        error.reworded(|argument, expected, actual| (named(argument), expected, actual))
    }
}

pub(super) fn intrinsics(k: &Matrix3<f64>) -> Result<()> {
    finite("K", k.as_slice())?;
    let (fx, fy) = (k[(0, 0)], k[(1, 1)]);
    if fx <= 0.0 || fy <= 0.0 {
        return Err(Error::invalid("K", "positive focal lengths", format!("fx = {fx}, fy = {fy}")));
    }
    // The least is that of a camera scaled down to one pixel.
    if [fx, fy].iter().any(|f| !(1.0 / MOST..=MOST).contains(f)) {
        let expected = format!("focal lengths from {:e} to {MOST:e} pixels", 1.0 / MOST);
        return Err(Error::invalid("K", expected, format!("fx = {fx:e}, fy = {fy:e}")));
    }
    let (cx, cy) = (k[(0, 2)], k[(1, 2)]);
    if cx.abs().max(cy.abs()) > MOST {
        let expected = format!("a principal point within ±{MOST:e} pixels");
        return Err(Error::invalid("K", expected, format!("cx = {cx:e}, cy = {cy:e}")));
    }
    if k[(0, 1)].abs() > ROUNDING * fx {
        return Err(Error::invalid("K", "zero skew", format!("K[0, 1] = {}", k[(0, 1)])));
    }
    let rest = [k[(1, 0)] / fx, k[(2, 0)], k[(2, 1)], k[(2, 2)] - 1.0];
    if rest.iter().any(|v| v.abs() > ROUNDING) {
        let rows: Vec<String> =
            k.row_iter().map(|r| format!("[{}, {}, {}]", r[0], r[1], r[2])).collect();
        let expected = "[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]";
        return Err(Error::invalid("K", expected, format!("[{}]", rows.join(", "))));
    }
    Ok(())
}

/// The rotation nearest to a matrix that is one to the digits it was written with.
pub(super) fn rotation(r: &Matrix3<f64>) -> Result<Matrix3<f64>> {
    finite("R", r.as_slice())?;
    let off = deviation(r);
    if off > ORTHONORMAL {
        let expected = format!("an orthonormal matrix (RᵀR = I to {ORTHONORMAL:e})");
        return Err(Error::invalid("R", expected, format!("a deviation of {off:.3e}")));
    }
    if r.determinant() < 0.0 {
        let actual = "a reflection (determinant -1): an axis is flipped or two are swapped";
        return Err(Error::invalid("R", "a rotation (determinant +1)", actual));
    }
    Ok(nearest(*r))
}

fn deviation(r: &Matrix3<f64>) -> f64 {
    (r.tr_mul(r) - Matrix3::identity()).amax()
}

/// The nearest rotation in the Frobenius norm, by Newton's iteration for the polar decomposition:
/// each step squares the deviation, so that three suffice from [`ORTHONORMAL`].
fn nearest(mut r: Matrix3<f64>) -> Matrix3<f64> {
    if deviation(&r) > EXACT {
        for _ in 0..3 {
            let Some(inverse) = r.try_inverse() else { break };
            r = (r + inverse.transpose()) * 0.5;
        }
    }
    r
}

pub(super) fn translation(t: &Vector3<f64>) -> Result<()> {
    within("t", t.as_slice(), TRANSLATION)
}

pub(super) fn distortion(coefficients: &[f64]) -> Result<()> {
    within("distortion", coefficients, MOST)
}

pub(super) fn size(size: [u32; 2]) -> Result<()> {
    let actual = || format!("({}, {})", size[0], size[1]);
    if size.contains(&0) {
        return Err(Error::invalid("size", "(width, height) of at least 1 pixel", actual()));
    }
    if size.iter().any(|n| *n > SIDE) {
        let expected = format!("(width, height) of at most {SIDE} pixels");
        return Err(Error::invalid("size", expected, actual()));
    }
    Ok(())
}

/// Checks that every value is finite and lies within ±`most`; the message shows the first that does
/// not.
fn within(argument: &str, values: &[f64], most: f64) -> Result<()> {
    finite(argument, values)?;
    match values.iter().find(|v| v.abs() > most) {
        None => Ok(()),
        Some(v) => {
            Err(Error::invalid(argument, format!("values within ±{most:e}"), format!("{v:e}")))
        }
    }
}

/// Checks that every value is finite; the message shows the first that is not.
pub(super) fn finite(argument: &str, values: &[f64]) -> Result<()> {
    match values.iter().find(|v| !v.is_finite()) {
        None => Ok(()),
        Some(bad) => Err(Error::invalid(argument, "finite values", bad.to_string())),
    }
}
