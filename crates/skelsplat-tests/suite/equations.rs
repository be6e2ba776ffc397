//! The posterior of coupled joints against dense algebra.

use nalgebra::{DMatrix, Matrix3, Vector3};
use skelsplat_core::study::annealed::equations::{Coupling, covariances};
use skelsplat_tests::scenes::Noise;

fn some_block(noise: &mut Noise) -> Matrix3<f64> {
    let a = Matrix3::from_fn(|_, _| noise.normal());
    a * a.transpose() + Matrix3::identity()
}

/// Blocks of order 1 and couplings that share joints, from nothing but numbers.
fn random_equations(seed: u64, n: usize) -> (Vec<Matrix3<f64>>, Vec<Coupling>) {
    let mut noise = Noise::new(seed);
    let blocks = (0..n).map(|_| some_block(&mut noise)).collect();
    let coupling = |(a, precision)| Coupling {
        joints: [a, a + 1, (a + 3) % n, (a + 4) % n],
        gradient: std::array::from_fn(|_| noise.vector(1.0)),
        residual: noise.normal(),
        precision,
        length: 1.0,
    };
    (blocks, [(0, 3.0), (1, 0.2), (2, 50.0)].map(coupling).to_vec())
}

/// Conditions stay below 1e4.
#[test]
fn covariances_are_blocks_of_the_dense_inverse() {
    for seed in 0..20 {
        let (blocks, couplings) = random_equations(seed, 7);
        let mut h = DMatrix::zeros(21, 21);
        for (j, block) in blocks.iter().enumerate() {
            h.fixed_view_mut::<3, 3>(3 * j, 3 * j).copy_from(block);
        }
        for c in &couplings {
            let mut g = DMatrix::zeros(21, 1);
            for (j, gradient) in c.ends() {
                let mut of_joint = g.fixed_view_mut::<3, 1>(3 * j, 0);
                of_joint += gradient;
            }
            h += &g * g.transpose() * c.precision;
        }
        let expected = h.try_inverse().unwrap();
        for (j, found) in covariances(&blocks, &couplings).iter().enumerate() {
            let block = expected.fixed_view::<3, 3>(3 * j, 3 * j);
            assert!((found - block).amax() < 1e-10, "seed {seed}, joint {j}");
        }
    }
}

/// A joint that nothing determines has no covariance, and the others have theirs.
#[test]
fn a_singular_block_has_no_covariance() {
    for singular in [Matrix3::zeros(), Matrix3::from_diagonal(&Vector3::new(2.0, 3.0, 0.0))] {
        let (mut blocks, couplings) = random_equations(4, 7);
        blocks[6] = singular;
        let found = covariances(&blocks, &couplings);
        assert_eq!(found[6], Matrix3::zeros());
        assert!(found[..6].iter().all(|covariance| covariance.cholesky().is_some()));
    }
}

/// One residual twice, so stiff that rounding leaves Q without its second pivot.
#[test]
fn couplings_that_rounding_makes_equal_give_a_finite_covariance() {
    let coupling = Coupling {
        joints: [0, 1, 0, 1],
        gradient: [Vector3::x(), -Vector3::x(), Vector3::zeros(), Vector3::zeros()],
        residual: 5.0,
        precision: 2.0_f64.powi(60),
        length: 1.0,
    };
    let found = covariances(&[Matrix3::identity(); 2], &[coupling; 2]);
    assert!(found[0].iter().all(|v| v.is_finite()));
    // Both move together.
    assert!((found[0].m11 - 0.5).abs() < 1e-9);
}
