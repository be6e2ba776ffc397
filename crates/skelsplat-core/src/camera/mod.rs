//! A calibrated camera: projection of world points to pixels, with its Jacobian.
//!
//! World to camera is `x_c = R x_w + t` with x right, y down, z forward. Normalised coordinates are
//! `(x/z, y/z)`, lens distortion maps them to distorted normalised ones, and K maps either to
//! pixels. Integer pixel coordinates are pixel centres. "Ideal" pixels are those of K without
//! distortion.

mod checks;
mod distortion;
mod fisheye;
mod fold;
mod undistort;

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use crate::error::{Error, Result};

pub use checks::for_camera;
pub use distortion::{BrownConrady, Distortion};
pub use fisheye::Fisheye;

/// Camera-frame depth at or below which a point has no projection, in the caller's unit of length.
pub const NEAR: f64 = 1e-3;

/// A calibrated camera with its lens and image size.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    name: Option<String>,
    focal: Vector2<f64>,
    principal: Vector2<f64>,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    size: [u32; 2],
    distortion: Distortion,
}

impl Camera {
    /// A camera without lens distortion and without a name; `size` is (width, height) in pixels.
    ///
    /// A rotation that is orthonormal to 1e-3 (files have few digits) is replaced by the nearest
    /// rotation; one in double precision stays as it is.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming `K`, `R`, `t` or `size`: a value is not finite, K is not
    /// `[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]` with focal lengths from 1e-9 to 1e9 and a principal
    /// point within ±1e9 pixels, R is not orthonormal to 1e-3 or is a reflection, t is not within
    /// ±1e12, or the image is not 1 to 65 535 pixels wide and high. [`for_camera`] adds the
    /// camera's name.
    pub fn new(
        k: &Matrix3<f64>,
        rotation: &Matrix3<f64>,
        translation: &Vector3<f64>,
        size: [u32; 2],
    ) -> Result<Self> {
        checks::intrinsics(k)?;
        let rotation = checks::rotation(rotation)?;
        checks::translation(translation)?;
        checks::size(size)?;
        Ok(Self {
            name: None,
            focal: Vector2::new(k[(0, 0)], k[(1, 1)]),
            principal: Vector2::new(k[(0, 2)], k[(1, 2)]),
            rotation,
            translation: *translation,
            size,
            distortion: Distortion::None,
        })
    }

    /// The same camera with this lens.
    #[must_use]
    pub fn with_distortion(mut self, distortion: Distortion) -> Self {
        self.distortion = distortion;
        self
    }

    /// The same camera with this name.
    #[must_use]
    pub fn with_name(mut self, name: impl Into<String>) -> Self {
        self.name = Some(name.into());
        self
    }

    /// The name, if any.
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Intrinsic matrix K, in pixels.
    pub fn k(&self) -> Matrix3<f64> {
        let (f, c) = (&self.focal, &self.principal);
        Matrix3::new(f.x, 0.0, c.x, 0.0, f.y, c.y, 0.0, 0.0, 1.0)
    }

    /// Rotation R of world to camera.
    pub fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    /// Translation t of world to camera, in the caller's unit of length.
    pub fn translation(&self) -> &Vector3<f64> {
        &self.translation
    }

    /// Image size (width, height) in pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Focal lengths `[fx, fy]` in pixels.
    pub fn focal(&self) -> [f64; 2] {
        self.focal.into()
    }

    /// Principal point `[cx, cy]` in pixels.
    pub fn principal_point(&self) -> [f64; 2] {
        self.principal.into()
    }

    /// The lens.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// The camera centre in the world: −Rᵀt.
    pub fn centre(&self) -> Vector3<f64> {
        -self.rotation.tr_mul(&self.translation)
    }

    /// A world point in the camera frame: R x + t.
    pub fn to_camera(&self, x: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * x + self.translation
    }

    /// The ideal pixel of a world point, or `None` at or behind [`NEAR`].
    pub fn project_ideal(&self, x: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.normalised(x).map(|n| self.to_pixel(&n))
    }

