//! Large noise or many wrong detections: which of two solutions the detections support.
//!
//! A kernel that ends narrow explains two or three of four scattered rays and rejects the others; a
//! wide one explains all by larger noise. Either is a model of the same frame: a detection of view
//! i is correct with probability 1 − ε_i and then lies within the noise s, or it is wrong and lies
//! anywhere within S, at most W, the widest kernel,
//!
//! ```text
//! p(e) = (1−ε_i) N₂(e; s²) + ε_i N₂(e; S²)      log p = Σ_ij log p(e_ij) − ½ Σ_j log det H_j + …
//! H_j  = Σ_i r_ij (I − d dᵀ)/s² + I/W²             r = (1−ε_i) N₂(e; s²) / p(e)
//! ```
//!
//! with the joints integrated out by Laplace's method: that two rays nearly meet somewhere is no
//! evidence for small noise, since the volume in which they do so shrinks with it. ε and S maximise
//! log p. Every view has its own ε, since its calibration may be wrong, shrunk towards the mean of
//! all by the weight of two detections. A prior adds −½ (x−x⁰)ᵀ Π (x−x⁰) to log p and Π to H.
//!
//! Wrong detections may agree on another position y, as when several views show another person.
//! They then lie within the noise of y, which lies within W of x: ε_i N₂(e(y); s²) for each and −½
//! log det (W² H_y) − |y−x|²/2W² for y, where that is more.

use super::consensus::best_pair;
use super::rays::{Ray, Rays};
use super::solver::{Annealing, Prior, Solution};
use nalgebra::{Matrix3, Vector3};

/// Rounds of expectation and maximisation for ε.
const ROUNDS: usize = 3;
/// ε at first: one detection in ten is wrong.
const FIRST_SHARE: f64 = 0.1;
/// Least S in multiples of the noise.
const LEAST_REACH: f64 = 2.5;
/// Weight of the mean over all views in ε of one view, in detections.
const SHARED: f64 = 2.0;
/// r below which a detection may belong to another position.
const RIGHT: f64 = 0.5;

/// The shares of wrong detections and their spread.
struct Mixture {
    /// ŝ² for weight 1.
    variance: f64,
    /// S².
    anywhere: f64,
    /// W².
    widest: f64,
    /// ε_i.
    wrong: Vec<f64>,
}

