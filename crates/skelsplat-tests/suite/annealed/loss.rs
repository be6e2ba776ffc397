//! The loss: its weight is the closed form's, its steps follow its gradient.

use super::*;
use skelsplat_core::study::annealed::solver::{Terms, gradient};
use skelsplat_core::study::bones::{Bone, Length, Pull};

/// With the ray's nearest point y, r = (z_x / z_y) J W (x − y) holds exactly, and (J W)⁺ forgets
/// what lies along x − c, so that rᵀΣ⁻¹r = (z_x / z_y)² |e|² cos²θ / σ² with tan θ = |e| / range.
/// Both factors differ from 1 by |e| / z or less.
#[test]
fn the_weight_is_that_of_the_closed_form_to_first_order() {
    let sigma = 40.0;
    let mut noise = Noise::new(5);
    for camera in room(3) {
        let view = View::new(&camera);
        for _ in 0..200 {
            let x = noise.vector(400.0) + Vector3::new(0.0, 0.0, 900.0);
            let seen = x + noise.vector(60.0);
            let pixel = camera.project(&seen).unwrap();
            let splat =
                view.project(&x, &Matrix3::from_diagonal_element(sigma * sigma), 0.0).unwrap();
            let target = PlaneGaussian { mean: pixel, covariance: splat.covariance };
            let render = PlaneGaussian { mean: splat.mean, covariance: splat.covariance };
            let closed = render.overlap(&target).unwrap().weight;

            let detections = Detections::new(1, 1, &[pixel.x, pixel.y], None).unwrap();
            let rays = Rays::new(&detections, std::slice::from_ref(&camera), &[]);
            let offset = rays.of_joint(0)[0].offset(&x);
            let weight = offset.weight(sigma);

            let (e, z) = (offset.across.norm(), camera.to_camera(&x).z);
            let nearest = camera.to_camera(&(x - offset.across)).z;
            let factor = (z / nearest).powi(2) / (1.0 + (e / offset.range).powi(2));
            assert!((closed.ln() / weight.ln() - factor).abs() < 1e-9);
            assert!(
                (closed.ln() / weight.ln() - 1.0).abs()
                    < 2.0 * e / nearest + 2.0 * (e / nearest).powi(2)
            );
            // k ln k is −1/e at most.
            assert!((closed - weight).abs() < 0.37 * 2.1 * e / nearest);
        }
    }
}

const BONES: [Bone; 2] = [
    Bone { joints: [11, 12], length: Length { mean: 300.0, sigma: 25.0 } },
    Bone { joints: [12, 13], length: Length { mean: 240.0, sigma: 30.0 } },
];

/// F with Welsch losses for the detections, for the limbs and for the bones, from
/// which the weights k and κ derive.
fn objective(
    rays: &Rays,
    priors: &[Prior],
    x: &[Vector3<f64>],
    sigma: f64,
    noise: f64,
    symmetry_sigma: f64,
) -> f64 {
    let mut f = 0.0;
    for (j, x) in x.iter().enumerate() {
        for ray in rays.of_joint(j).iter().filter(|ray| ray.is_there()) {
            f += ray.weight * 2.0 * (sigma / noise).powi(2) * (1.0 - ray.offset(x).weight(sigma));
        }
        let from = x - priors[j].mean;
        f += 0.5 * from.dot(&(priors[j].precision * from));
    }
    for ([a, b], [c, d]) in LIMBS {
        let difference = (x[a] - x[b]).norm() - (x[c] - x[d]).norm();
        let reach = 3.0 * symmetry_sigma;
        f += (reach / symmetry_sigma).powi(2) * (1.0 - (-0.5 * (difference / reach).powi(2)).exp());
    }
    for bone in &BONES {
        let [a, b] = bone.joints;
        f += Pull::new(&x[a], &x[b], bone.length).loss;
    }
    f
}

#[test]
fn what_the_step_follows_is_the_gradient_of_f() {
    let (cameras, mut noise) = (room(4), Noise::new(6));
    let detections = noisy_detections(&standing(), &cameras, 6.0, &mut noise);
    let rays = Rays::new(&detections, &cameras, &[1.0, 0.7, 1.0, 0.3]);
    let at = perturbed(&standing(), 25.0, &mut noise);
    let precision = Matrix3::new(2e-3, 4e-4, 0.0, 4e-4, 1e-3, -3e-4, 0.0, -3e-4, 3e-3);
    let priors: Vec<Prior> = at
        .iter()
        .map(|x| Prior { mean: x + noise.vector(20.0), precision, spread: 40.0 })
        .collect();
    for (sigma, s) in [(320.0, 12.0), (40.0, 12.0), (25.0, 5.0)] {
        let annealing =
            Annealing { noise: NoiseModel::Millimetres(s), ..Annealing::of_joints(at.len()) };
        let terms = Terms {
            pairs: &LIMBS,
            bones: &BONES,
            annealing: &annealing,
            enter: f64::INFINITY,
            tolerance: annealing.tolerance,
            follows_noise: false,
        };
        let found = gradient(&rays, &terms, &priors, &at, sigma);
        let symmetry_sigma = annealing.symmetry_sigma;
        let numeric = central_differences(&flat(&at), 1e-3, |x| {
            objective(
                &rays,
                &priors,
                &points(x),
                sigma,
                s * rays.mean_weight().sqrt(),
                symmetry_sigma,
            )
        });
        // F is some 1e3 and its gradient 1 per mm: rounding leaves 1e-10, truncation (h/σ)² = 2e-9.
        assert!(relative_error(&found, &numeric) < 1e-7, "σ = {sigma}");
    }
}