    /// The pixel of a world point through the lens, or `None` at or behind [`NEAR`].
    ///
    /// Like `OpenCV`, evaluates the model's formula unchanged, even for points so far outside the
    /// image that a fitted polynomial folds back.
    pub fn project(&self, x: &Vector3<f64>) -> Option<Vector2<f64>> {
        self.normalised(x).map(|n| self.to_pixel(&self.distortion.distort(&n)))
    }

    /// [`Camera::project`] with its Jacobian d pixel / d world point (2×3).
    pub fn project_with_jacobian(
        &self,
        x: &Vector3<f64>,
    ) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let c = self.to_camera(x);
        if !in_front(&c) {
            return None;
        }
        let iz = 1.0 / c.z;
        let n = Vector2::new(c.x * iz, c.y * iz);
        let (d, lens) = self.distortion.distort_with_jacobian(&n);
        let pinhole = Matrix2x3::new(iz, 0.0, -n.x * iz, 0.0, iz, -n.y * iz);
        let jacobian = Matrix2::from_diagonal(&self.focal) * lens * pinhole * self.rotation;
        Some((self.to_pixel(&d), jacobian))
    }

    /// The distorted pixel of an ideal one.
    pub fn distort(&self, ideal: &Vector2<f64>) -> Vector2<f64> {
        if self.distortion.is_none() {
            return *ideal;
        }
        self.to_pixel(&self.distortion.distort(&self.to_normalised(ideal)))
    }

    /// The ideal pixel (of the same K) of a distorted one: the inverse of [`Camera::distort`],
    /// solved to 1e-9 px in the distorted image. `None` if no ray of the model's one-to-one range
    /// reaches the pixel, or no solution was found.
    pub fn undistort(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        if !(pixel.x.is_finite() && pixel.y.is_finite()) {
            return None;
        }
        if self.distortion.is_none() {
            return Some(pixel);
        }
        let n = undistort::undistort(&self.distortion, &self.to_normalised(&pixel), &self.focal)?;
        Some(self.to_pixel(&n))
    }

    /// The camera for images resized by `factor`: u' = (u + ½)·factor − ½. K and the size (rounded,
    /// at least 1) change; distortion acts on normalised coordinates and does not.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if `factor` is not positive and finite, or if K or the size leave
    /// the ranges of [`Camera::new`].
    pub fn scaled(&self, factor: f64) -> Result<Self> {
        if !(factor.is_finite() && factor > 0.0) {
            return Err(Error::invalid("factor", "a positive finite number", factor.to_string()));
        }
        let mut out = self.clone();
        out.focal *= factor;
        out.principal = self.principal.map(|c| (c + 0.5) * factor - 0.5);
        // Saturates far above the accepted sizes.
        out.size = self.size.map(|n| (f64::from(n) * factor).round().max(1.0) as u32);
        let checked = checks::intrinsics(&out.k()).and_then(|()| checks::size(out.size));
        let of_factor = |argument, expected, actual| {
            let expected = format!("a factor that gives {argument} {expected}");
            ("factor".to_owned(), expected, format!("{factor:e}, which gives {actual}"))
        };
        checked.map(|()| out).map_err(|error| error.reworded(of_factor))
    }

    /// The same camera with lengths in another unit: t × `factor` (1000 for metres to millimetres).
    #[must_use]
    pub fn with_length_scale(mut self, factor: f64) -> Self {
        self.translation *= factor;
        self
    }

    /// (x/z, y/z) of a world point in the camera frame.
    fn normalised(&self, x: &Vector3<f64>) -> Option<Vector2<f64>> {
        let c = self.to_camera(x);
        in_front(&c).then(|| c.xy() / c.z)
    }

    fn to_pixel(&self, n: &Vector2<f64>) -> Vector2<f64> {
        self.focal.component_mul(n) + self.principal
    }

    fn to_normalised(&self, p: &Vector2<f64>) -> Vector2<f64> {
        (p - self.principal).component_div(&self.focal)
    }
}

/// Also false for NaN.
fn in_front(c: &Vector3<f64>) -> bool {
    c.z > NEAR
}
