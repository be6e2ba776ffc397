//! A Human3.6M-like room, a standing skeleton in it, and reproducible noise.

use nalgebra::{Matrix3, Vector2, Vector3};
use skelsplat_core::{Camera, Detections, Layout, LayoutSpec, RefineConfig, Refiner, Unit};

/// Uniform and normal numbers from a linear congruential generator (Knuth's MMIX constants): enough
/// for tests, the same on every machine.
#[derive(Debug, Clone)]
pub struct Noise(u64);

impl Noise {
    /// A generator with this seed.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// Uniform in (0, 1).
    pub fn uniform(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (f64::from(u32::try_from(self.0 >> 32).unwrap_or(0)) + 0.5) / 4_294_967_296.0
    }

    /// Standard normal, by Box and Muller.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    /// A vector of independent normals of standard deviation `sigma`.
    pub fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| sigma * self.normal())
    }
}

/// A camera at `centre` that looks at `target`, upright in a world whose z points up.
pub fn look_at(centre: Vector3<f64>, target: Vector3<f64>, focal: f64, size: [u32; 2]) -> Camera {
    let forward = (target - centre).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rotation = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let [w, h] = size.map(f64::from);
    let k = Matrix3::new(focal, 0.0, 0.5 * (w - 1.0), 0.0, focal, 0.5 * (h - 1.0), 0.0, 0.0, 1.0);
    Camera::new(&k, &rotation, &(-rotation * centre), size).expect("an upright camera is valid")
}

/// `n` cameras of 1000 × 1000 px around a room, 5.3 m from its centre and 1.5 m high, mm.
pub fn room(n: u32) -> Vec<Camera> {
    let place = |i: u32| {
        let angle = std::f64::consts::TAU * (f64::from(i) + 0.5) / f64::from(n);
        let centre = Vector3::new(5300.0 * angle.cos(), 5300.0 * angle.sin(), 1500.0);
        look_at(centre, Vector3::new(0.0, 0.0, 900.0), 1145.0, [1000, 1000])
    };
    (0..n).map(place).collect()
}

/// A standing person in the Human3.6M-17 layout, mm, z up.
pub fn standing() -> Vec<Vector3<f64>> {
    let joints: [[f64; 3]; 17] = [
        [0.0, 0.0, 950.0],
        [-130.0, 10.0, 945.0],
        [-140.0, 60.0, 500.0],
        [-145.0, -20.0, 80.0],
        [130.0, -10.0, 945.0],
        [150.0, 20.0, 500.0],
        [160.0, -60.0, 80.0],
        [0.0, 15.0, 1200.0],
        [0.0, 30.0, 1450.0],
        [0.0, 110.0, 1560.0],
        [0.0, 60.0, 1660.0],
        [170.0, 20.0, 1430.0],
        [260.0, 90.0, 1160.0],
        [230.0, 290.0, 1010.0],
        [-170.0, 20.0, 1430.0],
        [-240.0, -40.0, 1150.0],
        [-260.0, 160.0, 990.0],
    ];
    joints.into_iter().map(Vector3::from).collect()
}

/// Exact detections of `pose`; missing where a camera does not see a joint.
pub fn exact_detections(pose: &[Vector3<f64>], cameras: &[Camera]) -> Detections {
    noisy_detections(pose, cameras, 0.0, &mut Noise::new(0))
}

/// Pixels of the points in every camera, moved by `shift(view, joint)`; NaN where it is not seen.
pub fn pixels(
    cameras: &[Camera],
    points: &[Vector3<f64>],
    mut shift: impl FnMut(usize, usize) -> [f64; 2],
) -> Vec<f64> {
    let mut pixels = Vec::with_capacity(2 * cameras.len() * points.len());
    for (i, camera) in cameras.iter().enumerate() {
        for (j, x) in points.iter().enumerate() {
            let p = camera.project(x).unwrap_or(Vector2::repeat(f64::NAN));
            pixels.extend(&(p + Vector2::from(shift(i, j))));
        }
    }
    pixels
}

/// Detections of `pose` with Gaussian noise of `sigma` pixels.
pub fn noisy_detections(
    pose: &[Vector3<f64>],
    cameras: &[Camera],
    sigma: f64,
    noise: &mut Noise,
) -> Detections {
    let pixels = pixels(cameras, pose, |_, _| [(); 2].map(|()| sigma * noise.normal()));
    Detections::new(cameras.len(), pose.len(), &pixels, None).expect("shapes match")
}

/// `pose` with independent noise of `sigma` mm per axis.
pub fn perturbed(pose: &[Vector3<f64>], sigma: f64, noise: &mut Noise) -> Vec<Vector3<f64>> {
    pose.iter().map(|p| p + noise.vector(sigma)).collect()
}

/// Mean distance of two poses' joints, mm.
pub fn mean_error(pose: &[Vector3<f64>], truth: &[Vector3<f64>]) -> f64 {
    pose.iter().zip(truth).map(|(a, b)| (a - b).norm()).sum::<f64>() / pose.len() as f64
}

/// The layout of [`standing`].
pub fn h36m() -> Layout {
    Layout::by_name("h36m17").expect("built in")
}

/// The joints of a layout that is not known to be human.
pub fn not_human(layout: &Layout) -> Layout {
    let spec = LayoutSpec { name: "own".to_owned(), human: false, ..(**layout).clone() };
    Layout::new(spec).expect("valid joints")
}

/// A refiner of poses like [`standing`].
pub fn refiner(cameras: &[Camera], config: impl Into<RefineConfig>) -> Refiner {
    let layout = h36m();
    Refiner::new(cameras, Unit::Millimetre, Some(&layout), config.into()).expect("valid settings")
}

/// `detections` moved, dropped (`None`) or with another confidence by `f(view, joint, pixel)`.
pub fn changed(
    detections: &Detections,
    f: impl Fn(usize, usize, Vector2<f64>) -> Option<(Vector2<f64>, f64)>,
) -> Detections {
    let (m, n) = (detections.n_views(), detections.n_joints());
    let (mut pixels, mut confidence) = (Vec::new(), Vec::new());
    for (i, j) in (0..m).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let found = detections.get(i, j).and_then(|(p, _)| f(i, j, p));
        let (p, c) = found.unwrap_or((Vector2::repeat(f64::NAN), 1.0));
        pixels.extend([p.x, p.y]);
        confidence.push(c);
    }
    Detections::new(m, n, &pixels, Some(&confidence)).expect("shapes match")
}

/// `detections` without those for which `missing(view, joint)` holds.
pub fn without(detections: &Detections, missing: impl Fn(usize, usize) -> bool) -> Detections {
    changed(detections, |i, j, p| (!missing(i, j)).then_some((p, 1.0)))
}
