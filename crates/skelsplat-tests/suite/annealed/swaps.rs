//! Left–right swaps, independent of the other cameras.

use super::*;
use skelsplat_core::study::annealed::swaps::{Chain, chains, find};

fn h36m_chains() -> Vec<Chain> {
    chains(&h36m())
}

/// Three views, the first with its arms swapped; `empty[i]` views without a detection come before
/// view i.
fn arms_exchanged(seed: u64, empty: [u32; 3]) -> (Detections, Vec<Camera>) {
    let cameras = room(3);
    let chains = h36m_chains();
    let arms = chains.iter().find(|chain| chain.iter().any(|p| p.contains(&WRIST))).unwrap();
    let detections = noisy_detections(&standing(), &cameras, 2.0, &mut Noise::new(seed));
    let other = |j: usize| {
        let pair = arms.iter().find(|pair| pair.contains(&j));
        pair.map_or(j, |pair| pair[usize::from(pair[0] == j)])
    };
    let (mut pixels, mut all) = (Vec::new(), Vec::new());
    for i in 0..3 {
        for _ in 0..empty[i] {
            all.push(room(7)[all.len()].clone());
            pixels.extend([f64::NAN; 34]);
        }
        all.push(cameras[i].clone());
        for j in 0..17 {
            let (p, _) = detections.get(i, if i == 0 { other(j) } else { j }).unwrap();
            pixels.extend([p.x, p.y]);
        }
    }
    (Detections::new(all.len(), 17, &pixels, None).unwrap(), all)
}

fn found((detections, cameras): &(Detections, Vec<Camera>)) -> Vec<(usize, usize)> {
    let rays = Rays::new(detections, cameras, &[]);
    let points = robust(detections, cameras).points;
    let swaps = find(&rays, &h36m_chains(), &points, &[Annealing::END; 17]);
    swaps.iter().map(|swap| (swap.view, swap.chain)).collect()
}

#[test]
fn views_without_a_detection_have_no_influence() {
    let arms = h36m_chains().iter().position(|c| c.iter().any(|p| p.contains(&WRIST))).unwrap();
    let mut exchanges = 0;
    for seed in 0..10 {
        let alone = found(&arms_exchanged(seed, [0; 3]));
        exchanges += usize::from(alone == vec![(0, arms)]);
        for empty in [[1, 0, 0], [0, 2, 0], [2, 1, 1]] {
            let place = |i: usize| i + empty[..=i].iter().sum::<u32>() as usize;
            let moved: Vec<_> = alone.iter().map(|(i, chain)| (place(*i), *chain)).collect();
            assert_eq!(found(&arms_exchanged(seed, empty)), moved, "seed {seed}");
        }
    }
    assert!(exchanges >= 8, "{exchanges} of 10");
}

/// Two views that see a chain and contradict each other do not determine which is swapped, however
/// many others there are.
#[test]
fn two_views_that_see_a_chain_are_too_few() {
    let cameras = room(5);
    let detections = noisy_detections(&standing(), &cameras, 2.0, &mut Noise::new(1));
    let chains = h36m_chains();
    let arms = chains.iter().find(|chain| chain.iter().any(|p| p.contains(&WRIST))).unwrap();
    let in_arms = |j: usize| arms.iter().any(|pair| pair.contains(&j));
    let seen = without(&detections, |i, j| in_arms(j) && i > 1);
    let other = |j: usize| {
        let pair = arms.iter().find(|pair| pair.contains(&j));
        pair.map_or(j, |pair| pair[usize::from(pair[0] == j)])
    };
    let exchanged = changed(&seen, |i, j, p| {
        let other = if i == 0 { seen.get(0, other(j)) } else { None };
        Some(other.unwrap_or((p, 1.0)))
    });
    assert_eq!(found(&(exchanged, cameras)), Vec::new());
}
