//! Several people: who is who across views and over time.

use nalgebra::Vector3;
use skelsplat_core::study::annealed::rays::{Ray, meet};
use skelsplat_core::study::people::score::assign;
use skelsplat_core::study::people::{Identity, identify};
use skelsplat_core::{Camera, Detections, Person, Progress, RefineConfig, Tracker, track};
use skelsplat_tests::scenes::{Noise, h36m, mean_error, noisy_detections, refiner, room, standing};

const FPS: f64 = 30.0;

/// Person `q` of three in frame `t`, of three statures: the first two pass each other at half a
/// metre, the third stands.
fn body(q: usize, t: usize) -> Vec<Vector3<f64>> {
    let along = 1300.0 - 2600.0 * t as f64 / 80.0;
    let at = [
        Vector3::new(along, 250.0, 0.0),
        Vector3::new(-along, -250.0, 0.0),
        Vector3::new(600.0, 1700.0, 0.0),
    ];
    let tall = [1.0, 0.92, 1.06][q];
    standing().into_iter().map(|x| x * tall + at[q]).collect()
}

/// The slots of a frame: person q in slot (q + t + view) modulo 3 of each view.
fn slots(t: usize, cameras: &[Camera], noise: &mut Noise) -> Vec<Detections> {
    let seen: Vec<Detections> =
        (0..3).map(|q| noisy_detections(&body(q, t), cameras, 2.0, noise)).collect();
    let (m, n) = (cameras.len(), 17);
    let slot = |p: usize| {
        let pixel = |k: usize| {
            let who = (p + 6 - (t + k / n) % 3) % 3;
            seen[who].get(k / n, k % n).map_or([f64::NAN; 2], |(p, _)| p.into())
        };
        let pixels: Vec<f64> = (0..m * n).flat_map(pixel).collect();
        Detections::new(m, n, &pixels, None).unwrap()
    };
    (0..3).map(slot).collect()
}

fn recording(cameras: &[Camera], frames: usize) -> Vec<Vec<Detections>> {
    let mut noise = Noise::new(7);
    (0..frames).map(|t| slots(t, cameras, &mut noise)).collect()
}

fn found(n_threads: Option<usize>, max_people: Option<usize>) -> Vec<Person> {
    let cameras = room(4);
    let people = recording(&cameras, 81);
    let refiner = refiner(&cameras, RefineConfig { n_threads, ..RefineConfig::default() });
    track(&refiner, &h36m(), &people, FPS, max_people, &Progress::default()).unwrap().people
}

#[test]
fn people_who_pass_each_other_stay_who_they_are() {
    let people = found(None, None);
    assert_eq!(people.len(), 3);
    for person in &people {
        assert_eq!(person.frames, 0..81);
        let pose = |t: usize| person.sequence.frames.frame(t).pose;
        let near = |t: usize| {
            (0..3).min_by(|a, b| {
                mean_error(&pose(t), &body(*a, t)).total_cmp(&mean_error(&pose(t), &body(*b, t)))
            })
        };
        let first = near(0).unwrap();
        for t in 0..81 {
            assert_eq!(near(t), Some(first), "person {} in frame {t}", person.id);
            assert!(mean_error(&pose(t), &body(first, t)) < 12.0);
        }
        for (k, slot) in person.slots.iter().enumerate() {
            assert_eq!(*slot, Some((first + k / 4 + k % 4) % 3), "frame {}, view {}", k / 4, k % 4);
        }
        assert!(person.more.iter().all(Option::is_none));
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    // The debug text has every bit, and NaN equals NaN.
    assert_eq!(format!("{:?}", found(Some(1), None)), format!("{:?}", found(Some(3), None)));
}

#[test]
fn live_follows_the_same_people() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::default());
    let mut tracker = Tracker::new(&refiner, &h36m(), FPS, None).unwrap();
    let mut who = [None; 3];
    for (t, slots) in recording(&cameras, 81).iter().enumerate() {
        let seen = tracker.step(&refiner, slots, &Progress::default()).unwrap();
        // Three frames make a person.
        assert_eq!(seen.len(), if t < 2 { 0 } else { 3 }, "frame {t}");
        for one in seen {
            let q = (0..3)
                .find(|q| mean_error(&one.refinement.pose, &body(*q, t)) < 30.0)
                .unwrap_or_else(|| panic!("person {} in frame {t} is nobody", one.id));
            assert_eq!(*who[one.id].get_or_insert(q), q, "frame {t}");
        }
    }
}

/// Everybody in the recording as the cameras of a room show it that is `scale` times as large. All
/// appear in the first frame, so their order is nobody's.
fn identified(scale: f64) -> Vec<Identity> {
    let cameras = room(4);
    let people = recording(&cameras, 40);
    let grown: Vec<Camera> =
        cameras.iter().map(|camera| camera.clone().with_length_scale(scale)).collect();
    let refiner = refiner(&grown, RefineConfig::default());
    let all = identify(&refiner, &h36m(), &people, FPS, &Progress::default()).unwrap();
    let mut people = all.people;
    people.sort_by(|a, b| a.slots.cmp(&b.slots));
    people
}

#[test]
fn people_are_told_apart_in_any_unit() {
    let people = identified(1.0);
    assert_eq!(people.len(), 3);
    for scale in [0.001, 0.05, 1000.0] {
        assert_eq!(identified(scale), people, "{scale}");
    }
}

fn ray(centre: [f64; 3], to: [f64; 3]) -> Ray {
    let (centre, to) = (Vector3::from(centre), Vector3::from(to));
    Ray { centre, direction: (to - centre).normalize(), weight: 1.0, pixel: 1e-3 }
}

#[test]
fn rays_meet_halfway_between_them() {
    let (a, b) = (ray([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]), ray([5.0, -3.0, 2.0], [5.0, 0.0, 2.0]));
    let (x, distance) = meet(&a, &b).unwrap();
    assert!((x - Vector3::new(5.0, 0.0, 1.0)).norm() < 1e-12);
    assert!((distance - 2.0).abs() < 1e-12);
}

#[test]
fn rays_that_are_parallel_or_diverge_do_not_meet() {
    let a = ray([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
    assert_eq!(meet(&a, &ray([0.0, 1.0, 0.0], [1.0, 1.0, 0.0])), None);
    assert_eq!(meet(&a, &ray([5.0, 3.0, 0.0], [5.0, 4.0, 0.0])), None);
}

#[test]
fn the_largest_sum_is_assigned_and_low_scores_are_not() {
    // Greedily, row 0 would take column 0 and leave row 1 with nothing.
    let scores = [vec![0.9, 0.8, 0.0], vec![0.85, 0.1, 0.0], vec![0.0, 0.0, 0.2]];
    assert_eq!(assign(&scores, 0.3), [Some(1), Some(0), None]);
    let tall: Vec<Vec<f64>> = scores.iter().map(|row| row[..1].to_vec()).collect();
    assert_eq!(assign(&tall, 0.3), [Some(0), None, None]);
    assert_eq!(assign(&[], 0.3), []);
    assert_eq!(assign(&[vec![], vec![]], 0.3), [None, None]);
}
