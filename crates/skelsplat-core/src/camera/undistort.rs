//! Inverse of lens distortion.

use nalgebra::Vector2;

use super::distortion::{BrownConrady, Distortion};
use super::fold::invert_rising;

/// Largest error of an accepted answer, in pixels of the distorted image. Newton goes on to a
/// hundredth of it, above the rounding of a coordinate of 10⁴ px.
const TOLERANCE_PX: f64 = 1e-9;
/// Most steps of Newton's method.
const MAX_STEPS: usize = 50;
/// Fractions of the radial solution to start from, in turn: near a fold the first may lie beyond
/// it.
const STARTS: [f64; 3] = [1.0, 0.7, 0.4];
/// Points of the segment from the axis to an answer at which the map must keep its orientation.
const SHEET_SAMPLES: usize = 16;

/// Ideal normalised coordinates of distorted ones; `focal` turns residuals into pixels.
pub(super) fn undistort(
    distortion: &Distortion,
    y: &Vector2<f64>,
    focal: &Vector2<f64>,
) -> Option<Vector2<f64>> {
    let x = match distortion {
        Distortion::None => *y,
        Distortion::Brown(b) => brown(b, y, focal)?,
        Distortion::Fisheye(f) => f.undistort(y)?,
    };
    let error = (distortion.distort(&x) - y).component_mul(focal).amax();
    (error <= TOLERANCE_PX).then_some(x)
}

/// Undoes the tilt, then the radial factor alone, and from there all lens terms together.
fn brown(lens: &BrownConrady, y: &Vector2<f64>, focal: &Vector2<f64>) -> Option<Vector2<f64>> {
    let y = lens.untilt(y)?;
    let rd = y.norm();
    if rd == 0.0 && lens.is_radial() {
        return Some(y);
    }
    let radius = invert_rising(
        |r| {
            let (radial, slope) = lens.radial(r * r);
            (r * radial, radial + 2.0 * r * r * slope)
        },
        lens.fold(),
        rd,
    );
    if lens.is_radial() {
        return radius.map(|r| y * (r / rd));
    }
    let start = match radius {
        Some(r) if rd > 0.0 => y * (r / rd),
        _ if lens.fold().is_finite() && rd > 0.0 => y * (0.9 * lens.fold() / rd),
        _ => y,
    };
    let mut attempts = STARTS.iter().filter_map(|part| newton(lens, &y, start * *part, focal));
    attempts.find(|x| on_first_sheet(lens, x))
}

/// Damped Newton that keeps the determinant positive, so that it does not cross a fold; `None` if
/// it ends above the tolerance.
fn newton(
    lens: &BrownConrady,
    y: &Vector2<f64>,
    start: Vector2<f64>,
    focal: &Vector2<f64>,
) -> Option<Vector2<f64>> {
    let evaluate = |x: &Vector2<f64>| {
        let (value, jacobian) = lens.lens_with_jacobian(x);
        let residual = value - y;
        (residual, jacobian, residual.component_mul(focal).norm())
    };
    let mut x = start;
    let mut at = evaluate(&x);
    while at.1.determinant() <= 0.0 && x.norm() > 1e-3 * start.norm() {
        x *= 0.8;
        at = evaluate(&x);
    }
    for _ in 0..MAX_STEPS {
        if at.2 <= 0.01 * TOLERANCE_PX {
            break;
        }
        let step = at.1.try_inverse()? * at.0;
        let mut fraction = 1.0;
        loop {
            let candidate = x - step * fraction;
            let there = evaluate(&candidate);
            if there.2 < at.2 && there.1.determinant() > 0.0 {
                (x, at) = (candidate, there);
                break;
            }
            fraction *= 0.5;
            if fraction < f64::EPSILON {
                // No descent: rounding, or a fold.
                return (at.2 <= TOLERANCE_PX).then_some(x);
            }
        }
    }
    (at.2 <= TOLERANCE_PX).then_some(x)
}

/// Whether there is no fold between the axis and `x`.
fn on_first_sheet(lens: &BrownConrady, x: &Vector2<f64>) -> bool {
    (1..=SHEET_SAMPLES).all(|i| {
        let part = x * (i as f64 / SHEET_SAMPLES as f64);
        lens.lens_with_jacobian(&part).1.determinant() > 0.0
    })
}
