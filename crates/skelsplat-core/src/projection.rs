//! EWA projection of a 3D Gaussian into a view (paper §3 "Background" and supplement A, DESIGN §2).
//!
//! m = π(Rμ+t) and Σ² = J W Σ Wᵀ Jᵀ + h·I, with W = R, the camera's rotation, and J the Jacobian of
//! the pinhole projection at the camera-frame mean (x, y, z):
//!
//! ```text
//! J = | fx/z   0    -fx τx / z |      τx = x/z, τy = y/z, clamped to the image's
//!     |  0    fy/z  -fy τy / z |      field of view widened by 30 %
//! ```

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use crate::camera::Camera;

/// Amount by which the field of view is widened on each side, as a share of the image's width:
/// 30 % of the half-width, as in 3D Gaussian splatting.
const FIELD_OF_VIEW_MARGIN: f64 = 0.15;

/// The camera data needed for projection, computed once; distortion is not used here.
#[derive(Debug, Clone)]
pub struct View {
    camera: Camera,
    focal: Vector2<f64>,
    /// Bounds of (x/z, y/z) inside J.
    tangent_low: Vector2<f64>,
    tangent_high: Vector2<f64>,
    /// Image width and height in pixels.
    pub size: [u32; 2],
}

/// A 3D Gaussian projected into a view, with the intermediate values needed for the gradient.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    /// Projected mean m, ideal pixels.
    pub mean: Vector2<f64>,
    /// Projected covariance Σ², pixels², including h·I.
    pub covariance: Matrix2<f64>,
    /// Mean in the camera frame; its z is the depth.
    pub in_camera: Vector3<f64>,
    /// T = J W.
    linear: Matrix2x3<f64>,
}

/// (τ, whether τ lies inside its bounds) for one coordinate.
fn clamp_tangent(tangent: f64, low: f64, high: f64) -> (f64, bool) {
    (tangent.clamp(low, high), (low..=high).contains(&tangent))
}

impl View {
    /// The pinhole part of `camera`.
    pub fn new(camera: &Camera) -> Self {
        let [fx, fy] = camera.focal();
        let [cx, cy] = camera.principal_point();
        let size = camera.size();
        let [w, h] = size.map(f64::from);
        let margin = Vector2::new(w / fx, h / fy) * FIELD_OF_VIEW_MARGIN;
        Self {
            focal: Vector2::new(fx, fy),
            camera: camera.clone(),
            tangent_low: Vector2::new((-0.5 - cx) / fx, (-0.5 - cy) / fy) - margin,
            tangent_high: Vector2::new((w - 0.5 - cx) / fx, (h - 0.5 - cy) / fy) + margin,
            size,
        }
    }

    /// Projects the Gaussian (`mean`, `covariance`) with `dilation` = h in pixels²; `None` if its
    /// mean has no ideal pixel.
    pub fn project(
        &self,
        mean: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        dilation: f64,
    ) -> Option<Projected> {
        let in_camera = self.camera.to_camera(mean);
        let mean = self.camera.project_ideal(mean)?;
        let linear = self.jacobian(&in_camera) * self.camera.rotation();
        Some(Projected {
            mean,
            covariance: linear * covariance * linear.transpose()
                + Matrix2::from_diagonal_element(dilation),
            in_camera,
            linear,
        })
    }

    /// Gradient of a scalar with respect to the 3D mean and covariance, given those with respect to
    /// the projected mean and covariance (`d_cov` symmetric, every entry counted).
    ///
    /// Σ² = T Σ Tᵀ + hI gives ∂L/∂Σ = Tᵀ G T and ∂L/∂T = 2 G T Σ, hence ∂L/∂J = 2 G T Σ Wᵀ; the
    /// mean enters both through m and through J.
    pub fn backward(
        &self,
        projected: &Projected,
        covariance: &Matrix3<f64>,
        d_mean: &Vector2<f64>,
        d_cov: &Matrix2<f64>,
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let t = &projected.linear;
        let d_jacobian = 2.0 * d_cov * t * covariance * self.camera.rotation().transpose();
        let d_camera = self.mean_backward(&projected.in_camera, d_mean)
            + self.jacobian_backward(&projected.in_camera, &d_jacobian);
        (self.camera.rotation().transpose() * d_camera, t.transpose() * d_cov * t)
    }

    fn jacobian(&self, p: &Vector3<f64>) -> Matrix2x3<f64> {
        let (f, z) = (&self.focal, p.z);
        let (tx, _) = clamp_tangent(p.x / z, self.tangent_low.x, self.tangent_high.x);
        let (ty, _) = clamp_tangent(p.y / z, self.tangent_low.y, self.tangent_high.y);
        Matrix2x3::new(f.x / z, 0.0, -f.x * tx / z, 0.0, f.y / z, -f.y * ty / z)
    }

    /// Through m = f·(x, y)/z + c.
    fn mean_backward(&self, p: &Vector3<f64>, d_mean: &Vector2<f64>) -> Vector3<f64> {
        let g = self.focal.component_mul(d_mean) / p.z;
        Vector3::new(g.x, g.y, -(g.x * p.x + g.y * p.y) / p.z)
    }

    /// Through the entries of J; a clamped τ is a constant.
    fn jacobian_backward(&self, p: &Vector3<f64>, d: &Matrix2x3<f64>) -> Vector3<f64> {
        let (f, z) = (&self.focal, p.z);
        let mut out = Vector3::zeros();
        for axis in 0..2 {
            let (low, high) = (self.tangent_low[axis], self.tangent_high[axis]);
            let (tangent, inside) = clamp_tangent(p[axis] / z, low, high);
            let d_tangent = if inside { -f[axis] / z * d[(axis, 2)] } else { 0.0 };
            out[axis] += d_tangent / z;
            out.z += f[axis] / (z * z) * (tangent * d[(axis, 2)] - d[(axis, axis)])
                - d_tangent * p[axis] / (z * z);
        }
        out
    }
}
