//! Lens distortion of normalised coordinates: `OpenCV`'s polynomial, rational, thin-prism and
//! tilted models (the notation is that of the calib3d documentation), each with its Jacobian.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::checks;
use super::fisheye::Fisheye;
use super::fold;
use crate::error::{Error, Result};

/// A lens, acting on normalised coordinates.
#[derive(Debug, Clone, PartialEq)]
pub enum Distortion {
    /// A pinhole.
    None,
    /// Radial, tangential, thin-prism and tilt terms.
    Brown(Box<BrownConrady>),
    /// `OpenCV`'s equidistant polynomial.
    Fisheye(Fisheye),
}

impl Distortion {
    /// From the coefficients of `OpenCV`'s general model:
    /// `k1,k2,p1,p2[,k3[,k4,k5,k6[,s1..s4[,τx,τy]]]]`. No coefficients: a pinhole.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming `distortion`: a count other than 0, 4, 5, 8, 12 or 14, or a
    /// value that is not finite or beyond ±1e9.
    pub fn brown_conrady(c: &[f64]) -> Result<Self> {
        checks::distortion(c)?;
        match c.len() {
            0 => Ok(Self::None),
            4 | 5 | 8 | 12 | 14 => Ok(Self::Brown(Box::new(BrownConrady::new(c)))),
            n => Err(wrong_count("4, 5, 8, 12 or 14 coefficients", n)),
        }
    }

    /// From the coefficients of `OpenCV`'s fisheye model, `k1..k4`. No coefficients: a pinhole.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming `distortion`: a count other than 0 or 4, or a value that is
    /// not finite or beyond ±1e9.
    pub fn fisheye(c: &[f64]) -> Result<Self> {
        checks::distortion(c)?;
        match c {
            [] => Ok(Self::None),
            &[k1, k2, k3, k4] => Ok(Self::Fisheye(Fisheye::new([k1, k2, k3, k4]))),
            _ => Err(wrong_count("4 fisheye coefficients", c.len())),
        }
    }

    /// The coefficients as given, in `OpenCV`'s order; empty for a pinhole.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::None => Vec::new(),
            Self::Brown(b) => b.all[..b.count].to_vec(),
            Self::Fisheye(f) => f.coefficients().to_vec(),
        }
    }

    /// Whether the lens has no effect. A fisheye always has one: with zero coefficients it is
    /// equidistant.
    pub fn is_none(&self) -> bool {
        match self {
            Self::None => true,
            Self::Brown(b) => b.all == [0.0; 14],
            Self::Fisheye(_) => false,
        }
    }

    /// Whether this is the fisheye model.
    pub fn is_fisheye(&self) -> bool {
        matches!(self, Self::Fisheye(_))
    }

    /// Distorted normalised coordinates of ideal ones.
    pub fn distort(&self, x: &Vector2<f64>) -> Vector2<f64> {
        self.distort_with_jacobian(x).0
    }

    /// [`Distortion::distort`] with its 2×2 Jacobian.
    pub fn distort_with_jacobian(&self, x: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match self {
            Self::None => (*x, Matrix2::identity()),
            Self::Brown(b) => {
                let (l, j) = b.lens_with_jacobian(x);
                let (tilted, turn) = b.tilt_with_jacobian(&l);
                (tilted, turn * j)
            }
            Self::Fisheye(f) => f.distort_with_jacobian(x),
        }
    }
}

fn wrong_count(expected: &str, n: usize) -> Error {
    Error::invalid("distortion", expected, format!("{n} coefficients"))
}

/// `OpenCV`'s general model: the lens (radial, tangential, thin prism) and then the tilt of the
/// sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct BrownConrady {
    /// k1,k2,p1,p2,k3,k4,k5,k6,s1..s4,τx,τy; 0 if not given.
    all: [f64; 14],
    count: usize,
    /// Homography of the tilt and its inverse.
    tilt: Option<(Matrix3<f64>, Matrix3<f64>)>,
    fold: f64,
}

