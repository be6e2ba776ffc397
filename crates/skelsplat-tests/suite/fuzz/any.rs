//! Arbitrary inputs, and what a sound result is.

use nalgebra::{SymmetricEigen, Vector3};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use skelsplat_core::{
    Camera, Detections, Distortion, JointStatus, RefineConfig, Refinement, Refiner, StopReason,
};
use skelsplat_tests::scenes::{Noise, look_at, noisy_detections, refiner, standing};

/// So many cases of one seed; with `PROPTEST_CASES`, as many times more as that is above 16, of any
/// seed.
pub(crate) fn config(cases: u32) -> ProptestConfig {
    let given = ProptestConfig::default();
    let more = std::env::var_os("PROPTEST_CASES").map(|_| given.cases.div_ceil(16));
    let seed = if more.is_some() { given.rng_seed } else { RngSeed::Fixed(2026) };
    let cases = cases * more.unwrap_or(1);
    ProptestConfig { cases, failure_persistence: None, rng_seed: seed, ..given }
}

/// Any double: NaN, infinities, subnormal and huge numbers included.
pub(crate) fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -2000.0..2000.0_f64,
        2 => -1.0..1.0_f64,
        1 => prop::num::f64::ANY,
        1 => prop::sample::select(vec![
            0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MAX, f64::MIN_POSITIVE,
            5e-324, 1e30, -1e30, 1e12, 1e-12,
        ]),
    ]
}

/// A pixel's coordinate that is accepted: near the image, far away, tiny or missing.
pub(crate) fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => 0.0..1000.0_f64,
        2 => -3000.0..4000.0_f64,
        1 => prop::sample::select(vec![f64::NAN, 0.0, 5e-324, 1e-300, 1e6, 1e12, -1e30, 1e30]),
    ]
}

pub(crate) fn lens() -> impl Strategy<Value = Distortion> {
    let small = |n: usize| prop::collection::vec(-0.3..0.3_f64, n);
    prop_oneof![
        Just(Distortion::None),
        prop::sample::select(vec![4_usize, 5, 8, 12, 14])
            .prop_flat_map(small)
            .prop_filter_map("a lens", |c| Distortion::brown_conrady(&tamed(c)).ok()),
        small(4).prop_filter_map("a lens", |c| Distortion::fisheye(&c).ok()),
    ]
}

/// Tangential, prism and tilt coefficients as small as those of lenses.
fn tamed(mut c: Vec<f64>) -> Vec<f64> {
    for k in [2, 3, 8, 9, 10, 11, 12, 13] {
        if let Some(v) = c.get_mut(k) {
            *v *= 0.05;
        }
    }
    c
}

/// One to six cameras anywhere that look somewhere near the origin; some in one place.
pub(crate) fn cameras(n: std::ops::RangeInclusive<usize>) -> impl Strategy<Value = Vec<Camera>> {
    let at = prop_oneof![
        6 => prop::array::uniform3(-5000.0..5000.0_f64),
        1 => prop::sample::select(vec![
            [3000.0, 0.0, 1000.0], [3000.0, 0.001, 1000.0], [0.0, 0.0, 4000.0],
        ]),
    ];
    let towards = prop::array::uniform3(-400.0..400.0_f64);
    let focal = prop_oneof![6 => 300.0..3000.0_f64, 1 => 1e-3..1e7_f64];
    let one = (at, towards, focal, lens()).prop_filter_map("a camera", |(at, to, focal, lens)| {
        let (at, to) = (Vector3::from(at), Vector3::from(to));
        let along = to - at;
        (along.norm() > 100.0 && along.xy().norm() > 1.0)
            .then(|| look_at(at, to, focal, [1000, 1000]).with_distortion(lens))
    });
    prop::collection::vec(one, n)
}

