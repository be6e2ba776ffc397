//! Detections as rays: the set of positions that match a detection.
//!
//! An isotropic splat of standard deviation σ projects to Σ = σ² J W Wᵀ Jᵀ, and the residual to r ≈
//! J W (x − y) for the point y of the detection's ray that is nearest to x. J W has the ray as its
//! null space, so that to first order
//!
//! ```text
//! rᵀ (J W Wᵀ Jᵀ)⁻¹ r = |e|²      (J W)ᵀ (J W Wᵀ Jᵀ)⁻¹ (J W) = I − d dᵀ      e = (I − d dᵀ)(x − c)
//! ```
//!
//! with the camera's centre c and the ray's unit direction d. The weight of the closed form
//! (`overlap`, with Σr = Σp = Σ) becomes k = exp(−|e|²/4σ²), and the residual e is *linear* in x:
//! no projection inside the loop, one exp per view and joint. The dilation h (0.3 px²) is only
//! needed for pixels and left out.

use nalgebra::{Matrix3, Vector3};

use crate::camera::Camera;
use crate::detections::Detections;
use crate::matrix3::{ILL_CONDITIONED, Symmetric};

/// One detection as a ray from its camera; by default a missing one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Ray {
    /// The camera's centre c, mm.
    pub centre: Vector3<f64>,
    /// Unit vector d towards the joint.
    pub direction: Vector3<f64>,
    /// Confidence times the view's weight; 0 where missing.
    pub weight: f64,
    /// Angle that one pixel spans, radians: times the range it is a pixel's size in mm.
    pub pixel: f64,
}

/// Position of a point relative to a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offset {
    /// e, from the ray to the point, mm.
    pub across: Vector3<f64>,
    /// Distance along the ray, mm; negative behind the camera.
    pub range: f64,
}

impl Ray {
    /// Whether there is a detection.
    pub fn is_there(&self) -> bool {
        self.weight > 0.0
    }

    /// Position of `x` relative to the ray.
    #[inline]
    pub fn offset(&self, x: &Vector3<f64>) -> Offset {
        let from = x - self.centre;
        let range = self.direction.dot(&from);
        Offset { across: from - self.direction * range, range }
    }

    /// k at `x`; `None` where the detection is missing.
    #[inline]
    pub fn trust(&self, x: &Vector3<f64>, sigma: f64) -> Option<f64> {
        self.is_there().then(|| self.offset(x).weight(sigma))
    }

    /// I − d dᵀ, the information of the detection about the joint.
    #[inline]
    pub fn information(&self) -> Matrix3<f64> {
        Matrix3::identity() - self.direction * self.direction.transpose()
    }
}

impl Offset {
    /// k = exp(−|e|²/4σ²), 0 behind the camera.
    #[inline]
    pub fn weight(&self, sigma: f64) -> f64 {
        if self.range <= 0.0 {
            return 0.0;
        }
        (-0.25 * self.across.norm_squared() / (sigma * sigma)).exp()
    }
}

/// The rays without missing detections.
pub fn there(rays: &[Ray]) -> impl Iterator<Item = &Ray> + Clone {
    rays.iter().filter(|ray| ray.is_there())
}

/// The rays of one frame, the views of each joint contiguous.
#[derive(Debug, Clone, PartialEq)]
pub struct Rays {
    n_views: usize,
    rays: Vec<Ray>,
}

impl Rays {
    /// From ideal pixels. View i has the weight `view_weights[i]` (empty: 1).
    pub fn new(detections: &Detections, cameras: &[Camera], view_weights: &[f64]) -> Self {
        let (m, n) = (cameras.len(), detections.n_joints());
        let mut rays = vec![Ray::default(); m * n];
        for (i, camera) in cameras.iter().enumerate() {
            let centre = camera.centre();
            let ([fx, fy], [cx, cy]) = (camera.focal(), camera.principal_point());
            let view_weight = view_weights.get(i).copied().unwrap_or(1.0);
            for j in 0..n {
                if let Some((p, confidence)) = detections.get(i, j) {
                    let through = Vector3::new((p.x - cx) / fx, (p.y - cy) / fy, 1.0);
                    let cosine = 1.0 / through.norm();
                    rays[j * m + i] = Ray {
                        centre,
                        direction: camera.rotation().tr_mul(&(through * cosine)),
                        weight: confidence * view_weight,
                        pixel: cosine / (fx * fy).sqrt(),
                    };
                }
            }
        }
        Self { n_views: m, rays }
    }

