//! Refines one pose of a simulated person and prints its error: `cargo run --release --example
//! refine`.

use skelsplat_core::nalgebra::{Matrix3, Vector3};
use skelsplat_core::{Camera, Detections, Frame, Layout, RefineConfig, Refiner, Unit};

/// A camera 5 m from the person, looking at it from the direction `angle` (radians); x right, y
/// down, z forward.
fn camera(angle: f64) -> skelsplat_core::Result<Camera> {
    let (sin, cos) = angle.sin_cos();
    let k = Matrix3::new(1100.0, 0.0, 500.0, 0.0, 1100.0, 500.0, 0.0, 0.0, 1.0);
    let rotation = Matrix3::new(-sin, cos, 0.0, 0.0, 0.0, -1.0, -cos, -sin, 0.0);
    let centre = Vector3::new(5.0 * cos, 5.0 * sin, 0.9);
    Camera::new(&k, &rotation, &(-rotation * centre), [1000, 1000])
}

fn main() -> skelsplat_core::Result<()> {
    let layout = Layout::by_name("h36m17")?;
    let cameras: Vec<Camera> =
        [0.5, 2.0, 3.5, 5.0].into_iter().map(camera).collect::<Result<_, _>>()?;

    // Joints on a spiral simulate a person, errors of up to 4 px a detector; the third view misses
    // the left wrist.
    let truth: Vec<Vector3<f64>> = (0..17)
        .map(|j| f64::from(j) / 17.0)
        .map(|h| Vector3::new(0.3 * (9.0 * h).sin(), 0.3 * (9.0 * h).cos(), 1.7 * h))
        .collect();
    let mut pixels = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        for (j, joint) in truth.iter().enumerate() {
            let seen = camera.project(joint).filter(|_| (i, j) != (2, 13));
            let error = 4.0 * ((7 * i + 3 * j) as f64).sin();
            pixels.extend(seen.map_or([f64::NAN; 2], |p| [p.x + error, p.y - error]));
        }
    }
    let frame = Frame::from(Detections::new(cameras.len(), truth.len(), &pixels, None)?);

    for config in [RefineConfig::default(), RefineConfig::paper()] {
        let method = config.method.name();
        let refiner = Refiner::new(&cameras, Unit::Metre, Some(&layout), config)?;
        let found = refiner.refine(&frame)?;
        let errors = found.pose.iter().zip(&truth).map(|(x, y)| (x - y).norm());
        let mean = 1000.0 * errors.sum::<f64>() / truth.len() as f64;
        println!(
            "{method}: error {mean:.1} mm, {} after {} steps",
            found.stop_reason.name(),
            found.n_iter
        );
    }
    Ok(())
}
