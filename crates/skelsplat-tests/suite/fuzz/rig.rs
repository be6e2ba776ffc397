//! Cameras set right, from any detections.

use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use skelsplat_core::{Adjustable, Camera, Filmed, Progress, RefineConfig, Unit, adjust_cameras};
use skelsplat_tests::scenes::{Noise, noisy_detections, room, standing};

use super::any::{Recording, any_recording, config, replaced, wrong};

/// A person who moves, and one camera that was turned.
fn knocked() -> impl Strategy<Value = Recording> {
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
                replaced(&seen, wrong.iter().copied().filter(|(k, _)| k % frames == t))
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
        (cameras, seen) in prop_oneof![any_recording(2..=4, 2..=6), knocked()],
        focal in any::<bool>(),
        clock in any::<bool>(),
    ) {
        let what = Adjustable { free: None, focal, clock };
        let (config, progress) = (RefineConfig::default(), Progress::default());
        let times: Vec<usize> = (0..seen.len()).collect();
        let filmed = Filmed { frames: &seen, times: &times };
        let found = adjust_cameras(&cameras, Unit::Millimetre, filmed, &what, &config, &progress);
        if let Ok(found) = found {
            // The same checks as for those of users.
            let made = |c: &Camera| Camera::new(&c.k(), c.rotation(), c.translation(), c.size());
            prop_assert!(found.cameras.iter().all(|camera| made(camera).is_ok()));
            for one in &found.report {
                prop_assert!((0..8).all(|k| one.change.parameter(k).is_finite()), "{one:?}");
            }
        }
    }
}
