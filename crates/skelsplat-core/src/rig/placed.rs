//! A camera that may be wrong: its place, lens and clock, and how pixels depend on them.

use nalgebra::{Matrix3, Rotation3, SMatrix, UnitQuaternion, Vector2, Vector3};

use crate::camera::{Camera, Distortion};
use crate::error::Result;

/// Number of parameters of a camera: turn, shift, logarithm of the focal length, clock, radial
/// distortion k₁.
pub const PARAMETERS: usize = 9;
/// The parameter of the focal length.
pub(super) const ZOOM: usize = 6;
/// The parameter of the clock.
pub(super) const CLOCK: usize = 7;
/// The parameter of the radial distortion.
pub(super) const RADIAL: usize = 8;

/// A small change of a camera.
pub type Step = SMatrix<f64, PARAMETERS, 1>;

/// d residual / d [`Step`].
pub type Slope = SMatrix<f64, 2, PARAMETERS>;

/// What of a camera may change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Freedom {
    /// Its orientation.
    pub turn: bool,
    /// Its position.
    pub shift: bool,
    /// Its focal length.
    pub focal: bool,
    /// Its clock.
    pub clock: bool,
    /// Its first radial coefficient; not of fisheyes.
    pub radial: bool,
}

impl Freedom {
    /// Orientation and position.
    pub const PLACE: Self = Self { turn: true, shift: true, ..Self::NONE };
    /// The clock.
    pub const CLOCK: Self = Self { clock: true, ..Self::NONE };
    const NONE: Self =
        Self { turn: false, shift: false, focal: false, clock: false, radial: false };

    /// Indices of the free parameters.
    pub fn columns(self) -> impl Iterator<Item = usize> {
        let free = move |k: &usize| match *k {
            0..3 => self.turn,
            3..6 => self.shift,
            ZOOM => self.focal,
            CLOCK => self.clock,
            _ => self.radial,
        };
        (0..PARAMETERS).filter(free)
    }

    /// Each part by itself.
    pub fn parts(self) -> impl Iterator<Item = Self> {
        let none = Self::default();
        let all = [
            Self { turn: self.turn, ..none },
            Self { shift: self.shift, ..none },
            Self { focal: self.focal, ..none },
            Self { clock: self.clock, ..none },
            Self { radial: self.radial, ..none },
        ];
        all.into_iter().filter(|part| part.any())
    }

    /// Whether anything may change.
    pub fn any(self) -> bool {
        self.turn || self.shift || self.focal || self.clock || self.radial
    }
}

/// A camera, mm, and its clock: what all cameras see in frame t it calls frame t + `clock`.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// The camera.
    pub camera: Camera,
    /// Frames.
    pub clock: f64,
}

/// One detection as a camera's clock has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Pixel.
    pub pixel: Vector2<f64>,
    /// Movement of the pixel, px per frame; 0 where unknown.
    pub speed: Vector2<f64>,
    /// Confidence.
    pub confidence: f64,
}

/// Projection minus detection, px, with its derivatives.
#[derive(Debug, Clone, Copy)]
pub struct Residual {
    /// px.
    pub value: Vector2<f64>,
    /// With respect to the point.
    pub by_point: SMatrix<f64, 2, 3>,
    /// With respect to the camera.
    pub by_camera: Slope,
    /// Size of a pixel at the point, mm.
    pub pixel: f64,
}

impl Placed {
    /// The residual of a detection of the point `x`; `None` behind the camera.
    ///
    /// With p = R x + t and δp = ω × p − R δc, and A = ∂u/∂x = J R: ∂u/∂ω = −A Rᵀ\[p\]ₓ, ∂u/∂c =
    /// −A, ∂u/∂(ln f) = u − c₀, and with the ideal point x = p/p₃, ∂u/∂k₁ = f |x|² x. A later clock
    /// takes the detection from a later frame, ∂r/∂τ = −v.
    pub fn residual(&self, x: &Vector3<f64>, sight: &Sight) -> Option<Residual> {
        let (pixel, by_point) = self.camera.project_with_jacobian(x)?;
        let (rotation, p) = (self.camera.rotation(), self.camera.to_camera(x));
        let turn = -by_point * rotation.tr_mul(&p.cross_matrix());
        let [cx, cy] = self.camera.principal_point();
        let [fx, fy] = self.camera.focal();
        let mut by_camera = Slope::zeros();
        by_camera.fixed_columns_mut::<3>(0).copy_from(&turn);
        by_camera.fixed_columns_mut::<3>(3).copy_from(&-by_point);
        let ideal = p.xy() / p.z;
        let outward = ideal * ideal.norm_squared();
        by_camera.set_column(ZOOM, &(pixel - Vector2::new(cx, cy)));
        by_camera.set_column(CLOCK, &-sight.speed);
        by_camera.set_column(RADIAL, &Vector2::new(fx * outward.x, fy * outward.y));
        let value = pixel - sight.pixel;
        Some(Residual { value, by_point, by_camera, pixel: p.z / (fx * fy).sqrt() })
    }

