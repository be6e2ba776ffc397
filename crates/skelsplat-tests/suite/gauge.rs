//! Error bars of a rig as a whole free, against its directions by central differences.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector2, Vector3, dmatrix, dvector};
use skelsplat_core::study::rig::bundle::Bundle;
use skelsplat_core::study::rig::gauge::{Sureness, Zooms};
use skelsplat_core::study::rig::lenses::{FOCAL_SIGMA, KINDS, LensPosterior, ONE_MAKE, alike};
use skelsplat_core::study::rig::placed::{PARAMETERS, Sight, Step};
use skelsplat_core::study::rig::prior::CALIBRATED;
use skelsplat_core::study::rig::scene::Scene;
use skelsplat_core::study::rig::search::Explanation;
use skelsplat_core::study::rig::{Bars, Change, Freedom, Placed};
use skelsplat_core::{Camera, Detections};
use skelsplat_tests::scenes::{Noise, room, standing};

const VIEWS: usize = 4;
const STEP: f64 = 1e-4;

/// A point after a small turn of the world about each axis, rad, a shift, mm, or a growth.
fn similar(x: &Vector3<f64>, k: usize, by: f64) -> Vector3<f64> {
    let mut axis = Vector3::zeros();
    axis[k % 3] = by;
    match k {
        0..3 => Rotation3::new(axis) * x,
        3..6 => x + axis,
        _ => x * (1.0 + by),
    }
}

/// The camera that sees the world moved by `similar` as before.
fn moved(placed: &Placed, k: usize, by: f64) -> Placed {
    let turn = if k < 3 {
        Rotation3::new(similar(&Vector3::zeros(), 3 + k, by))
    } else {
        Rotation3::identity()
    };
    let camera = &placed.camera;
    let rotation = camera.rotation() * turn.inverse();
    let centre = similar(&camera.centre(), k, by);
    let moved = Camera::new(&camera.k(), &rotation, &-(rotation * centre), camera.size()).unwrap();
    Placed { camera: moved, clock: placed.clock }
}

fn placed() -> Vec<Placed> {
    let mut cameras = room(VIEWS as u32);
    // Not a symmetric rig.
    cameras[1] = moved(&Placed { camera: cameras[1].clone(), clock: 0.0 }, 4, 900.0).camera;
    cameras.into_iter().map(|camera| Placed { camera, clock: 0.0 }).collect()
}

/// How the parameters of all cameras change per unit of each of the seven directions.
fn directions(cameras: &[Placed]) -> DMatrix<f64> {
    let entry = |row: usize, k: usize| {
        let camera = &cameras[row / PARAMETERS];
        let change = Change::between(&moved(camera, k, -STEP), &moved(camera, k, STEP));
        change.parameter(row % PARAMETERS) / (2.0 * STEP)
    };
    DMatrix::from_fn(PARAMETERS * cameras.len(), 7, entry)
}

/// A rig whose turns and shifts have the covariance `factor` `factor`ᵀ.
fn explained(cameras: &[Placed], factor: &DMatrix<f64>) -> Explanation {
    let places = |row: &usize| row % PARAMETERS < 6;
    let rows: Vec<usize> = (0..factor.nrows()).filter(places).collect();
    let free = factor.select_rows(&rows);
    let mut rig = Explanation::start(cameras.to_vec(), vec![Freedom::PLACE; cameras.len()]);
    rig.judged.steady = &free * free.transpose();
    rig
}

/// Root-mean-square error of each camera's turn with the rig aligned, and the covariance of its
/// shift: every column of `factor` is one error, of which the least squares of turns, times the
/// size of the rig, and shifts over all directions is left.
fn aligned(cameras: &[Placed], factor: &DMatrix<f64>) -> Vec<(f64, Matrix3<f64>)> {
    let centres: Vec<Vector3<f64>> = cameras.iter().map(|one| one.camera.centre()).collect();
    let middle = centres.iter().sum::<Vector3<f64>>() / centres.len() as f64;
    let squares: f64 = centres.iter().map(|centre| (centre - middle).norm_squared()).sum();
    let size = (squares / centres.len() as f64).sqrt();
    let scaled = |matrix: &DMatrix<f64>| {
        let unit = |row: usize| if row % PARAMETERS < 3 { size } else { 1.0 };
        DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |r, c| unit(r) * matrix[(r, c)])
    };
    let (free, errors) = (scaled(&directions(cameras)), scaled(factor));
    let away = free.clone().svd(true, true).solve(&errors, 1e-12).unwrap();
    let left = errors - free * away;
    let of_camera = |i: usize| {
        let shift = left.fixed_rows::<3>(PARAMETERS * i + 3);
        (left.rows(PARAMETERS * i, 3).norm() / size, shift * shift.transpose())
    };
    (0..cameras.len()).map(of_camera).collect()
}

