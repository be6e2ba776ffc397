//! The methods of one frame, with any detections of any cameras.

use proptest::prelude::*;
use skelsplat_core::{
    Detections, Frame, PaperSettings, RefineConfig, Refiner, TriangulationMethod, Unit, triangulate,
};
use skelsplat_tests::scenes::refiner;

use super::any::{
    any_number, cameras, config, coordinate, detections, sound, spoiled, threaded, wrong,
};

proptest! {
    #![proptest_config(config(16))]

    #[test]
    fn any_detections_have_a_sound_pose((cameras, seen) in cameras(1..=5).prop_flat_map(|c| {
        let seen = detections(c.len(), 17);
        (Just(c), seen)
    })) {
        let found = threaded(&cameras, 1).refine(&Frame::from(seen.clone())).unwrap();
        sound(&found)?;
        for (name, method) in TriangulationMethod::ALL {
            let points = triangulate(&seen, &cameras, Unit::Millimetre, *method).unwrap().points;
            prop_assert!(points.iter().all(|x| x.iter().all(|v| !v.is_infinite())), "{name}");
        }
    }

    #[test]
    fn a_person_with_wrong_detections_has_a_sound_pose(
        cameras in cameras(1..=6), seed in any::<u32>(), sigma in 0.0..30.0_f64, wrong in wrong(60),
    ) {
        let seen = spoiled(&cameras, u64::from(seed), sigma, &wrong);
        let found = threaded(&cameras, 1).refine(&Frame::from(seen.clone())).unwrap();
        sound(&found)?;
    }

    /// Few joints, of no layout, from any start.
    #[test]
    fn any_start_has_a_sound_end(
        (cameras, seen) in cameras(2..=4).prop_flat_map(|c| {
            let seen = detections(c.len(), 3);
            (Just(c), seen)
        }),
        start in prop::collection::vec(coordinate(), 9),
        unit in prop::sample::select(vec![Unit::Millimetre, Unit::Metre]),
    ) {
        let init = start.chunks_exact(3).map(nalgebra::Vector3::from_column_slice).collect();
        let frame = Frame { init_pose: Some(init), ..Frame::from(seen) };
        let refiner = Refiner::new(&cameras, unit, None, RefineConfig::default()).unwrap();
        if let Ok(found) = refiner.refine(&frame) {
            sound(&found)?;
        }
    }

    /// The published method, a few steps of it.
    #[test]
    fn the_published_method_has_a_sound_end(
        cameras in cameras(2..=4), seed in any::<u32>(), sigma in 0.0..30.0_f64, wrong in wrong(30),
    ) {
        let seen = spoiled(&cameras, u64::from(seed), sigma, &wrong);
        let settings = PaperSettings { max_steps: 5, resolution: 0.2, ..PaperSettings::default() };
        let config = RefineConfig { n_threads: Some(1), ..RefineConfig::from(settings) };
        if let Ok(found) = refiner(&cameras, config).refine(&Frame::from(seen.clone())) {
            sound(&found)?;
        }
    }

    #[test]
    fn detections_are_refused_or_kept(
        pixels in prop::collection::vec(any_number(), 12),
        c in prop::collection::vec(any_number(), 6),
    ) {
        if let Ok(found) = Detections::new(2, 3, &pixels, Some(&c)) {
            for (view, joint) in (0..2).flat_map(|i| (0..3).map(move |j| (i, j))) {
                let kept = found.get(view, joint);
                prop_assert!(kept.is_none_or(|(p, c)| p.amax().is_finite() && c > 0.0 && c <= 1.0));
            }
        }
    }
}
