//! Several people, from any detections.

use nalgebra::Vector3;
use proptest::prelude::*;
use skelsplat_core::study::people::identify;
use skelsplat_core::{Camera, Detections, Person, Progress, Tracker, track};
use skelsplat_tests::scenes::{Noise, changed, h36m, noisy_detections, room, standing};

use super::any::{cameras, config, detections, replaced, sound, threaded, wrong};

type Slots = Vec<Detections>;

/// One to three people in one to six frames: anything, or people with wrong detections in slots of
/// any order.
fn recording() -> impl Strategy<Value = (Vec<Camera>, Vec<Slots>)> {
    let anything = cameras(1..=3).prop_flat_map(|c| {
        let frame = prop::collection::vec(detections(c.len(), 17), 0..=3);
        (Just(c), prop::collection::vec(frame, 1..=4))
    });
    let crowd = (2..=4_u32, 1..=3_usize, 3..=6_usize, any::<u32>(), 0.0..10.0_f64, wrong(60));
    let crowd = (crowd, 0.0..1500.0_f64).prop_map(
        |((views, people, frames, seed, sigma, wrong), apart)| {
            let cameras = room(views);
            let mut noise = Noise::new(u64::from(seed) + 1);
            let frames = (0..frames)
                .map(|t| slots(&cameras, people, t, apart, sigma, &mut noise, &wrong))
                .collect();
            (cameras, frames)
        },
    );
    prop_oneof![1 => anything, 2 => crowd]
}

fn slots(
    cameras: &[Camera],
    people: usize,
    t: usize,
    apart: f64,
    sigma: f64,
    noise: &mut Noise,
    wrong: &[(usize, f64)],
) -> Slots {
    let seen: Slots = (0..people)
        .map(|q| {
            let at = Vector3::new(apart * q as f64, 20.0 * t as f64, 0.0);
            let body: Vec<_> = standing().into_iter().map(|x| x + at).collect();
            noisy_detections(&body, cameras, sigma, noise)
        })
        .collect();
    (0..people)
        .map(|p| {
            let exchanged = changed(&seen[0], |i, j, _| seen[(p + t + i) % people].get(i, j));
            replaced(&exchanged, wrong.iter().copied().filter(|(k, _)| k % 7 == t))
        })
        .collect()
}

fn check(people: &[Person], frames: usize) -> Result<(), TestCaseError> {
    for person in people {
        prop_assert!(person.frames.end <= frames);
        for frame in person.sequence.frames.iter() {
            sound(&frame)?;
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(config(8))]

    #[test]
    fn any_people_are_followed_soundly(
        (cameras, people) in recording(),
        fps in prop::sample::select(vec![1e-3, 30.0, 1e4]),
    ) {
        let refiner = threaded(&cameras, 1);
        let found = track(&refiner, &h36m(), &people, fps, None, &Progress::default());
        if let Ok(found) = &found {
            check(&found.people, people.len())?;
        }
        let mut tracker = Tracker::new(&refiner, &h36m(), fps, Some(2)).unwrap();
        for slots in &people {
            let seen = tracker.step(&refiner, slots, &Progress::default());
            if let Ok(seen) = seen {
                prop_assert!(seen.len() <= 2);
                for one in &seen {
                    sound(&one.refinement)?;
                }
            }
        }
        // On another number of threads the same bits.
        let refiner = threaded(&cameras, 3);
        let again = track(&refiner, &h36m(), &people, fps, None, &Progress::default());
        prop_assert_eq!(format!("{found:?}"), format!("{again:?}"));
    }

    #[test]
    fn anybody_identified_is_there((cameras, people) in recording()) {
        let refiner = threaded(&cameras, 1);
        let found = identify(&refiner, &h36m(), &people, 25.0, &Progress::default());
        let Ok(found) = found else { return Ok(()) };
        prop_assert_eq!(found.cut.len(), people.len());
        for one in &found.people {
            for (t, slots) in one.frames.clone().zip(one.slots.chunks(cameras.len())) {
                for (view, slot) in slots.iter().enumerate() {
                    let joint = |slot: usize, j| people[t][slot].get(view, j).is_some();
                    prop_assert!(slot.is_none_or(|slot| (0..17).any(|j| joint(slot, j))));
                }
            }
        }
    }
}