impl BrownConrady {
    /// From 4, 5, 8, 12 or 14 finite coefficients; the caller checks both.
    fn new(c: &[f64]) -> Self {
        let mut all = [0.0; 14];
        all[..c.len()].copy_from_slice(c);
        let tilt = (all[12] != 0.0 || all[13] != 0.0).then(|| {
            let m = tilt_matrix(all[12], all[13]);
            // A sensor seen edge-on (τ = 90°) has no inverse; no point is then in range.
            (m, m.try_inverse().unwrap_or_else(|| Matrix3::repeat(f64::NAN)))
        });
        let (n, d) = ([1.0, all[0], all[1], all[4]], [1.0, all[5], all[6], all[7]]);
        Self { all, count: c.len(), tilt, fold: fold::rational(&n, &d) }
    }

    /// Radius up to which the radial factor alone is one-to-one.
    pub(super) fn fold(&self) -> f64 {
        self.fold
    }

    /// Whether there are no tangential and no thin-prism terms.
    pub(super) fn is_radial(&self) -> bool {
        self.all[2..4].iter().chain(&self.all[8..12]).all(|v| *v == 0.0)
    }

    /// Radial factor and its derivative by q = r².
    pub(super) fn radial(&self, q: f64) -> (f64, f64) {
        let [k1, k2, _, _, k3, k4, k5, k6, ..] = self.all;
        let (n, dn) = (1.0 + q * (k1 + q * (k2 + q * k3)), k1 + q * (2.0 * k2 + q * 3.0 * k3));
        let (d, dd) = (1.0 + q * (k4 + q * (k5 + q * k6)), k4 + q * (2.0 * k5 + q * 3.0 * k6));
        (n / d, (dn * d - n * dd) / (d * d))
    }

    /// Everything except the tilt, with the Jacobian.
    pub(super) fn lens_with_jacobian(&self, x: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let [_, _, p1, p2, .., s1, s2, s3, s4, _, _] = self.all;
        let (q, xy) = (x.norm_squared(), 2.0 * x.x * x.y);
        let (radial, slope) = self.radial(q);
        let tangential = Matrix2::new(
            2.0 * p1 * x.y + 6.0 * p2 * x.x,
            2.0 * (p1 * x.x + p2 * x.y),
            2.0 * (p1 * x.x + p2 * x.y),
            2.0 * p2 * x.x + 6.0 * p1 * x.y,
        );
        let prism = Vector2::new(s1 + 2.0 * q * s2, s3 + 2.0 * q * s4);
        // d q / d x = 2 xᵀ
        let through_q = (x * slope + prism) * (2.0 * x.transpose());
        let value = x * radial
            + Vector2::new(
                p1 * xy + p2 * (q + 2.0 * x.x * x.x) + q * (s1 + q * s2),
                p2 * xy + p1 * (q + 2.0 * x.y * x.y) + q * (s3 + q * s4),
            );
        (value, Matrix2::identity() * radial + through_q + tangential)
    }

    /// The tilt and its Jacobian: (mᵢ − yᵢ m₃)/v₃ for the homography's rows mᵢ.
    fn tilt_with_jacobian(&self, x: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let Some((m, _)) = &self.tilt else {
            return (*x, Matrix2::identity());
        };
        let v = m * Vector3::new(x.x, x.y, 1.0);
        let (y, top) = (v.xy() / v.z, m.fixed_view::<2, 2>(0, 0));
        (y, (top - y * m.fixed_view::<1, 2>(2, 0)) / v.z)
    }

    /// Inverse of the tilt; `None` on the far side of the tilted plane's horizon.
    pub(super) fn untilt(&self, y: &Vector2<f64>) -> Option<Vector2<f64>> {
        let Some((_, inverse)) = &self.tilt else {
            return Some(*y);
        };
        let v = inverse * Vector3::new(y.x, y.y, 1.0);
        (v.z > 0.0).then(|| v.xy() / v.z)
    }
}

/// The homography of a sensor tilted by τx, τy (radians): the rotation R(τx, τy), then the
/// projection back onto the untilted plane along the optical axis.
fn tilt_matrix(tau_x: f64, tau_y: f64) -> Matrix3<f64> {
    let ((sx, cx), (sy, cy)) = (tau_x.sin_cos(), tau_y.sin_cos());
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, sx, 0.0, -sx, cx);
    let about_y = Matrix3::new(cy, 0.0, -sy, 0.0, 1.0, 0.0, sy, 0.0, cy);
    let r = about_y * about_x;
    let back = Matrix3::new(r[(2, 2)], 0.0, -r[(0, 2)], 0.0, r[(2, 2)], -r[(1, 2)], 0.0, 0.0, 1.0);
    back * r
}