fn bars(rig: &Explanation) -> Vec<Bars> {
    Sureness::of(rig).unwrap().bars()
}

/// Errors of turns, rad, and shifts, mm.
fn errors(columns: usize) -> DMatrix<f64> {
    let mut noise = Noise::new(8);
    DMatrix::from_fn(PARAMETERS * VIEWS, columns, |row, _| match row % PARAMETERS {
        0..3 => 0.01 * noise.normal(),
        3..6 => 30.0 * noise.normal(),
        _ => 0.0,
    })
}

#[test]
fn no_direction_of_the_rig_as_a_whole_changes_a_projection() {
    let (cameras, x) = (placed(), Vector3::new(350.0, -420.0, 1310.0));
    let free = directions(&cameras);
    for (i, camera) in cameras.iter().enumerate() {
        let sight = Sight { pixel: Vector2::zeros(), speed: Vector2::zeros(), confidence: 1.0 };
        let exact = camera.residual(&x, &sight).unwrap();
        for k in 0..7 {
            let step = Step::from_fn(|p, _| free[(PARAMETERS * i + p, k)]);
            let point = (similar(&x, k, STEP) - similar(&x, k, -STEP)) / (2.0 * STEP);
            let (camera, point) = (exact.by_camera * step, exact.by_point * point);
            assert!((camera + point).norm() <= 1e-6 * point.norm(), "{i} {k} {camera} {point}");
        }
    }
}

#[test]
fn error_bars_are_those_of_the_aligned_rig() {
    let (cameras, errors) = (placed(), errors(40));
    let bars = bars(&explained(&cameras, &errors));
    for (Bars { turn, shift, place, .. }, (exact_turn, exact)) in
        bars.into_iter().zip(aligned(&cameras, &errors))
    {
        assert!((turn / exact_turn - 1.0).abs() < 1e-6, "{turn} {exact_turn}");
        assert!((shift / exact.trace().sqrt() - 1.0).abs() < 1e-6, "{shift} {exact}");
        assert!((place - exact).amax() < 1e-6 * exact.amax(), "{place} {exact}");
    }
}

#[test]
fn what_moves_everything_together_is_no_error() {
    let cameras = placed();
    let mut together = directions(&cameras);
    // All directions about as large as the errors.
    for k in 0..7 {
        together.column_mut(k).scale_mut(if (3..6).contains(&k) { 30.0 } else { 0.01 });
    }
    let lone = errors(1);
    let entry = |r: usize, c: usize| if c < 7 { together[(r, c)] } else { lone[r] };
    let both = DMatrix::from_fn(together.nrows(), 8, entry);
    let (none, some) = (explained(&cameras, &lone), explained(&cameras, &both));
    for (none, some) in bars(&none).iter().zip(bars(&some)) {
        assert!((some.turn / none.turn - 1.0).abs() < 1e-5, "{some:?} {none:?}");
        assert!((some.shift / none.shift - 1.0).abs() < 1e-5, "{some:?} {none:?}");
    }
}

/// Triangulates joints again with cameras that are slightly off, and aligns all joints.
#[test]
fn joints_are_off_by_what_their_cameras_are_off() {
    let (cameras, errors, body) = (placed(), errors(30) * 1e-3, standing());
    let all = cameras.iter().flat_map(|one| body.iter().map(move |x| one.camera.project(x)));
    let pixels: Vec<f64> = all.flat_map(|pixel| pixel.unwrap().data.0[0]).collect();
    let frames = [Detections::new(VIEWS, body.len(), &pixels, None).unwrap()];
    let bundle = Bundle {
        scene: Scene::new(&frames),
        frames: &[0],
        given: &cameras,
        cameras: cameras.clone(),
        freedom: vec![Freedom::default(); VIEWS],
        lenses: &CALIBRATED,
        points: body.clone(),
        fixed: false,
        offsets: None,
    };
    let size = 3 * body.len();
    let moves = |x, k| (similar(x, k, STEP) - similar(x, k, -STEP)) / (2.0 * STEP);
    let follow = |r: usize, k: usize| moves(&body[r / 3], k)[r % 3];
    let free = DMatrix::from_fn(size, 7, follow);
    let mut squares = 0.0;
    for error in errors.column_iter() {
        let mut wrong = bundle.clone();
        for (i, one) in wrong.cameras.iter_mut().enumerate() {
            let step = Step::from_iterator(error.rows(PARAMETERS * i, PARAMETERS).iter().copied());
            *one = one.stepped(&step).unwrap();
        }
        wrong.solve(10.0, 10.0);
        let off = DMatrix::from_fn(size, 1, |r, _| (wrong.points[r / 3] - body[r / 3])[r % 3]);
        let together = free.clone().svd(true, true).solve(&off, 1e-12).unwrap();
        squares += (off - &free * together).norm_squared();
    }
    let known = Sureness::of(&explained(&cameras, &errors)).unwrap();
    let exact = (squares / size as f64).sqrt();
    let found = known.joints(&bundle.follows(10.0));
    assert!((found / exact - 1.0).abs() < 1e-3, "{found} {exact}");
}

