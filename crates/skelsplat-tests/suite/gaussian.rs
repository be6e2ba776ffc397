//! Gaussians and covariances that are none.

use nalgebra::{Matrix3, Vector3, Vector4};
use skelsplat_core::study::gaussian::{Gaussian, check_covariances};
use skelsplat_tests::refused;

#[test]
fn what_is_no_gaussian_is_named() {
    let mut gaussians = [Gaussian::isotropic(Vector3::zeros(), 20.0); 2];
    assert_eq!(Gaussian::check(&gaussians), Ok(()));
    gaussians[1].log_scales.z = 60.0;
    assert_eq!(refused(Gaussian::check(&gaussians)), "log_scales[1, 2]");
    gaussians[0].quaternion = Vector4::zeros();
    assert_eq!(refused(Gaussian::check(&gaussians)), "quaternions[0]");
}

#[test]
fn what_is_no_covariance_is_named() {
    let missing = Matrix3::repeat(f64::NAN);
    let mut covariances = [Matrix3::identity(), missing, Matrix3::identity()];
    assert_eq!(check_covariances("c", &covariances), Ok(()));
    covariances[2][(0, 1)] = 0.5;
    assert_eq!(refused(check_covariances("c", &covariances)), "c[2]");
    covariances[0][(1, 1)] = -2.0;
    assert_eq!(refused(check_covariances("c", &covariances)), "c[0]");
}