impl Mixture {
    /// The shares and the spread that maximise the likelihood of `solution`, and the share of wrong
    /// detections over all views.
    fn fitted(rays: &Rays, solution: &Solution, widest: f64) -> (Self, f64) {
        let mut mixture = Self {
            variance: solution.variance,
            anywhere: widest,
            widest,
            wrong: vec![FIRST_SHARE; rays.n_views()],
        };
        let least = LEAST_REACH * LEAST_REACH * solution.variance / rays.mean_weight();
        let mut share = FIRST_SHARE;
        let mut of_view = vec![(0.0, 0.0); rays.n_views()];
        for _ in 0..ROUNDS {
            of_view.fill((0.0, 0.0));
            let mut squares = 0.0;
            for (j, x) in solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite()) {
                for (i, ray) in there(rays, j) {
                    let w = 1.0 - mixture.of(i, ray, x).1;
                    squares += w * ray.offset(x).across.norm_squared();
                    of_view[i] = (of_view[i].0 + w, of_view[i].1 + 1.0);
                }
            }
            let (wrong, n) =
                of_view.iter().fold((0.0, 0.0), |(w, n), view| (w + view.0, n + view.1));
            share = (wrong + 1.0) / (n + 2.0);
            for (own, (wrong, n)) in mixture.wrong.iter_mut().zip(&of_view) {
                *own = (wrong + SHARED * share) / (n + SHARED);
            }
            let apart = (squares + 2.0 * widest) / (2.0 * (wrong + 1.0));
            mixture.anywhere = apart.min(widest).max(least);
        }
        (mixture, share)
    }

    /// N₂(e; ŝ²/c) of a ray of weight c, 0 behind its camera, and N₂(e; S²).
    fn densities(&self, ray: &Ray, x: &Vector3<f64>) -> (f64, f64) {
        let offset = ray.offset(x);
        let square = offset.across.norm_squared();
        let normal = |v: f64| (-0.5 * square / v).exp() / (std::f64::consts::TAU * v);
        let near = if offset.range > 0.0 { normal(self.variance / ray.weight) } else { 0.0 };
        (near, normal(self.anywhere))
    }

    /// (p(e), r).
    fn of(&self, view: usize, ray: &Ray, x: &Vector3<f64>) -> (f64, f64) {
        let (near, anywhere) = self.densities(ray, x);
        let right = (1.0 - self.wrong[view]) * near;
        let p = (right + self.wrong[view] * anywhere).max(f64::MIN_POSITIVE);
        (p, right / p)
    }

    /// log p of wrong rays that agree on another position; minus infinity if no two do.
    fn of_another_place(&self, wrong: &[(usize, Ray)], x: &Vector3<f64>) -> f64 {
        let rays: Vec<Ray> = wrong.iter().map(|(_, ray)| *ray).collect();
        let sigma = Annealing::PER_NOISE * self.noise(&rays);
        let Some((y, _)) = best_pair(&rays, x, sigma) else { return f64::NEG_INFINITY };
        let mut information = Matrix3::identity();
        let mut log_p = -0.5 * (y - x).norm_squared() / self.widest;
        for (view, ray) in wrong {
            let (near, anywhere) = self.densities(ray, &y);
            let p = (self.wrong[*view] * (near + anywhere)).max(f64::MIN_POSITIVE);
            log_p += p.ln();
            let share = self.wrong[*view] * near / p;
            information += ray.information() * (share * ray.weight * self.widest / self.variance);
        }
        log_p - 0.5 * information.determinant().ln()
    }

    /// ŝ of a ray of the mean weight of these, mm.
    fn noise(&self, rays: &[Ray]) -> f64 {
        let mean = rays.iter().map(|ray| ray.weight).sum::<f64>() / rays.len() as f64;
        (self.variance / mean).sqrt()
    }
}

/// The rays of joint `j`, without missing ones, with their views.
fn there(rays: &Rays, j: usize) -> impl Iterator<Item = (usize, &Ray)> {
    rays.of_joint(j).iter().enumerate().filter(|(_, ray)| ray.is_there())
}

/// The evidence for a solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evidence {
    /// log p up to a constant common to all solutions with the same set of positioned joints.
    pub log: f64,
    /// The share of wrong detections of all views.
    pub wrong: f64,
}

/// The evidence of the frame, and of its `priors`, for `solution`; `widest` is W, mm.
pub fn evidence(
    rays: &Rays,
    solution: &Solution,
    priors: Option<&[Prior]>,
    widest: f64,
) -> Evidence {
    let placed = || solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite());
    let widest = widest * widest;
    let (mixture, share) = Mixture::fitted(rays, solution, widest);
    let of_joint = |(j, x): (usize, &Vector3<f64>)| {
        let mut information = Matrix3::from_diagonal_element(1.0 / widest);
        let (mut log_p, mut of_wrong) = (0.0, 0.0);
        let mut wrong = Vec::new();
        for (i, ray) in there(rays, j) {
            let (p, right) = mixture.of(i, ray, x);
            if right < RIGHT {
                wrong.push((i, *ray));
                of_wrong += p.ln();
            } else {
                log_p += p.ln();
            }
            information += ray.information() * (right * ray.weight / mixture.variance);
        }
        if wrong.len() > 1 {
            of_wrong = of_wrong.max(mixture.of_another_place(&wrong, x));
        }
        if let Some(prior) = priors.map(|p| &p[j]) {
            let off = x - prior.mean;
            log_p -= 0.5 * off.dot(&(prior.precision * off));
            information += prior.precision;
        }
        log_p + of_wrong - 0.5 * information.determinant().ln()
    };
    Evidence { log: placed().map(of_joint).sum(), wrong: share }
}