    /// The camera after a step.
    /// Errors: [`crate::Error::InvalidInput`] if it is no camera any more.
    pub fn stepped(&self, step: &Step) -> Result<Self> {
        if step.iter().all(|d| *d == 0.0) {
            return Ok(self.clone());
        }
        let rotation = turned(self.camera.rotation(), &step.fixed_rows::<3>(0).into_owned());
        let centre = self.camera.centre() + step.fixed_rows::<3>(3);
        let mut camera = rebuilt(&self.camera, &rotation, &centre, step[ZOOM].exp())?;
        if step[RADIAL] != 0.0 {
            let mut lens = camera.distortion().coefficients();
            lens.resize(lens.len().max(4), 0.0);
            lens[0] += step[RADIAL];
            camera = camera.with_distortion(Distortion::brown_conrady(&lens)?);
        }
        Ok(Self { camera, clock: self.clock + step[CLOCK] })
    }
}

/// The rotation turned by a rotation vector; through the quaternion, so that many turns leave a
/// rotation.
fn turned(rotation: &Matrix3<f64>, by: &Vector3<f64>) -> Matrix3<f64> {
    if *by == Vector3::zeros() {
        return *rotation;
    }
    let turned = Rotation3::new(*by) * Rotation3::from_matrix_unchecked(*rotation);
    let quaternion = UnitQuaternion::from_rotation_matrix(&turned).into_inner();
    UnitQuaternion::new_normalize(quaternion).to_rotation_matrix().into_inner()
}

/// The camera at another place, with its focal lengths multiplied.
pub(super) fn rebuilt(
    camera: &Camera,
    rotation: &Matrix3<f64>,
    centre: &Vector3<f64>,
    zoom: f64,
) -> Result<Camera> {
    let mut k = camera.k();
    k[(0, 0)] *= zoom;
    k[(1, 1)] *= zoom;
    let moved = Camera::new(&k, rotation, &-(rotation * centre), camera.size())?;
    let moved = moved.with_distortion(camera.distortion().clone());
    Ok(match camera.name() {
        Some(name) => moved.with_name(name),
        None => moved,
    })
}

/// The first radial coefficient; 0 of a pinhole.
fn k1(camera: &Camera) -> f64 {
    camera.distortion().coefficients().first().copied().unwrap_or(0.0)
}

/// How one camera differs from another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Change {
    /// Rotation vector about the camera's axes, radians.
    pub turn: Vector3<f64>,
    /// Movement of the centre in the world, mm.
    pub shift: Vector3<f64>,
    /// Factor of the focal length.
    pub zoom: f64,
    /// Frames.
    pub clock: f64,
    /// Difference of k₁.
    pub radial: f64,
}

impl Change {
    /// From `old` to `new`.
    pub fn between(old: &Placed, new: &Placed) -> Self {
        let turn = new.camera.rotation() * old.camera.rotation().transpose();
        // By the quaternion: the cosine of a small angle has no digits of it.
        let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(turn));
        let same = new.camera.rotation() == old.camera.rotation();
        Self {
            turn: if same { Vector3::zeros() } else { turn.scaled_axis() },
            shift: new.camera.centre() - old.camera.centre(),
            zoom: new.camera.focal()[0] / old.camera.focal()[0],
            clock: new.clock - old.clock,
            radial: k1(&new.camera) - k1(&old.camera),
        }
    }

    /// A parameter in the order of [`Step`].
    pub fn parameter(&self, k: usize) -> f64 {
        match k {
            0..3 => self.turn[k],
            3..6 => self.shift[k - 3],
            ZOOM => self.zoom.ln(),
            CLOCK => self.clock,
            _ => self.radial,
        }
    }
}

/// Distance of each camera from the middle of the joints that are known, mm.
pub(super) fn reach(points: &[Vector3<f64>], cameras: &[Placed]) -> Vec<f64> {
    let known = || points.iter().filter(|x| x.x.is_finite());
    let middle = known().sum::<Vector3<f64>>() / known().count().max(1) as f64;
    cameras.iter().map(|placed| (placed.camera.centre() - middle).norm().max(1.0)).collect()
}
