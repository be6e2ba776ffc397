//! The parts of a sequence: against dense algebra, central differences and simple motions.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use skelsplat_core::JointStatus;
use skelsplat_core::study::annealed::{Alone, Ray, Rays};
use skelsplat_core::study::bones::{Length, Pull};
use skelsplat_core::study::outcome::ErrorBars;
use skelsplat_core::study::sequence::Learnt;
use skelsplat_core::study::sequence::chain::{Chain, second_difference, stiffness};
use skelsplat_core::study::sequence::lasting::Memory;
use skelsplat_core::study::sequence::noise::{DetectionNoise, Kernel};
use skelsplat_core::study::sequence::posterior::posterior;
use skelsplat_core::study::sequence::process_noise::{self, ProcessNoise};
use skelsplat_core::study::sequence::solver::{Common, WindowSolver};
use skelsplat_core::study::sequence::system::System;
use skelsplat_core::study::sequence::tracks::Tracks;
use skelsplat_tests::differences::{central_differences, relative_error};
use skelsplat_tests::scenes::Noise;

fn some_block(noise: &mut Noise) -> Matrix3<f64> {
    let a = Matrix3::from_fn(|_, _| noise.normal());
    a * a.transpose() + 0.1 * Matrix3::identity()
}

/// Weights of second differences of `n` frames, some of which are missing.
fn some_weights(n: usize, noise: &mut Noise) -> Vec<f64> {
    (0..n).map(|t| if t == 0 || t + 1 == n || t % 7 == 3 { 0.0 } else { noise.uniform() }).collect()
}

/// The chain's matrix, from the second differences themselves.
fn dense(blocks: &[Matrix3<f64>], w: &[f64]) -> DMatrix<f64> {
    let n = blocks.len();
    let mut a = DMatrix::zeros(3 * n, 3 * n);
    for (t, block) in blocks.iter().enumerate() {
        a.view_mut((3 * t, 3 * t), (3, 3)).copy_from(block);
    }
    for (t, w) in w.iter().enumerate().take(n.max(1) - 1).skip(1) {
        for (p, cp) in [(t - 1, 1.0), (t, -2.0), (t + 1, 1.0)] {
            for (q, cq) in [(t - 1, 1.0), (t, -2.0), (t + 1, 1.0)] {
                (0..3).for_each(|k| a[(3 * p + k, 3 * q + k)] += w * cp * cq);
            }
        }
    }
    a
}

#[test]
fn a_chain_is_solved_and_inverted_like_its_dense_matrix() {
    let mut noise = Noise::new(3);
    for n in [1, 2, 3, 20] {
        let blocks: Vec<_> = (0..n).map(|_| some_block(&mut noise)).collect();
        let w = if n > 2 { some_weights(n, &mut noise) } else { vec![0.0; n] };
        let a = dense(&blocks, &w);
        let mut chain = Chain::default();
        chain.factorise(&w, |t| blocks[t]);
        let b: Vec<Vector3<f64>> = (0..n).map(|_| noise.vector(1.0)).collect();
        let mut x = b.clone();
        chain.solve(&mut x);
        let flat = |v: &[Vector3<f64>]| DVector::from_iterator(3 * n, v.iter().flatten().copied());
        assert!((&a * flat(&x) - flat(&b)).amax() < 1e-9);
        let inverse = a.try_inverse().unwrap();
        for (t, band) in chain.selected_inverse().iter().enumerate() {
            let block = |k: usize| inverse.fixed_view::<3, 3>(3 * t, 3 * k).into_owned();
            assert!((band.own - block(t)).amax() < 1e-9);
            if t + 1 < n {
                assert!((band.next - block(t + 1)).amax() < 1e-9);
            }
            if t + 2 < n {
                assert!((band.after - block(t + 2)).amax() < 1e-9);
            }
        }
        let v = flat(&x);
        let bent: f64 =
            (1..n.max(2) - 1).map(|t| w[t] * second_difference(&x, t).norm_squared()).sum();
        let own: f64 = (0..n).map(|t| x[t].dot(&(blocks[t] * x[t]))).sum();
        assert!((v.dot(&flat(&b)) - own - bent).abs() < 1e-9);
        assert!(w.is_empty() || stiffness(&w, 0) >= 0.0);
    }
}

