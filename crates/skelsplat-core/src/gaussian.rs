//! The skeleton of Gaussians: one anisotropic 3D Gaussian per joint (paper §3, "3D Human Pose as
//! Skeleton of Gaussians").
//!
//! Σ = R S Sᵀ Rᵀ with S = diag(exp s) and R the rotation of the normalised quaternion q = (w, x, y,
//! z).

use nalgebra::{Matrix3, Vector3, Vector4};

use crate::error::{Error, Result};
use crate::settings::ROUNDING;

/// Largest logarithm of a standard deviation: e⁵⁰ mm is 500 light years.
const FARTHEST_LOG_SCALE: f64 = 50.0;

/// A joint: mean μ (mm), log-scales s (σ = exp s, mm) and quaternion q (w, x, y, z).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaussian {
    /// Mean μ, the joint's position.
    pub mean: Vector3<f64>,
    /// Natural logarithm of the standard deviation along each principal axis.
    pub log_scales: Vector3<f64>,
    /// Orientation of the principal axes, (w, x, y, z); any positive norm.
    pub quaternion: Vector4<f64>,
}

/// Gradient of a scalar with respect to every parameter of a [`Gaussian`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GaussianGradient {
    /// With respect to the mean.
    pub mean: Vector3<f64>,
    /// With respect to the log-scales.
    pub log_scales: Vector3<f64>,
    /// With respect to the quaternion as stored (before normalisation).
    pub quaternion: Vector4<f64>,
}

impl Gaussian {
    /// An isotropic Gaussian of standard deviation `sigma` at `mean`.
    pub fn isotropic(mean: Vector3<f64>, sigma: f64) -> Self {
        Self {
            mean,
            log_scales: Vector3::repeat(sigma.ln()),
            quaternion: Vector4::new(1.0, 0.0, 0.0, 0.0),
        }
    }

    /// Rejects scales and orientations that cannot be computed with; missing values (NaN) are
    /// allowed.
    /// Errors: [`Error::InvalidInput`] naming the first wrong entry.
    pub fn check(gaussians: &[Self]) -> Result<()> {
        let is_far = |s: &f64| s.is_finite() && s.abs() > FARTHEST_LOG_SCALE;
        for (j, gaussian) in gaussians.iter().enumerate() {
            if let Some((k, s)) = gaussian.log_scales.iter().enumerate().find(|(_, s)| is_far(s)) {
                let expected = format!("a value within ±{FARTHEST_LOG_SCALE}");
                return Err(Error::invalid(
                    format!("log_scales[{j}, {k}]"),
                    expected,
                    s.to_string(),
                ));
            }
            if gaussian.quaternion.norm_squared() < f64::MIN_POSITIVE {
                let expected = "a non-zero quaternion (w, x, y, z)";
                return Err(Error::invalid(format!("quaternions[{j}]"), expected, "zeros"));
            }
        }
        Ok(())
    }

    /// Whether the mean, the variances and the orientation are finite.
    pub fn is_finite(&self) -> bool {
        let parameters = self.mean.iter().chain(self.quaternion.iter());
        parameters.chain(self.variances().iter()).all(|v| v.is_finite())
    }

    /// Variances along the principal axes, exp(2 s).
    pub fn variances(&self) -> Vector3<f64> {
        self.log_scales.map(|s| (2.0 * s).exp())
    }

    /// R, the principal axes as columns.
    pub fn rotation(&self) -> Matrix3<f64> {
        rotation(&self.quaternion.normalize())
    }

    /// Σ = R S Sᵀ Rᵀ.
    pub fn covariance(&self) -> Matrix3<f64> {
        let r = self.rotation();
        r * Matrix3::from_diagonal(&self.variances()) * r.transpose()
    }

    /// Gradient with respect to log-scales and quaternion, given the gradient `d_cov` = ∂L/∂Σ
    /// (symmetric, every entry counted).
    ///
    /// With dL = ⟨G, dΣ⟩ and V = S²: ∂L/∂s_k = 2 V_k (Rᵀ G R)_kk and ∂L/∂R = 2 G R V.
    pub fn covariance_backward(&self, d_cov: &Matrix3<f64>) -> (Vector3<f64>, Vector4<f64>) {
        let norm = self.quaternion.norm();
        let unit = self.quaternion / norm;
        let (r, v) = (rotation(&unit), self.variances());
        let g_r = d_cov * r;
        let d_log = Vector3::from_fn(|k, _| 2.0 * v[k] * r.column(k).dot(&g_r.column(k)));
        let d_rotation = 2.0 * g_r * Matrix3::from_diagonal(&v);
        let d_unit = rotation_backward(&unit, &d_rotation);
        (d_log, (d_unit - unit * unit.dot(&d_unit)) / norm)
    }
}

/// Whether a matrix is symmetric up to rounding.
pub fn is_symmetric(matrix: &Matrix3<f64>) -> bool {
    (matrix - matrix.transpose()).amax() <= ROUNDING * matrix.amax()
}

/// Rejects matrices that are not covariances, as `name[j]`; missing values (NaN) are allowed.
/// Errors: [`Error::InvalidInput`] for the first matrix that is asymmetric or has a negative
/// variance.
pub fn check_covariances(name: &str, covariances: &[Matrix3<f64>]) -> Result<()> {
    for (j, c) in covariances.iter().enumerate() {
        if c.iter().any(|v| !v.is_finite()) {
            continue;
        }
        let wrong =
            |expected, actual| Err(Error::invalid(format!("{name}[{j}]"), expected, actual));
        if !is_symmetric(c) {
            return wrong("a symmetric matrix", "an asymmetric one".to_owned());
        }
        let least = c.symmetric_eigenvalues().min();
        if least < -ROUNDING * c.amax().max(f64::MIN_POSITIVE) {
            return wrong("no negative variance", format!("a variance of {least:.3e}"));
        }
    }
    Ok(())
}

/// Rotation matrix of a unit quaternion (w, x, y, z).
fn rotation(q: &Vector4<f64>) -> Matrix3<f64> {
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    Matrix3::new(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )
}

/// Gradient of ⟨D, rotation(q)⟩ with respect to the four entries of q, entry by entry of
/// [`rotation`].
fn rotation_backward(q: &Vector4<f64>, d: &Matrix3<f64>) -> Vector4<f64> {
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    let skew = Vector3::new(d[(2, 1)] - d[(1, 2)], d[(0, 2)] - d[(2, 0)], d[(1, 0)] - d[(0, 1)]);
    let (xy, xz, yz) = (d[(0, 1)] + d[(1, 0)], d[(0, 2)] + d[(2, 0)], d[(1, 2)] + d[(2, 1)]);
    2.0 * Vector4::new(
        x * skew.x + y * skew.y + z * skew.z,
        w * skew.x + y * xy + z * xz - 2.0 * x * (d[(1, 1)] + d[(2, 2)]),
        w * skew.y + x * xy + z * yz - 2.0 * y * (d[(0, 0)] + d[(2, 2)]),
        w * skew.z + x * xz + y * yz - 2.0 * z * (d[(0, 0)] + d[(1, 1)]),
    )
}
