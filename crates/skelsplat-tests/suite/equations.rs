//! One Gauss–Newton step: the normal equations against numerically differentiated residuals, and
//! against dense algebra.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use skelsplat_core::study::annealed::equations::{Coupling, NormalEquations};
use skelsplat_core::study::annealed::{
    Annealing, NoiseModel, Prior, Problem, Rays, Solution, Widening, solve,
};
use skelsplat_core::study::symmetry::LimbPair;
use skelsplat_tests::scenes::{Noise, noisy_detections, perturbed, room, standing};

/// Reach of the limbs' kernel, in σ_sym, as `annealed::solver` has it.
const REACH: f64 = 3.0;
const SIGMA: f64 = 60.0;
/// Of a detection of mean weight, mm.
const NOISE: f64 = 12.0;

fn pairs() -> Vec<LimbPair> {
    // Arms and legs, upper and lower: they share the elbows and the knees.
    vec![([12, 13], [15, 16]), ([5, 6], [2, 3]), ([11, 12], [14, 15]), ([4, 5], [1, 2])]
}

fn flat(points: &[Vector3<f64>]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

fn points(x: &[f64]) -> Vec<Vector3<f64>> {
    x.chunks_exact(3).map(Vector3::from_column_slice).collect()
}

fn some_block(noise: &mut Noise) -> Matrix3<f64> {
    let a = Matrix3::from_fn(|_, _| noise.normal());
    a * a.transpose() + Matrix3::identity()
}

/// A scene with noise, priors and limb pairs, linearised at `at` and not moved.
struct Linearised {
    rays: Rays,
    pairs: Vec<LimbPair>,
    priors: Vec<Prior>,
    at: Vec<Vector3<f64>>,
    solution: Solution,
    symmetry_sigma: f64,
}

impl Linearised {
    fn new(seed: u64) -> Self {
        let (cameras, mut noise) = (room(4), Noise::new(seed));
        let detections = noisy_detections(&standing(), &cameras, 4.0, &mut noise);
        let rays = Rays::new(&detections, &cameras, &[1.0, 0.5, 0.8, 1.0]);
        let at = perturbed(&standing(), 15.0, &mut noise);
        let prior = |x: &Vector3<f64>| Prior {
            mean: x + Vector3::new(20.0, -10.0, 5.0),
            precision: some_block(&mut Noise::new(seed + 1)) * 1e-3,
            spread: 30.0,
        };
        let priors: Vec<Prior> = at.iter().map(prior).collect();
        let n = at.len();
        let annealing = Annealing {
            max_steps: 0,
            noise: NoiseModel::Millimetres(NOISE),
            ..Annealing::of_joints(n)
        };
        let pairs = pairs();
        let problem = Problem {
            rays: &rays,
            pairs: &pairs,
            bones: &[],
            priors: Some(&priors),
            annealing: &annealing,
            widening: Widening::NONE,
        };
        let solution = solve(&problem, &at, &vec![SIGMA; n]);
        assert_eq!(solution.n_iter, 0);
        let symmetry_sigma = annealing.symmetry_sigma;
        Self { rays, pairs, priors, at, solution, symmetry_sigma }
    }

    /// All residuals at `x`, with the weights of `self.at`: their squares, halved, are what a step
    /// minimises.
    fn residuals(&self, x: &[Vector3<f64>]) -> Vec<f64> {
        let mut out = Vec::new();
        let noise = NOISE * self.rays.mean_weight().sqrt();
        for (j, (now, frozen)) in x.iter().zip(&self.at).enumerate() {
            for ray in self.rays.of_joint(j).iter().filter(|ray| ray.is_there()) {
                let e = ray.offset(frozen).across;
                let k = (-0.25 * e.norm_squared() / (SIGMA * SIGMA)).exp();
                out.extend((ray.offset(now).across * (ray.weight * k).sqrt() / noise).iter());
            }
            let factor = self.priors[j].precision.cholesky().unwrap().l();
            out.extend((factor.transpose() * (now - self.priors[j].mean)).iter());
        }
        let difference = |x: &[Vector3<f64>], ([a, b], [c, d]): &LimbPair| {
            (x[*a] - x[*b]).norm() - (x[*c] - x[*d]).norm()
        };
        for pair in &self.pairs {
            let kept =
                (-0.5 * (difference(&self.at, pair) / (REACH * self.symmetry_sigma)).powi(2)).exp();
            out.push(difference(x, pair) * kept.sqrt() / self.symmetry_sigma);
        }
        out
    }

    /// ∂residuals/∂x by central differences.
    fn jacobian(&self) -> DMatrix<f64> {
        let x = flat(&self.at);
        // Rounding: ulp of 5 m over h, 1e-10 of a residual; truncation: (h / 250 mm)² of a limb's,
        // 2e-9.
        let h = 1e-2;
        let columns: Vec<DVector<f64>> = (0..x.len())
            .map(|k| {
                let moved = |by: f64| {
                    let mut x = x.clone();
                    x[k] += by;
                    DVector::from_vec(self.residuals(&points(&x)))
                };
                (moved(h) - moved(-h)) / (2.0 * h)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}

#[test]
fn the_normal_matrix_is_that_of_the_residuals() {
    for seed in [1, 2] {
        let scene = Linearised::new(seed);
        let jacobian = scene.jacobian();
        let n = 3 * scene.at.len();
        let dense = DMatrix::from_row_slice(n, n, &scene.solution.equations.dense());
        let expected = jacobian.transpose() * &jacobian;
        assert!((&dense - &expected).amax() < 1e-8 * expected.amax());
        // The limbs are in it: elbow and wrist share a block.
        assert!(dense.view((36, 39), (3, 3)).amax() > 1e-3 * expected.amax());
    }
}

#[test]
fn the_step_is_that_of_the_residuals() {
    let mut scene = Linearised::new(3);
    let jacobian = scene.jacobian();
    let residuals = DVector::from_vec(scene.residuals(&scene.at));
    let normal = jacobian.transpose() * &jacobian;
    for mu in [0.0, 1e-3] {
        let damped = &normal + DMatrix::identity(normal.nrows(), normal.ncols()) * mu;
        let expected = -damped.lu().solve(&(jacobian.transpose() * &residuals)).unwrap();
        let step = DVector::from_vec(flat(scene.solution.equations.solve(|_| mu)));
        assert!(expected.amax() > 1.0);
        // The matrix's condition, below 1e2, times its own 1e-8.
        assert!((step - &expected).amax() < 1e-6 * expected.amax());
    }
}

/// Blocks of order 1 and couplings that share joints, from nothing but numbers.
fn random_equations(seed: u64, n: usize) -> (NormalEquations, DVector<f64>) {
    let mut noise = Noise::new(seed);
    let mut equations = NormalEquations::new(n);
    let mut gradient = DVector::zeros(3 * n);
    for j in 0..n {
        let pull = noise.vector(2.0);
        equations.set(j, some_block(&mut noise), pull);
        gradient.rows_mut(3 * j, 3).copy_from(&-pull);
    }
    for (a, precision) in [(0, 3.0), (1, 0.2), (2, 50.0), (3, 0.0)] {
        let joints = [a, a + 1, (a + 3) % n, (a + 4) % n];
        let coupling = Coupling {
            joints,
            gradient: std::array::from_fn(|_| noise.vector(1.0)),
            residual: noise.normal(),
            precision,
        };
        for (j, g) in joints.iter().zip(&coupling.gradient) {
            let mut part = gradient.rows_mut(3 * j, 3);
            part += g * (coupling.residual * precision);
        }
        equations.couple(coupling);
    }
    (equations, gradient)
}

fn dense(equations: &NormalEquations) -> DMatrix<f64> {
    let h = equations.dense();
    let n = h.len().isqrt();
    DMatrix::from_row_slice(n, n, &h)
}

/// Conditions stay below 1e4: 1e-12 of the step.
#[test]
fn woodbury_solves_the_dense_system() {
    for seed in 0..20 {
        let (mut equations, gradient) = random_equations(seed, 7);
        let h = dense(&equations);
        let mu = |j: usize| 0.1 * (j % 3) as f64;
        let damped = &h + DMatrix::from_fn(21, 21, |a, b| if a == b { mu(a / 3) } else { 0.0 });
        let expected = -damped.lu().solve(&gradient).unwrap();
        let step = DVector::from_vec(flat(equations.solve(mu)));
        assert!((step - &expected).amax() < 1e-12 * expected.amax().max(1.0), "seed {seed}");
    }
}

#[test]
fn covariances_are_blocks_of_the_dense_inverse() {
    for seed in 0..20 {
        let (mut equations, _) = random_equations(seed, 7);
        let expected = dense(&equations).try_inverse().unwrap();
        equations.factorise(|_| 0.0);
        for j in 0..7 {
            let block = expected.fixed_view::<3, 3>(3 * j, 3 * j);
            assert!((equations.covariance(j) - block).amax() < 1e-12, "seed {seed}, joint {j}");
        }
    }
}

/// Three joints of four are determined; the fourth, coupled with them, stays fixed.
#[test]
fn a_singular_block_does_not_move_and_holds_the_others() {
    for singular in [Matrix3::zeros(), Matrix3::from_diagonal(&Vector3::new(2.0, 3.0, 0.0))] {
        let mut noise = Noise::new(4);
        let mut equations = NormalEquations::new(4);
        for j in 0..3 {
            equations.set(j, some_block(&mut noise), noise.vector(1.0));
        }
        equations.set(3, singular, Vector3::new(5.0, 5.0, 0.0));
        let coupling = Coupling {
            joints: [0, 3, 1, 2],
            gradient: std::array::from_fn(|_| noise.vector(1.0)),
            residual: 0.7,
            precision: 4.0,
        };
        equations.couple(coupling);
        let h = dense(&equations);
        let mut gradient = DVector::zeros(9);
        let mut again = Noise::new(4);
        for j in 0..3 {
            let _ = some_block(&mut again);
            gradient.rows_mut(3 * j, 3).copy_from(&-again.vector(1.0));
        }
        for (j, g) in coupling.joints.iter().zip(&coupling.gradient).filter(|(j, _)| **j < 3) {
            let mut part = gradient.rows_mut(3 * j, 3);
            part += g * (coupling.residual * coupling.precision);
        }
        let kept = h.view((0, 0), (9, 9)).into_owned();
        let expected = -kept.lu().solve(&gradient).unwrap();
        let step = equations.solve(|_| 0.0);
        assert_eq!(step[3], Vector3::zeros());
        assert!((DVector::from_vec(flat(&step[..3])) - expected).amax() < 1e-12);
        assert_eq!(equations.covariance(3), Matrix3::zeros());
    }
}

/// One residual twice, so stiff that rounding leaves Q without its second pivot: the step is that
/// of the residual once.
#[test]
fn couplings_that_rounding_makes_equal_give_a_finite_step() {
    let mut equations = NormalEquations::new(2);
    equations.set(0, Matrix3::identity(), Vector3::x() * 3.0);
    equations.set(1, Matrix3::identity(), Vector3::y());
    let gradient = [Vector3::x(), -Vector3::x(), Vector3::zeros(), Vector3::zeros()];
    let coupling =
        Coupling { joints: [0, 1, 0, 1], gradient, residual: 5.0, precision: 2.0_f64.powi(60) };
    equations.couple(coupling);
    equations.couple(coupling);
    let step = equations.solve(|_| 0.0);
    assert!((step[0] - Vector3::new(-1.0, 0.0, 0.0)).amax() < 1e-12);
    assert!((step[1] - Vector3::new(4.0, 1.0, 0.0)).amax() < 1e-12);
    assert!(equations.covariance(0).iter().all(|v| v.is_finite()));
}