#[test]
fn a_bone_pulls_along_the_gradient_of_its_loss() {
    let length = Length { mean: 300.0, sigma: 12.0 };
    let b = Vector3::new(10.0, -20.0, 900.0);
    for a in [Vector3::new(200.0, 100.0, 1100.0), Vector3::new(100.0, 50.0, 1080.0)] {
        let pull = Pull::new(&a, &b, length);
        let loss = |x: &[f64]| {
            let (a, b) = (Vector3::from_column_slice(&x[..3]), Vector3::from_column_slice(&x[3..]));
            Pull::new(&a, &b, length).loss
        };
        let x: Vec<f64> = a.iter().chain(&b).copied().collect();
        let g = pull.gradient();
        let analytic: Vec<f64> = g.iter().copied().chain((-g).iter().copied()).collect();
        assert!(relative_error(&analytic, &central_differences(&x, 1e-3, loss)) < 1e-7);
        // The block is the derivative of the gradient under the kernel's present weight, for a
        // stretched bone.
        let kept = pull.stiffness;
        let frozen = |x: &[f64], axis: usize| {
            let d = Vector3::from_column_slice(x) - b;
            kept * (d.norm() - length.mean) * d[axis] / d.norm()
        };
        if (a - b).norm() > length.mean {
            for axis in 0..3 {
                let row = central_differences(a.as_slice(), 1e-3, |x| frozen(x, axis));
                let block: Vec<f64> = pull.block().row(axis).iter().copied().collect();
                assert!(relative_error(&block, &row) < 1e-6);
            }
        } else {
            assert!((pull.block() - kept * pull.along * pull.along.transpose()).amax() < 1e-15);
        }
        let v = Vector3::new(0.3, -0.7, 0.2);
        assert!((pull.times(&v) - pull.block() * v).amax() < 1e-12);
    }
    assert_eq!(Pull::new(&b, &b, length), Pull::default());
}

#[test]
fn conjugate_gradients_solve_the_dense_system() {
    let (frames, joints) = (20, 4);
    let mut noise = Noise::new(11);
    let mut system = System::new(frames, joints, &[[0, 1], [1, 2], [1, 3]]);
    for k in 0..frames * joints {
        system.blocks[k] = some_block(&mut noise);
        system.pulls[k] = noise.vector(1.0);
    }
    for j in 0..joints {
        let of = system.of(j);
        system.weights[of].copy_from_slice(&some_weights(frames, &mut noise));
    }
    let length = Length { mean: 1.0, sigma: 0.3 };
    for pull in &mut system.lengths {
        *pull = Pull::new(&noise.vector(1.0), &noise.vector(1.0), length);
    }
    let n = 3 * frames * joints;
    let h = DMatrix::from_row_slice(n, n, &system.dense());
    assert!((&h - h.transpose()).amax() < 1e-12);
    let mu = 0.01;
    let b = DVector::from_iterator(n, system.pulls.iter().flatten().copied());
    let expected = (h + DMatrix::identity(n, n) * mu).cholesky().unwrap().solve(&b);
    let step = system.solve(mu, 1e-12, 500);
    let step = DVector::from_iterator(n, step.iter().flatten().copied());
    assert!((step - &expected).amax() < 1e-8 * expected.amax());
}

#[test]
fn motion_is_not_measured_across_stretches() {
    let place = |x: f64| {
        let mut noise = Noise::new(13);
        let frame = |t: usize| {
            let sway = Vector3::new(x + 60.0 * (0.05 * t as f64).sin(), 0.0, 900.0);
            standing_still(sway + noise.vector(2.0), 2)
        };
        (0..40).map(frame).collect::<Vec<Alone>>()
    };
    let measured = |x: f64| {
        let (first, second) = (place(0.0), place(x));
        process_noise::learn(&Tracks::new(&[&first, &second], 30, &uniform(2)), 30.0, &[12.0])[0]
            .usual
    };
    let (near, far) = (measured(0.0), measured(2000.0));
    assert!((near / far - 1.0).abs() < 1e-9, "{near} in one place, {far} in two");
}

#[test]
fn process_noise_is_that_of_the_time_where_three_views_agree() {
    let measured = |views: usize| {
        let mut noise = Noise::new(17);
        let frame = |t: usize| {
            let swing = if t < 90 { 0.0 } else { 80.0 * (0.7 * t as f64).sin() };
            standing_still(Vector3::new(swing, 0.0, 900.0) + noise.vector(2.0), views)
        };
        let frames: Vec<Alone> = (0..180).map(frame).collect();
        let tracks = Tracks::new(&[&frames], 30, &uniform(views));
        let usual = process_noise::learn(&tracks, 30.0, &[12.0]);
        (process_noise::local(&tracks, 30.0, &[], &usual), usual[0].usual)
    };
    let (local, usual) = measured(3);
    assert!(local[10..65].iter().all(|q| *q < 0.5 * usual), "rest: {usual}");
    assert!(local[115..165].iter().all(|q| *q > usual), "motion: {usual}");
    let (local, usual) = measured(2);
    assert!(local.iter().all(|q| (q / usual - 1.0).abs() < 1e-12));
}

/// Kernels of 30 mm for so many joints.
fn fixed(joints: usize) -> Kernel {
    Kernel { sigma: vec![30.0; joints], per_noise: None, usual: 30.0, least: 0.0 }
}

/// The noise of one joint in so many views.
fn uniform(views: usize) -> DetectionNoise {
    DetectionNoise::uniform(vec![1.0; views], 12.0, fixed(1))
}