    /// From rays `(N, M)`.
    pub fn of(rays: Vec<Ray>, n_views: usize) -> Self {
        Self { n_views, rays }
    }

    /// Number of views M.
    pub fn n_views(&self) -> usize {
        self.n_views
    }

    /// Number of joints N.
    pub fn n_joints(&self) -> usize {
        self.rays.len() / self.n_views
    }

    /// The rays of joint `j`, one per view.
    pub fn of_joint(&self, j: usize) -> &[Ray] {
        &self.rays[j * self.n_views..(j + 1) * self.n_views]
    }

    /// Mean weight of the detections; 1 if there are none.
    pub fn mean_weight(&self) -> f64 {
        let weights = || there(&self.rays).map(|ray| ray.weight);
        let n = weights().count();
        if n == 0 { 1.0 } else { weights().sum::<f64>() / n as f64 }
    }

    /// With the weights of every view times its factor.
    #[must_use]
    pub fn weighed(&self, factors: &[f64]) -> Self {
        let times = |(ray, factor): (&Ray, &f64)| match ray.is_there() {
            true => Ray { weight: ray.weight * factor, ..*ray },
            false => *ray,
        };
        let rays = self.rays.iter().zip(factors.iter().cycle()).map(times).collect();
        Self { rays, ..*self }
    }

    /// Swaps the detections of joints `a` and `b` in view `i`.
    pub fn swap(&mut self, i: usize, a: usize, b: usize) {
        self.rays.swap(a * self.n_views + i, b * self.n_views + i);
    }
}

/// The place where two rays meet, halfway between them, and their distance there; `None` if they
/// are parallel or one would meet the other behind its camera.
#[inline]
pub fn meet(a: &Ray, b: &Ray) -> Option<(Vector3<f64>, f64)> {
    let normal = a.direction.cross(&b.direction);
    let sin2 = normal.norm_squared();
    let between = b.centre - a.centre;
    let along_a = between.cross(&b.direction).dot(&normal) / sin2;
    let along_b = between.cross(&a.direction).dot(&normal) / sin2;
    if !(sin2 > ILL_CONDITIONED && along_a > 0.0 && along_b > 0.0) {
        return None;
    }
    let middle = 0.5 * (a.centre + a.direction * along_a + b.centre + b.direction * along_b);
    Some((middle, between.dot(&normal).abs() / sin2.sqrt()))
}

/// The point with the least Σ w |e|², or `None` if the rays do not determine it.
pub(crate) fn nearest(rays: &[Ray], weight: impl Fn(&Ray) -> f64) -> Option<Vector3<f64>> {
    let mut sums = Meeting::default();
    rays.iter().for_each(|ray| sums.add(ray, weight(ray)));
    sums.point()
}

/// The normal equations of the point with the least Σ w |e|².
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Meeting {
    /// Σ w.
    weight: f64,
    /// Σ w d dᵀ.
    outer: Symmetric,
    /// Σ w (I − d dᵀ) c.
    pull: Vector3<f64>,
}

impl Meeting {
    /// Adds a ray of weight `w`.
    #[inline]
    pub(crate) fn add(&mut self, ray: &Ray, w: f64) {
        if w > 0.0 {
            let d = &ray.direction;
            let wd = w * d;
            self.outer.add_outer(w, &(*d).into());
            self.weight += w;
            self.pull += w * ray.centre - wd * d.dot(&ray.centre);
        }
    }

    /// |Σ w (I − d dᵀ)|.
    pub(crate) fn determinant(&self) -> f64 {
        let information = self.outer.below(self.weight, 1.0, 0.0);
        information.determinant(&information.cofactors())
    }

    /// Adds a place that weighs `share` times as much as all rays.
    pub(crate) fn tie(&mut self, x: &Vector3<f64>, share: f64) {
        self.pull += share * self.weight * x;
        self.weight += share * self.weight;
    }

    /// The point, or `None` if the rays do not determine it.
    #[inline]
    pub(crate) fn point(&self) -> Option<Vector3<f64>> {
        let information = self.outer.below(self.weight, 1.0, 0.0);
        let cofactors = information.cofactors();
        let (determinant, scale) = (information.determinant(&cofactors), information.trace() / 3.0);
        let x = cofactors.times(&self.pull.into());
        let is_determined = determinant > ILL_CONDITIONED * scale * scale * scale;
        is_determined.then(|| Vector3::from(x) / determinant)
    }
}
