//! Cameras set right, from any detections.

use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use skelsplat_core::testing::scenes::{Noise, noisy_detections, room, standing};
use skelsplat_core::{
    Adjustable, Camera, Detections, Progress, RefineConfig, Unit, adjust_cameras,
};

use crate::any::{cameras, config, detections, wrong};

fn anything() -> impl Strategy<Value = (Vec<Camera>, Vec<Detections>)> {
    cameras(2..=4).prop_flat_map(|c| {
        let frames = prop::collection::vec(detections(c.len(), 17), 2..=6);
        (Just(c), frames)
    })
}

/// A person who moves, and one camera that was turned.
fn knocked() -> impl Strategy<Value = (Vec<Camera>, Vec<Detections>)> {
    let turn = prop::array::uniform3(-0.2..0.2_f64);
    (2..=4_u32, turn, 8..=16_usize, any::<u32>(), 0.0..6.0_f64, wrong(40)).prop_map(
        |(views, turn, frames, seed, sigma, wrong)| {
            let mut cameras = room(views);
            let mut noise = Noise::new(u64::from(seed) + 1);
            let frame = |t: usize| {
                let (at, to) = (
                    Vector3::new(80.0 * t as f64 - 500.0, 300.0, 0.0),
                    Rotation3::from_euler_angles(0.0, 0.0, 0.1 * t as f64),
                );
                let body: Vec<_> = standing().into_iter().map(|x| to * x + at).collect();
                let seen = noisy_detections(&body, &cameras, sigma, &mut noise);
                let n = seen.n_joints();
                let mut pixels: Vec<f64> = (0..cameras.len() * n)
                    .flat_map(|k| seen.get(k / n, k % n).map_or([f64::NAN; 2], |(p, _)| p.into()))
                    .collect();
                for (k, value) in wrong.iter().filter(|(k, _)| k % frames == t) {
                    let k = k % pixels.len();
                    pixels[k] = *value;
                }
                Detections::new(cameras.len(), n, &pixels, None).unwrap()
            };
            let seen = (0..frames).map(frame).collect();
            let rotation = Rotation3::new(Vector3::from(turn)) * cameras[1].rotation();
            cameras[1] = Camera::new(
                &cameras[1].k(),
                &rotation,
                &-(rotation * cameras[1].centre()),
                cameras[1].size(),
            )
            .unwrap();
            (cameras, seen)
        },
    )
}

proptest! {
    #![proptest_config(config(3))]

    #[test]
    fn any_recording_leaves_sound_cameras(
        (cameras, seen) in prop_oneof![anything(), knocked()], focal in any::<bool>(), clock in any::<bool>(),
    ) {
        let what = Adjustable { free: None, focal, clock };
        let found = adjust_cameras(&cameras, Unit::Millimetre, &seen, &what, &RefineConfig::default(), &Progress::default());
        if let Ok(found) = found {
            for camera in &found.cameras {
                // The same checks as for those of users.
                prop_assert!(Camera::new(&camera.k(), camera.rotation(), camera.translation(), camera.size()).is_ok());
            }
            for one in &found.report {
                prop_assert!((0..8).all(|k| one.change.parameter(k).is_finite()), "{one:?}");
            }
        }
    }
}