/// Pixels and confidences `(M, N)` that [`Detections::new`] accepts.
pub(crate) fn detections(m: usize, n: usize) -> impl Strategy<Value = Detections> {
    let extreme = prop::sample::select(vec![0.0, 1.0, f64::NAN, 5e-324]);
    let confidence = prop_oneof![4 => 0.0..=1.0_f64, 1 => extreme];
    (prop::collection::vec(coordinate(), 2 * m * n), prop::collection::vec(confidence, m * n))
        .prop_map(move |(pixels, c)| Detections::new(m, n, &pixels, Some(&c)).unwrap())
}

/// The standing body where the cameras are, seen with noise and with some coordinates replaced.
pub(crate) fn spoiled(
    cameras: &[Camera],
    seed: u64,
    sigma: f64,
    wrong: &[(usize, f64)],
) -> Detections {
    let exact = noisy_detections(&standing(), cameras, sigma, &mut Noise::new(seed + 1));
    replaced(&exact, wrong.iter().copied())
}

/// `detections` with some coordinates, counted through all, replaced.
pub(crate) fn replaced(
    detections: &Detections,
    wrong: impl Iterator<Item = (usize, f64)>,
) -> Detections {
    let (m, n) = (detections.n_views(), detections.n_joints());
    let mut pixels: Vec<f64> = (0..m * n)
        .flat_map(|k| detections.get(k / n, k % n).map_or([f64::NAN; 2], |(p, _)| p.into()))
        .map(|v| if v.abs() <= 1e30 { v } else { f64::NAN })
        .collect();
    for (k, value) in wrong {
        let k = k % pixels.len();
        pixels[k] = value;
    }
    Detections::new(m, n, &pixels, None).unwrap()
}

/// Places of coordinates and what replaces them.
pub(crate) fn wrong(most: usize) -> impl Strategy<Value = Vec<(usize, f64)>> {
    prop::collection::vec(
        (any::<prop::sample::Index>().prop_map(|i| i.index(100_000)), coordinate()),
        0..=most,
    )
}

pub(crate) fn threaded(cameras: &[Camera], n_threads: usize) -> Refiner {
    refiner(cameras, RefineConfig { n_threads: Some(n_threads), ..RefineConfig::default() })
}

/// A sample of cases with their detections.
pub(crate) type Recording = (Vec<Camera>, Vec<Detections>);

/// Cameras anywhere, and any detections of a few frames.
pub(crate) fn any_recording(
    views: std::ops::RangeInclusive<usize>,
    frames: std::ops::RangeInclusive<usize>,
) -> impl Strategy<Value = Recording> {
    cameras(views).prop_flat_map(move |c| {
        let frames = prop::collection::vec(detections(c.len(), 17), frames.clone());
        (Just(c), frames)
    })
}

/// A joint that is sure is somewhere, with error bars that are positive definite, and where
/// anything is seen, its noise is known. A joint can be weak and nowhere: seen by one view, or by
/// two whose rays meet behind them.
pub(crate) fn sound(found: &Refinement) -> Result<(), TestCaseError> {
    let joints = found.pose.iter().zip(&found.uncertainty).zip(&found.joint_status);
    for (j, ((at, spread), status)) in joints.enumerate() {
        let placed = at.iter().all(|v| v.is_finite());
        let sure = matches!(status, JointStatus::Ok | JointStatus::Inferred);
        prop_assert!(placed || !sure, "joint {j} {status:?} at {at:?}");
        prop_assert!(placed || at.iter().all(|v| v.is_nan()), "joint {j} at {at:?}");
        if *status == JointStatus::Ok {
            let scaled = spread / spread.amax();
            let least = SymmetricEigen::new(scaled).eigenvalues.min();
            prop_assert!(spread.amax().is_finite() && least > 0.0, "joint {j}: {spread:?}");
        }
    }
    let nothing = found.stop_reason == StopReason::NoObservations;
    prop_assert!(found.noise.is_finite() || nothing, "noise {}", found.noise);
    let weights = found.view_weights.iter();
    prop_assert!(weights.clone().all(|k| k.is_nan() || (0.0..=1.0).contains(k)), "{weights:?}");
    prop_assert!(!found.loss.total.is_infinite());
    Ok(())
}
