//! Triangulation and fusion: exact recovery, weights, degenerate geometry.

use nalgebra::{DMatrix, Matrix3x4, Vector3};
use skelsplat_core::study::triangulate::{dlt, fuse_monocular};
use skelsplat_core::{
    Camera, Detections, Distortion, Error, TriangulationMethod as Method, Unit, triangulate,
};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{exact_detections, look_at, pixels};

fn looking(centre: Vector3<f64>, target: Vector3<f64>) -> Camera {
    look_at(centre, target, 1145.0, [1000, 1000])
}

/// Four cameras in the corners of a room, 4 to 6 m from the subject.
fn room() -> Vec<Camera> {
    let corners = [[4000.0, 4000.0], [-4000.0, 3500.0], [-3800.0, -4200.0], [4100.0, -3900.0]];
    let middle = Vector3::new(0.0, 0.0, 900.0);
    corners.map(|[x, y]| looking(Vector3::new(x, y, 1600.0), middle)).to_vec()
}

fn joints() -> Vec<Vector3<f64>> {
    vec![
        Vector3::new(0.0, 0.0, 950.0),
        Vector3::new(-350.0, 220.0, 1450.0),
        Vector3::new(610.0, -480.0, 80.0),
    ]
}

/// A few pixels that look random.
fn jitter(i: usize, j: usize) -> [f64; 2] {
    [((7 * i + 3 * j) as f64).sin() * 4.0, ((5 * i + 11 * j) as f64).cos() * 4.0]
}

fn is_nan(x: &Vector3<f64>) -> bool {
    x.iter().all(|v| v.is_nan())
}

#[test]
fn exact_detections_give_the_points_back() {
    let (cameras, points) = (room(), joints());
    for views in [2, 3, 4] {
        let found = dlt(&exact_detections(&points, &cameras[..views]), &cameras[..views]);
        for (x, truth) in found.iter().zip(&points) {
            // 1e-13 px of rounding is 1e-12 mm at 6 m; conditioning of two views costs below 1e3
            assert!((x - truth).norm() < 1e-9, "{views} views: {x:?}");
        }
    }
}

#[test]
fn the_lens_is_undone_first() {
    let lens = Distortion::brown_conrady(&[-0.2, 0.08, 1e-3, -2e-3, -0.01]).unwrap();
    let cameras: Vec<_> = room().into_iter().map(|c| c.with_distortion(lens.clone())).collect();
    let detections = exact_detections(&joints(), &cameras);
    let found = triangulate(&detections, &cameras, Unit::Millimetre, Method::Dlt).unwrap();
    assert_eq!(found.rejected, [false; 12]);
    let ignored = dlt(&detections, &cameras);
    for ((x, without), truth) in found.points.iter().zip(&ignored).zip(joints()) {
        // 1e-9 px of undistortion at f = 1145 px and 6 m
        assert!((x - truth).norm() < 1e-7);
        // the joint nearest to the optical axes moves least
        assert!((without - truth).norm() > 1e-3);
    }
}

/// The textbook system in pixels and the caller's coordinates, null vector by a dense SVD.
fn plain(detections: &Detections, cameras: &[Camera], joint: usize) -> Vector3<f64> {
    let mut a = DMatrix::zeros(2 * cameras.len(), 4);
    for (i, camera) in cameras.iter().enumerate() {
        let columns = camera.rotation().iter().chain(camera.translation()).copied();
        let p = camera.k() * Matrix3x4::from_iterator(columns);
        let (pixel, c) = detections.get(i, joint).unwrap();
        a.set_row(2 * i, &((p.row(2) * pixel.x - p.row(0)) * c));
        a.set_row(2 * i + 1, &((p.row(2) * pixel.y - p.row(1)) * c));
    }
    let v_t = a.svd(false, true).v_t.unwrap();
    Vector3::new(v_t[(3, 0)], v_t[(3, 1)], v_t[(3, 2)]) / v_t[(3, 3)]
}

