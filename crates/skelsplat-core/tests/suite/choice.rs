//! The choice of one person: what it finds, and that its work is bounded.

use nalgebra::Vector3;
use skelsplat_core::study::people::choice::{Choices, Linking, MOST_WORK, Rules, choices, choose};
use skelsplat_core::study::people::{Associator, Crowd};
use skelsplat_core::testing::scenes::{Noise, h36m, noisy_detections, refiner, room, standing};
use skelsplat_core::{Camera, Detections, Progress, RefineConfig};

fn rules(cameras: &[Camera], most_work: usize) -> Rules {
    Rules {
        gates_px: vec![66.0; cameras.len()],
        min_confidence: 0.2,
        min_joints: 4,
        mirror: (0..17).collect(),
        most: 8,
        worse: 4.0,
        most_work,
    }
}

/// A frame of people at these places, one per slot.
fn frame(places: &[[f64; 2]], cameras: &[Camera], noise: &mut Noise) -> Vec<Detections> {
    let body = |[x, y]: &[f64; 2]| -> Vec<Vector3<f64>> {
        standing().into_iter().map(|p| p + Vector3::new(*x, *y, 0.0)).collect()
    };
    places.iter().map(|at| noisy_detections(&body(at), cameras, 2.0, noise)).collect()
}

fn found(frames: &[Vec<Detections>], cameras: &[Camera], most_work: usize) -> Vec<Choices> {
    choices(frames, cameras, &rules(cameras, most_work), &Progress::default()).unwrap()
}

fn crowd(n: usize, side: f64, cameras: &[Camera]) -> Vec<Detections> {
    let mut noise = Noise::new(5);
    let places: Vec<[f64; 2]> =
        (0..n).map(|_| [0, 1].map(|_| side * (noise.uniform() - 0.5))).collect();
    frame(&places, cameras, &mut noise)
}

#[test]
fn the_work_of_a_frame_is_bounded_and_the_best_pairs_come_first() {
    let cameras = room(4);
    for side in [0.0, 6000.0] {
        let people = [crowd(30, side, &cameras)];
        let whole = &found(&people, &cameras, MOST_WORK)[0];
        assert!(!whole.cut && whole.work > 100_000, "{}", whole.work);
        let part = &found(&people, &cameras, 100_000)[0];
        assert!(part.cut);
        // The last body is compared with everybody: at most 30 figures in 4 views, two sides, five
        // registers, with a median.
        assert!(part.work < 100_000 + 30 * 4 * 2 * 5 * 10, "{}", part.work);
        assert!(part.all[0].slots.iter().all(Option::is_some));
        assert!(part.all[0].cost < 0.1);
    }
}

#[test]
fn of_too_many_figures_the_largest_are_compared() {
    let cameras = room(2);
    let mut people = crowd(40, 9000.0, &cameras);
    people.extend(frame(&[[-1500.0, 0.0]], &cameras, &mut Noise::new(1)));
    // A quarter of the work allows pairs of 10 figures in each view, of five registers.
    let found = &found(&[people], &cameras, 4 * 100 * 5)[0];
    assert!(found.cut && found.work < 4 * 100 * 5 + 2 * 10 * 2 * 5 * 10);
    assert!(!found.all.is_empty());
}

#[test]
fn a_frame_depends_on_no_other() {
    let cameras = room(3);
    let mut noise = Noise::new(9);
    let mut people = vec![frame(&[[0.0, 0.0], [900.0, 0.0]], &cameras, &mut noise)];
    people.push(Vec::new());
    people.push(frame(&[[500.0, 100.0]], &cameras, &mut noise));
    people.push(frame(&[[-900.0, 0.0], [0.0, 900.0], [0.0, 0.0]], &cameras, &mut noise));
    let together = found(&people, &cameras, MOST_WORK);
    for (slots, found_together) in people.iter().zip(&together) {
        let alone = found(std::slice::from_ref(slots), &cameras, MOST_WORK);
        assert_eq!(format!("{:?}", alone[0]), format!("{found_together:?}"));
    }
    assert_eq!(together[0].all[0].slots.len(), 3);
    assert_eq!(together[1], Choices::default());
}

#[test]
fn the_path_stays_with_one_person_and_over_frames_without_any() {
    let cameras = room(4);
    let mut noise = Noise::new(3);
    // The second of two who stand apart is not seen in the third frame, nobody in the fifth.
    let place = |t: usize| match t {
        2 => vec![[0.0, 0.0]],
        4 => vec![],
        t if t % 2 == 0 => vec![[0.0, 0.0], [2500.0, 0.0]],
        _ => vec![[2500.0, 0.0], [0.0, 0.0]],
    };
    let people: Vec<_> = (0..8).map(|t| frame(&place(t), &cameras, &mut noise)).collect();
    let linking = Linking { cost: 2.0, step: 1000.0 };
    let rules = rules(&cameras, MOST_WORK);
    let chosen = choose(&people, &cameras, &rules, linking, &Progress::default()).unwrap();
    assert_eq!(chosen.cut, [false; 8]);
    for (t, slots) in chosen.slots.chunks(4).enumerate() {
        let own = if t == 4 { None } else { Some(t % 2) };
        assert_eq!(slots, [own; 4], "frame {t}");
    }
}

#[test]
fn frames_with_too_many_people_to_follow_are_counted() {
    let cameras = room(2);
    let refiner = refiner(&cameras, RefineConfig::default());
    let mut associator = Associator::new(&refiner, &h36m(), 30.0);
    // A million pairs are compared, of a thousand figures in each view.
    for (n, cut) in [(1001, 1), (20, 1)] {
        let people = crowd(n, 9000.0, &cameras);
        associator.step(&Crowd::new(&refiner, &people).unwrap());
        assert_eq!(associator.cut(), cut, "{n} people");
    }
}
