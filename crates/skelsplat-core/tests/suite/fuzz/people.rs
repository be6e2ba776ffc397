//! Several people, from any detections.

use nalgebra::Vector3;
use proptest::prelude::*;
use skelsplat_core::study::people::choice::{Linking, MOST_WORK, Rules, choices, choose};
use skelsplat_core::testing::scenes::{Noise, changed, h36m, noisy_detections, room, standing};
use skelsplat_core::{Camera, Detections, Person, Progress, Tracker, track};

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
    fn any_person_chosen_is_there(
        (cameras, people) in recording(),
        most_work in prop::sample::select(vec![0, 2_000, MOST_WORK]),
    ) {
        let rules = Rules {
            gates_px: vec![66.0; cameras.len()],
            min_confidence: 0.2,
            min_joints: 4,
            mirror: (0..h36m().n_joints()).collect(),
            most: 8,
            worse: 4.0,
            most_work,
        };
        let linking = Linking { cost: 2.0, step: 1000.0 };
        let chosen = choose(&people, &cameras, &rules, linking, &Progress::default()).unwrap();
        for (k, slot) in chosen.slots.iter().enumerate() {
            if let Some(slot) = slot {
                let (t, view) = (k / cameras.len(), k % cameras.len());
                let seen = |j| people[t][*slot].get(view, j).is_some();
                prop_assert!((0..h36m().n_joints()).filter(|j| seen(*j)).count() >= 4);
            }
        }
        let frames = choices(&people, &cameras, &rules, &Progress::default()).unwrap();
        for choice in frames.iter().flat_map(|frame| &frame.all) {
            prop_assert!(choice.cost.is_finite());
            prop_assert!(choice.slots.iter().flatten().count() >= 2);
        }
    }
}