#[test]
fn the_null_vector_is_that_of_the_pixel_rows() {
    let (cameras, points) = (room(), joints());
    let exact = exact_detections(&points, &cameras);
    let confidence: Vec<f64> = (0..12).map(|k| 0.3 + 0.05 * f64::from(k)).collect();
    let seen = pixels(&cameras, &points, jitter);
    let noisy = Detections::new(4, points.len(), &seen, Some(&confidence)).unwrap();
    for (j, truth) in points.iter().enumerate() {
        let difference = |d: &Detections| (dlt(d, &cameras)[j] - plain(d, &cameras, j)).norm();
        assert!(difference(&exact) < 1e-6 * truth.norm());
        // The unit vectors compared differ by the choice of origin and unit; that moves the answer
        // by (noise/f)² (depth/|x|)² of |x|: (5/1145)² · (6000/900)² · 900 mm = 0.8 mm, of 20 mm of
        // noise.
        assert!(difference(&noisy) < 0.8, "{j}: {}", difference(&noisy));
        assert!((dlt(&noisy, &cameras)[j] - truth).norm() > 1.0);
    }
}

#[test]
fn the_answer_depends_on_neither_unit_nor_origin() {
    let (cameras, points) = (room(), joints());
    let noisy = Detections::new(4, 3, &pixels(&cameras, &points, jitter), None).unwrap();
    let found = dlt(&noisy, &cameras);
    let metres: Vec<_> = cameras.iter().map(|c| c.clone().with_length_scale(1e-3)).collect();
    let shift = Vector3::new(2e4, -3e4, 5e3);
    let moved: Vec<_> = cameras
        .iter()
        .map(|c| {
            let t = c.translation() - c.rotation() * shift;
            Camera::new(&c.k(), c.rotation(), &t, c.size()).unwrap()
        })
        .collect();
    for (j, x) in found.iter().enumerate() {
        // rounding of 4e4 mm, times the conditioning
        assert!((dlt(&noisy, &metres)[j] * 1e3 - x).norm() < 1e-8);
        assert!((dlt(&noisy, &moved)[j] - shift - x).norm() < 1e-8);
    }
}

#[test]
fn a_detection_weighs_its_confidence() {
    let (cameras, points) = (room(), joints());
    let seen = pixels(&cameras, &points, |i, _| if i == 2 { [60.0, -40.0] } else { [0.0; 2] });
    let error = |c: f64| {
        let confidence: Vec<f64> = (0..12).map(|k| if k / 3 == 2 { c } else { 1.0 }).collect();
        let detections = Detections::new(4, 3, &seen, Some(&confidence)).unwrap();
        (dlt(&detections, &cameras)[1] - points[1]).norm()
    };
    assert!(error(1.0) > 10.0);
    // Weights enter squared: a tenth of the confidence leaves a hundredth of the pull, a little
    // more as the view also loses its part in holding the point.
    assert!(error(0.1) < 0.03 * error(1.0), "{} {}", error(0.1), error(1.0));
    assert!(error(0.0) < 1e-9);
    // Only their ratio matters.
    let with = |c: f64| {
        let detections = Detections::new(4, 3, &seen, Some(&[c; 12])).unwrap();
        dlt(&detections, &cameras)
    };
    assert_eq!(with(1.0), with(1e-29));
    assert!(is_nan(&with(1e-31)[0]), "a confidence below 1e-30 is none");
}

#[test]
fn a_missing_detection_is_as_if_the_view_were_not_there() {
    let (cameras, points) = (room(), joints());
    let mut seen = pixels(&cameras, &points, |_, _| [0.0; 2]);
    for view in [0, 1, 3] {
        seen[2 * (3 * view + 1)] = f64::NAN;
    }
    seen[0] = f64::NAN;
    let found = dlt(&Detections::new(4, 3, &seen, None).unwrap(), &cameras);
    assert!((found[0] - points[0]).norm() < 1e-9);
    assert!(is_nan(&found[1]), "seen by one view only");
    assert!((found[2] - points[2]).norm() < 1e-9);
    assert!(dlt(&Detections::new(4, 0, &[], None).unwrap(), &cameras).is_empty());
}

#[test]
fn degenerate_geometry_has_no_answer() {
    let cameras = room();
    let point = joints()[1];
    let from_one_place = vec![cameras[0].clone(), cameras[0].clone()];
    assert!(is_nan(&dlt(&exact_detections(&[point], &from_one_place), &from_one_place)[0]));

    let origin = Vector3::zeros();
    let ahead = looking(origin, Vector3::new(5000.0, 0.0, 0.0));
    let further = looking(Vector3::new(-2000.0, 0.0, 0.0), Vector3::new(5000.0, 0.0, 0.0));
    let in_line = vec![ahead.clone(), further];
    let on_baseline = Vector3::new(3000.0, 0.0, 0.0);
    assert!(is_nan(&dlt(&exact_detections(&[on_baseline], &in_line), &in_line)[0]));

    let beside = looking(Vector3::new(0.0, 700.0, 0.0), Vector3::new(5000.0, 700.0, 0.0));
    let parallel = vec![ahead, beside];
    let same_pixel = Detections::new(2, 1, &[600.0, 400.0, 600.0, 400.0], None).unwrap();
    assert!(is_nan(&dlt(&same_pixel, &parallel)[0]));
    // Rays that part in front meet behind both cameras.
    let parting = Detections::new(2, 1, &[700.0, 400.0, 500.0, 400.0], None).unwrap();
    let meeting = Detections::new(2, 1, &[500.0, 400.0, 700.0, 400.0], None).unwrap();
    let answers = [parting, meeting].map(|d| is_nan(&dlt(&d, &parallel)[0]));
    assert_ne!(answers[0], answers[1], "exactly one of the two meets in front");
}

