//! The pixels of a splat, row by row.

use nalgebra::{Matrix2, Vector2};
use skelsplat_core::study::paper::rows::{Group, LANES, Pixel, RowTable};
use skelsplat_core::study::paper::splat::{CUT, Splat};

#[test]
fn the_cut_is_where_a_splat_falls_to_1_in_255() {
    assert!((CUT - 2.0 * 255.0_f64.ln()).abs() < 1e-14);
}

/// Every pixel of the image, one by one, against the spans.
#[test]
fn rows_hold_exactly_the_pixels_inside_the_ellipse() {
    let size = [40, 30];
    let covariance = Matrix2::new(30.0, 12.0, 12.0, 9.0);
    for mean in [[20.3, 14.8], [-3.0, 5.0], [39.0, 33.0], [80.0, 80.0]].map(Vector2::from) {
        let splat = Splat::new(mean, &covariance, size).unwrap();
        let mut covered = 0;
        for (v, row) in splat.covered_rows() {
            covered += row.span.len();
            assert!((0..30).contains(&v) && row.span.start >= 0 && row.span.end <= 40);
        }
        let inside = |u: i32, v: i32| {
            let x = Vector2::new(f64::from(u), f64::from(v)) - mean;
            (x.transpose() * splat.conic * x)[0] <= CUT
        };
        let expected = (0..30).flat_map(|v| (0..40).map(move |u| (u, v)));
        assert_eq!(covered, expected.filter(|(u, v)| inside(*u, *v)).count(), "{mean}");
    }
}

/// Largest relative error against exp, over rows of every width from one pixel to a whole
/// image.
fn worst<P: Pixel>() -> f64 {
    let mut worst = 0.0_f64;
    for sigma in [0.55, 1.0, 2.4, 5.0, 20.0, 100.0, 300.0] {
        let a = 1.0 / (sigma * sigma);
        let reach = (2.0 * 255.0_f64.ln() / a).sqrt();
        let (d, e) = (-reach + 0.3, 0.01);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "small and positive"
        )]
        let len = (2.0 * reach - 0.3).floor() as usize + 1;
        RowTable::<P>::new(a).for_each(d, e, len, |k, group| {
            let first = k * LANES;
            for (l, g) in group.lanes().iter().enumerate().take(len - first) {
                #[allow(clippy::cast_precision_loss, reason = "small")]
                let x = d + (first + l) as f64;
                let exact = (-0.5 * (a * x * x + e)).exp();
                worst = worst.max((g.wide() - exact).abs() / exact);
            }
        });
    }
    worst
}

#[test]
fn recurrence_follows_exp() {
    // k²/2 = 32 ulp, k = 8 times the error of the first r, a product of three rounded factors
    // (2 ulp), and as much once for the start.
    let single = 32.0 + 8.0 * 2.0 + 2.0;
    assert!(worst::<f32>() / 2.0_f64.powi(-24) < single, "{}", worst::<f32>());
    // Doubles are also affected by the rounding of the exponents, unlike f32 factors: the
    // exponents of the start add up to ½ a d² + a |d| l + ½ a l² < 5.6 + 43 + 81 at the
    // smallest σ here, 0.55 px, each off by half an ulp of itself, hence the exponential by as
    // many ulp of its own.
    let double = single + 0.5 * 130.0 * 2.0;
    assert!(worst::<f64>() / 2.0_f64.powi(-53) < double, "{}", worst::<f64>());
}

#[test]
fn lanes_beyond_the_row_are_zero() {
    RowTable::<f64>::new(0.1).for_each(-2.0, 0.0, 11, |k, group| {
        let group = group.lanes();
        if k == 1 {
            assert!(group[..3].iter().all(|g| *g > 0.0) && group[3..].iter().all(|g| *g == 0.0));
        }
    });
}