/// A frame with one joint at `x`, which so many views see.
fn standing_still(x: Vector3<f64>, views: usize) -> Alone {
    let ray = |direction: Vector3<f64>| Ray {
        centre: x - 4000.0 * direction,
        direction,
        weight: 1.0,
        pixel: 1e-3,
    };
    Alone {
        rays: Rays::of(
            [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().take(views).map(ray).collect(),
            views,
        ),
        used_for: vec![0; views],
        points: vec![x],
        bars: ErrorBars {
            covariances: vec![4.0 * Matrix3::identity()],
            believed: Vec::new(),
            noise: 2.0,
            status: vec![JointStatus::Ok],
        },
    }
}

#[test]
fn bones_tell_a_frame_what_the_dense_inverse_tells() {
    // A tree of four joints, of which the third is seen by one view only: its messages need two
    // sweeps.
    let joints =
        [[0.0, 0.0, 0.0], [200.0, 50.0, 30.0], [350.0, -40.0, 210.0], [180.0, 260.0, -60.0]];
    let joints = joints.map(Vector3::from);
    let bones = vec![[0, 1], [1, 2], [1, 3]];
    let lengths: Vec<Length> = bones
        .iter()
        .map(|[a, b]: &[usize; 2]| Length { mean: (joints[*a] - joints[*b]).norm(), sigma: 9.0 })
        .collect();
    let centres = [[3000.0, 0.0, 500.0], [-800.0, 2800.0, 900.0], [-900.0, -2700.0, 300.0]]
        .map(Vector3::from);
    let ray = |j: usize, i: usize| {
        let direction = (joints[j] - centres[i]).normalize();
        match (j, i) {
            (2, 1 | 2) => Ray::default(),
            _ => Ray { centre: centres[i], direction, weight: 1.0, pixel: 1e-3 },
        }
    };
    let rays = (0..4).flat_map(|j| (0..3).map(move |i| ray(j, i))).collect();
    let alone = Alone {
        rays: Rays::of(rays, 3),
        used_for: (0..3).flat_map(|_| 0..4).collect(),
        points: joints.to_vec(),
        bars: ErrorBars {
            covariances: vec![Matrix3::identity() * 100.0; 4],
            believed: Vec::new(),
            noise: 10.0,
            status: vec![JointStatus::Ok; 4],
        },
    };
    let common = Common {
        fps: 30.0,
        bones: bones.clone(),
        lengths,
        process_noise: vec![ProcessNoise::steady(1e6); 4],
        noise: DetectionNoise {
            confidence: vec![1.0; 3],
            variance: [120.0, 90.0, 100.0, 150.0].iter().flat_map(|v| [*v; 3]).collect(),
            wrong: 0.1,
            kernel: fixed(4),
        },
        reach: 400.0,
    };
    let tracks = Tracks::new(&[std::slice::from_ref(&alone)], 30, &common.noise);
    let mut run = WindowSolver::new(&tracks, &common, Some(joints.to_vec()));
    run.linearise(1.0);
    let white = vec![Memory { constant: 0.0, rest: Vec::new(), common: 0.0 }; 4];
    let learnt = Learnt { common: common.clone(), memory: white, shown: vec![true; 3] };
    let found = posterior(&run, &learnt);
    // What the joints know by themselves: the inverse of their blocks.
    let mut without = learnt.clone();
    without.common.bones.clear();
    let mut own = WindowSolver::new(&tracks, &without.common, Some(joints.to_vec()));
    own.linearise(1.0);
    let alone = posterior(&own, &without);
    assert!((alone.positions[0] - own.bands(0)[0].own).amax() < 1e-9);
    let mut information = DMatrix::zeros(12, 12);
    for j in 0..4 {
        let known = alone.positions[j].try_inverse().unwrap();
        information.view_mut((3 * j, 3 * j), (3, 3)).copy_from(&known);
    }
    for (b, [a, c]) in bones.iter().enumerate() {
        let pull = &run.system.lengths[b];
        // Errors across the bone of the ends that two views see make its direction uncertain: the
        // second moment of |e|²/2l.
        let seen = [a, c].into_iter().filter(|j| **j != 2);
        let errors: Matrix3<f64> = seen.map(|j| alone.positions[*j]).sum();
        let across = Matrix3::identity() - pull.along * pull.along.transpose();
        let spread = (across * errors * across).symmetric_eigenvalues();
        let square = spread.sum().powi(2) + 2.0 * spread.norm_squared();
        let bent = square / (2.0 * (joints[*a] - joints[*c]).norm()).powi(2);
        assert!(bent > 1e-3);
        let stiffness = 1.0 / (1.0 / pull.stiffness + bent);
        let block = pull.along * pull.along.transpose() * stiffness;
        for (p, q, sign) in [(a, a, 1.0), (c, c, 1.0), (a, c, -1.0), (c, a, -1.0)] {
            let mut part = information.view_mut((3 * p, 3 * q), (3, 3));
            part += block * sign;
        }
    }
    let dense = information.try_inverse().unwrap();
    for j in 0..4 {
        let expected = dense.fixed_view::<3, 3>(3 * j, 3 * j).into_owned();
        let error = (found.positions[j] - expected).amax() / expected.amax();
        assert!(error < 1e-9, "joint {j}: {error}");
    }
    assert!(found.positions[2].trace() < 0.1 * alone.positions[2].trace());
}