#[test]
fn wrong_counts_and_names_are_refused() {
    let cameras = room();
    let detections = exact_detections(&joints(), &cameras);
    let three = triangulate(&detections, &cameras[..3], Unit::Millimetre, Method::Dlt);
    assert_eq!(refused(three), "cameras");
    let error = Method::by_name("DLT2").unwrap_err();
    assert!(matches!(error, Error::UnknownName { argument: "method", .. }));
}

#[test]
fn fusion_weighs_by_inverse_mean_reprojection_error() {
    let cameras = &room()[..2];
    let truth = joints()[0];
    let estimates =
        [[30.0, 0.0, 0.0], [0.0, -50.0, 10.0], [5.0, 5.0, -90.0]].map(|d| truth + Vector3::from(d));
    let detections = exact_detections(&[truth], cameras);
    let error = |x: &Vector3<f64>| {
        let distance = |c: &Camera| (c.project(x).unwrap() - c.project(&truth).unwrap()).norm();
        (distance(&cameras[0]) + distance(&cameras[1])) / 2.0
    };
    let weights = estimates.map(|x| 1.0 / error(&x));
    let total: f64 = weights.iter().sum();
    let expected: Vector3<f64> = estimates.iter().zip(weights).map(|(x, w)| x * (w / total)).sum();
    let poses = estimates.map(|x| vec![x]);
    let found = fuse_monocular(&poses, &detections, cameras)[0];
    // three roundings of 1e3 mm
    assert!((found - expected).norm() < 1e-11);
    assert!((found - estimates.iter().sum::<Vector3<f64>>() / 3.0).norm() > 1.0);
}

#[test]
fn fusion_takes_the_views_that_there_are() {
    let cameras = room();
    let points = joints();
    let off = Vector3::new(20.0, 10.0, -5.0);
    let nan = Vector3::repeat(f64::NAN);
    let mut seen = pixels(&cameras, &points, |_, _| [0.0; 2]);
    for view in 0..4 {
        seen[2 * (3 * view + 1)] = f64::NAN;
    }
    seen[0] = f64::NAN;
    let detections = Detections::new(4, 3, &seen, None).unwrap();
    let poses =
        [vec![points[0] + off, points[1] + off, nan], vec![nan, points[1] - 3.0 * off, nan]];
    let found = fuse_monocular(&poses, &detections, &cameras);
    assert!((found[0] - points[0] - off).norm() < 1e-11, "one estimate is the answer");
    assert!((found[1] - points[1] + off).norm() < 1e-11, "no detection: the plain mean");
    assert!(is_nan(&found[2]), "no estimate");
}

#[test]
fn fusion_survives_exact_and_invisible_estimates() {
    let cameras = room();
    let truth = joints()[0];
    let detections = exact_detections(&[truth], &cameras);
    let near = truth + Vector3::new(40.0, 0.0, 0.0);
    let found = fuse_monocular(&[vec![truth], vec![near]], &detections, &cameras)[0];
    // 40 mm are about 7 px at 6 m, of which the floor of 1e-3 px is 1.4e-4: the exact one keeps all
    // but 6e-3 mm
    assert!((found - truth).norm() < 0.01 && (found - truth).norm() > 0.0);
    let both = fuse_monocular(&[vec![truth], vec![truth]], &detections, &cameras)[0];
    assert!((both - truth).norm() < 1e-11);
    let behind = Vector3::new(9000.0, 9000.0, 1600.0);
    let found = fuse_monocular(&[vec![behind], vec![near]], &detections, &cameras)[0];
    assert!((found - near).norm() < 1e-11);
    assert!(is_nan(&fuse_monocular(&[vec![behind]], &detections, &cameras)[0]));
}
