//! Time of one refinement, 17 joints, one core: `paper` with all 125 steps in 4 views, `annealed`
//! in 4 to 31.
//!
//! `cargo bench -p skelsplat-bench`. The image size is varied to show that it has no
//! effect.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use skelsplat_core::{Camera, Frame, Layout, PaperSettings, RefineConfig, Refiner, Unit};
use skelsplat_tests::scenes::{Noise, noisy_detections, perturbed, room, standing};

/// The same focal length and view in a larger or smaller image: the pixels per mm stay the same.
fn resized(camera: &Camera, pixels: u32) -> Camera {
    let centre = 0.5 * (f64::from(pixels) - 1.0);
    let mut k = camera.k();
    (k[(0, 2)], k[(1, 2)]) = (centre, centre);
    Camera::new(&k, camera.rotation(), camera.translation(), [pixels, pixels]).expect("valid")
}

fn paper(c: &mut Criterion) {
    let mut group = c.benchmark_group("paper, 17 joints, 4 views, 125 steps");
    for pixels in [1000, 4000] {
        let cameras: Vec<Camera> = room(4).iter().map(|c| resized(c, pixels)).collect();
        let mut noise = Noise::new(1);
        let frame = Frame {
            detections: noisy_detections(&standing(), &cameras, 3.0, &mut noise),
            init_pose: Some(perturbed(&standing(), 20.0, &mut noise)),
            init_covariance: None,
        };
        let config =
            RefineConfig::from(PaperSettings { stop_tolerance: 0.0, ..PaperSettings::default() });
        let layout = Layout::by_name("h36m17").expect("built in");
        let refiner =
            Refiner::new(&cameras, Unit::Millimetre, Some(&layout), config).expect("valid");
        group.bench_function(BenchmarkId::from_parameter(format!("{pixels} px")), |b| {
            b.iter(|| refiner.refine(black_box(&frame)).expect("valid"));
        });
    }
    group.finish();
}

fn annealed(c: &mut Criterion) {
    let mut group = c.benchmark_group("annealed, 17 joints");
    for views in [4, 8, 31] {
        let cameras = room(views);
        let detections = noisy_detections(&standing(), &cameras, 3.0, &mut Noise::new(1));
        let frame = Frame::from(detections);
        let layout = Layout::by_name("h36m17").expect("built in");
        let config = RefineConfig::default();
        let refiner =
            Refiner::new(&cameras, Unit::Millimetre, Some(&layout), config).expect("valid");
        group.bench_function(BenchmarkId::from_parameter(format!("{views} views")), |b| {
            b.iter(|| refiner.refine(black_box(&frame)).expect("valid"));
        });
    }
    group.finish();
}

criterion_group!(benches, paper, annealed);
criterion_main!(benches);
