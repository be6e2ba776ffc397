//! Every analytic gradient against central differences.
//!
//! Projection, covariance and symmetry are smooth: with step h the difference quotient is off by
//! O(h²) and by rounding of about ulp/h, which at h = 1e-4..1e-5 of the parameter's scale leaves
//! 1e-7 relative. The rendering loss is smooth as long as no pixel crosses the 1/255 cut; a step of
//! 1e-6 mm makes such a crossing unlikely and the scenes below have none, so the tolerance is the
//! 1e-5 that rounding (ulp·L/h) leaves.

use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3, Vector4};
use skelsplat_core::study::gaussian::Gaussian;
use skelsplat_core::study::paper::{Encoding, Renderer};
use skelsplat_core::study::projection::View;
use skelsplat_core::study::symmetry::symmetry;
use skelsplat_core::{PaperSettings, RefineConfig};
use skelsplat_tests::differences::{central_differences, relative_error};
use skelsplat_tests::scenes::{
    Noise, h36m, look_at, noisy_detections, perturbed, refiner, room, standing,
};

fn tilted(mean: Vector3<f64>) -> Gaussian {
    Gaussian {
        mean,
        log_scales: Vector3::new(3.0, 2.6, 3.3),
        quaternion: Vector4::new(0.9, -0.3, 0.5, 0.2),
    }
}

/// A fixed symmetric matrix to weigh covariances with.
fn weights() -> Matrix3<f64> {
    Matrix3::new(0.7, -0.2, 0.4, -0.2, 1.3, 0.1, 0.4, 0.1, -0.6)
}

#[test]
fn covariance_in_log_scales_and_quaternion() {
    let g = tilted(Vector3::zeros());
    let (d_log, d_q) = g.covariance_backward(&weights());
    let at = [g.log_scales.as_slice(), g.quaternion.as_slice()].concat();
    let numeric = central_differences(&at, 1e-5, |x| {
        let g = Gaussian {
            log_scales: Vector3::from_column_slice(&x[..3]),
            quaternion: Vector4::from_column_slice(&x[3..]),
            ..g
        };
        g.covariance().component_mul(&weights()).sum()
    });
    let analytic = [d_log.as_slice(), d_q.as_slice()].concat();
    assert!(relative_error(&analytic, &numeric) < 1e-7);
}

/// Through m and through J, with the mean in the middle of the image and beyond the clamp.
#[test]
fn projection_in_mean_and_covariance() {
    let camera = look_at(Vector3::new(0.0, -3000.0, 0.0), Vector3::zeros(), 900.0, [640, 480]);
    let view = View::new(&camera);
    let (a, b) = (Vector2::new(0.3, -0.8), Matrix2::new(0.2, 0.5, 0.5, -0.4));
    for mean in [[150.0, 40.0, -90.0], [2500.0, 100.0, 60.0], [-300.0, 50.0, 2400.0]] {
        let g = tilted(Vector3::from(mean));
        let covariance = g.covariance();
        let projected = view.project(&g.mean, &covariance, 0.3).unwrap();
        let (d_mean, d_cov) = view.backward(&projected, &covariance, &a, &b);
        let value = |mean: &Vector3<f64>, covariance: &Matrix3<f64>| {
            let p = view.project(mean, covariance, 0.3).unwrap();
            p.mean.dot(&a) + p.covariance.component_mul(&b).sum()
        };
        let numeric = central_differences(g.mean.as_slice(), 1e-3, |x| {
            value(&Vector3::from_column_slice(x), &covariance)
        });
        assert!(relative_error(d_mean.as_slice(), &numeric) < 1e-7, "mean {mean:?}");
        let numeric = central_differences(covariance.as_slice(), 1e-2, |x| {
            value(&g.mean, &Matrix3::from_column_slice(x))
        });
        assert!(relative_error(d_cov.as_slice(), &numeric) < 1e-7, "covariance {mean:?}");
    }
}

#[test]
fn symmetry_in_the_means() {
    let pairs: Vec<_> = h36m().symmetric_pairs(3).collect();
    assert_eq!(pairs.len(), 6);
    let pose = perturbed(&standing(), 30.0, &mut Noise::new(3));
    let mut analytic = vec![0.0; 3 * pose.len()];
    symmetry(
        |j| pose[j],
        &pairs,
        |j, g| {
            (0..3).for_each(|k| analytic[3 * j + k] += g[k]);
        },
    );
    let flat: Vec<f64> = pose.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
    let numeric = central_differences(&flat, 1e-3, |x| {
        symmetry(|j| Vector3::from_column_slice(&x[3 * j..3 * j + 3]), &pairs, |_, _| ())
    });
    assert!(relative_error(&analytic, &numeric) < 1e-7);
}

/// Through render, masked L2 and symmetry, for every parameter, encoding and symmetry tier.
#[test]
fn total_loss_in_every_parameter() {
    let cameras = room(4);
    let mut noise = Noise::new(11);
    let detections = noisy_detections(&standing(), &cameras, 2.0, &mut noise);
    let gaussians: Vec<Gaussian> =
        perturbed(&standing(), 12.0, &mut noise).into_iter().map(tilted).collect();
    let targets: Vec<_> = standing()
        .into_iter()
        .map(|mean| (mean, Gaussian::isotropic(mean, 20.0).covariance()))
        .collect();
    for (renderer, encoding, tier) in [
        (Renderer::Raster, Encoding::OneHot, 1),
        (Renderer::Raster, Encoding::OneHot, 3),
        (Renderer::Raster, Encoding::Single, 2),
        (Renderer::Raster, Encoding::Rgb, 0),
        (Renderer::ClosedForm, Encoding::OneHot, 1),
    ] {
        let paper = PaperSettings { renderer, encoding, ..PaperSettings::default() };
        let config = RefineConfig { symmetry_tier: tier, ..RefineConfig::from(paper) };
        let refiner = refiner(&cameras, config);
        let of = |gaussians: &[Gaussian]| {
            let (targets, cancel) = (Some(targets.clone()), AtomicBool::new(false));
            refiner.loss_and_gradient(gaussians, &detections, targets, &cancel).unwrap()
        };
        let gradient = of(&gaussians).gradient;
        // One joint of the trunk and one of each side is enough: the others run through the same
        // code.
        for j in [0, 3, 13] {
            let g = &gaussians[j];
            let at = [g.mean.as_slice(), g.log_scales.as_slice(), g.quaternion.as_slice()].concat();
            let groups = [(0..3, 1e-4), (3..6, 1e-6), (6..10, 1e-6)];
            for (group, h) in groups {
                let numeric = central_differences(&at[group.clone()], h, |x| {
                    let mut flat = at.clone();
                    flat[group.clone()].copy_from_slice(x);
                    let mut moved = gaussians.clone();
                    moved[j] = Gaussian {
                        mean: Vector3::from_column_slice(&flat[..3]),
                        log_scales: Vector3::from_column_slice(&flat[3..6]),
                        quaternion: Vector4::from_column_slice(&flat[6..]),
                    };
                    of(&moved).loss.total
                });
                let d = &gradient[j];
                let analytic =
                    [d.mean.as_slice(), d.log_scales.as_slice(), d.quaternion.as_slice()].concat();
                let error = relative_error(&analytic[group.clone()], &numeric);
                assert!(
                    error < 1e-5,
                    "{encoding:?}, tier {tier}, joint {j}, {group:?}: {error:.2e}"
                );
            }
        }
    }
}