/// Integrates over the focal lengths of two cameras, in their mean and their difference.
#[test]
fn error_bars_of_unknown_lenses_are_those_of_all_kinds() {
    let covariance = dmatrix![4e-4, 1e-4; 1e-4, 9e-4];
    let normal = |x: &DVector<f64>, c: &DMatrix<f64>| {
        let inverse = c.clone().try_inverse().unwrap();
        (-0.5 * x.dot(&(inverse * x))).exp() / c.determinant().sqrt()
    };
    for estimate in [dvector![0.10, 0.12], dvector![0.10, 0.17], dvector![-0.3, 0.3]] {
        let zooms = |by| Zooms { estimate: estimate.clone(), covariance: covariance.clone(), by };
        let found = LensPosterior::of_kinds(zooms(DMatrix::identity(2, 2))).unwrap();
        let mut moments = [0.0; 3].map(|_| (0.0, DVector::zeros(2), DMatrix::zeros(2, 2)));
        for (apart, moments) in KINDS.into_iter().chain([ONE_MAKE]).zip(&mut moments) {
            let prior = DMatrix::from_fn(2, 2, |i, j| {
                FOCAL_SIGMA.powi(2) - if i == j { 0.0 } else { apart.powi(2) }
            });
            let wide = f64::min(apart, 0.06);
            for (a, b) in (-100..=100).flat_map(|a| (-50..=50).map(move |b| (a, b))) {
                let (mean, half) = (f64::from(a) * 6e-3, f64::from(b) * wide / 7.5);
                let z = dvector![mean - half, mean + half];
                let p = normal(&z, &prior) * normal(&(&estimate - &z), &covariance) * wide;
                moments.0 += p;
                moments.1 += &z * p;
                moments.2 += &z * z.transpose() * p;
            }
        }
        let most = moments.iter().max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        let (held, second) = (&most.1 / most.0, &most.2 / most.0);
        let own = second - &held * held.transpose();
        let all: f64 = moments.iter().map(|part| part.0).sum();
        let mut exact = -own;
        for (p, first, second) in &moments {
            let cross = first * held.transpose();
            exact += (second - &cross - cross.transpose() + &held * held.transpose() * *p) / all;
        }
        assert!(
            (found.besides() - &exact).amax() < 1e-2 * exact.amax(),
            "{} {exact}",
            found.besides()
        );
    }
}

#[test]
fn cameras_of_two_makes_are_told() {
    let errors = [0.004, -0.007, 0.011, -0.012, 0.002, 0.009, -0.003];
    let two = [0, 1, 0, 0, 1, 0, 1];
    let of_makes = |apart: f64| DVector::from_fn(7, |i, _| apart * two[i] as f64 + errors[i]);
    let found = |estimate: DVector<f64>| {
        let (covariance, by) =
            (DMatrix::from_diagonal_element(7, 7, 1e-4), DMatrix::identity(7, 7));
        LensPosterior::of_kinds(Zooms { estimate, covariance, by }).unwrap()
    };
    let same = |a: &DMatrix<f64>, b: &DMatrix<f64>| (a - b).amax() < 1e-12;
    let apart = found(of_makes(0.25));
    assert!(KINDS.iter().any(|kind| same(apart.prior(), &alike(&two, *kind))));
    assert!(same(found(of_makes(0.0)).prior(), &alike(&[0; 7], FOCAL_SIGMA)));
}
