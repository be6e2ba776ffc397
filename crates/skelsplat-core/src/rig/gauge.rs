//! Error bars of a rig of which only the shape is known.
//!
//! Turning, moving and scaling everything changes no detection. The bundle holds the first camera;
//! the error bars of the others then contain how well that one is known. Without this freedom,
//! the errors θ of all cameras are those of the rig aligned with the truth: with the seven
//! directions G in which everything moves together, θ − G A θ, A = (GᵀWG)⁻¹ GᵀW, in which W makes
//! turns and shifts comparable. Joints that follow the cameras by F and move by E in these
//! directions are off by (I − E (EᵀE)⁻¹ Eᵀ) F θ with all joints aligned.

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector3};

use super::bundle::{Follows, unknowns};
use super::evidence::{Bars, bars};
use super::placed::{PARAMETERS, ZOOM};
use super::search::Explanation;

/// Turns, shifts and growth of everything.
const DIRECTIONS: usize = 7;

/// How sure a rig is.
pub struct Sureness {
    /// Covariance of all parameters, the first camera held.
    covariance: DMatrix<f64>,
    /// G.
    free: DMatrix<f64>,
    /// A.
    aligned: DMatrix<f64>,
}

/// What a rig with free lenses says of their focal lengths.
pub struct Zooms {
    /// Logarithms of them, d.
    pub estimate: DVector<f64>,
    /// C.
    pub covariance: DMatrix<f64>,
    /// How all parameters θ follow them, cov(θ, d) C⁻¹.
    pub by: DMatrix<f64>,
}

impl Sureness {
    /// Of a rig; `None` of cameras in one place.
    pub fn of(rig: &Explanation) -> Option<Self> {
        let m = rig.cameras.len();
        let q = PARAMETERS * m;
        let mut covariance = DMatrix::zeros(q, q);
        let free = unknowns(&rig.freedom);
        for (a, (i, k)) in free.iter().enumerate() {
            for (b, (j, l)) in free.iter().enumerate() {
                covariance[(PARAMETERS * i + k, PARAMETERS * j + l)] = rig.judged.steady[(a, b)];
            }
        }
        let centres: Vec<Vector3<f64>> = rig.cameras.iter().map(|c| c.camera.centre()).collect();
        let middle = centres.iter().sum::<Vector3<f64>>() / m as f64;
        let squares: f64 = centres.iter().map(|c| (c - middle).norm_squared()).sum();
        let reach = (squares / m as f64).sqrt();
        let mut free = DMatrix::zeros(q, DIRECTIONS);
        let mut weight = DMatrix::zeros(q, q);
        for (i, centre) in centres.iter().enumerate() {
            let rotation = rig.cameras[i].camera.rotation();
            let row = PARAMETERS * i;
            // The world turned by ω: R becomes R exp(−ω), which is a turn −Rω of the camera.
            free.view_mut((row, 0), (3, 3)).copy_from(&-rotation);
            free.view_mut((row + 3, 0), (3, DIRECTIONS)).copy_from(&moved(&(centre - middle)));
            for d in 0..3 {
                weight[(row + d, row + d)] = reach * reach;
                weight[(row + 3 + d, row + 3 + d)] = 1.0;
            }
        }
        let known = free.transpose() * weight;
        let aligned = (&known * &free).try_inverse()? * known;
        Some(Self { covariance, free, aligned })
    }

    /// Error bars of every camera.
    pub fn bars(&self) -> Vec<Bars> {
        let q = self.covariance.nrows();
        let keep = DMatrix::identity(q, q) - &self.free * &self.aligned;
        let covariance = &keep * &self.covariance * keep.transpose();
        let all: Vec<(usize, usize)> = (0..q).map(|a| (a / PARAMETERS, a % PARAMETERS)).collect();
        (0..q / PARAMETERS).map(|i| bars(&covariance, &all, i)).collect()
    }

    /// What it says of focal lengths that are free, with so large logarithms.
    pub fn zooms(&self, estimate: DVector<f64>) -> Option<Zooms> {
        let own = |i: usize| PARAMETERS * i + ZOOM;
        let (m, q) = (estimate.len(), self.covariance.nrows());
        let covariance = DMatrix::from_fn(m, m, |i, j| self.covariance[(own(i), own(j))]);
        let mixed = DMatrix::from_fn(m, q, |i, a| self.covariance[(own(i), a)]);
        let by = covariance.clone().cholesky()?.solve(&mixed).transpose();
        Some(Zooms { estimate, covariance, by })
    }

    /// Adds errors with this covariance that all parameters follow.
    pub fn widen(&mut self, by: &DMatrix<f64>, covariance: &DMatrix<f64>) {
        self.covariance += by * covariance * by.transpose();
    }

    /// Adds errors of the cameras' turns about both axes of their images, rad.
    pub fn turn(&mut self, sigmas: &[f64]) {
        for (i, sigma) in sigmas.iter().enumerate() {
            for row in [PARAMETERS * i, PARAMETERS * i + 1] {
                self.covariance[(row, row)] += sigma * sigma;
            }
        }
    }

    /// How far joints that follow the cameras are off with all of them aligned, root mean square
    /// per axis.
    pub fn joints(&self, all: &[Follows]) -> f64 {
        let count = all.len() as f64;
        let middle = all.iter().map(|follows| follows.point).sum::<Vector3<f64>>() / count;
        let (q, own) = (self.covariance.nrows(), |x: &Follows| moved(&(x.point - middle)));
        let (mut square, mut mixed) = (SMatrix::zeros(), DMatrix::zeros(DIRECTIONS, q));
        for follows in all {
            square += own(follows).transpose() * own(follows);
            mixed += own(follows).transpose() * &follows.by;
        }
        let Some(inverse) = square.try_inverse() else { return f64::NAN };
        let aligned = inverse * mixed;
        let off = |follows: &Follows| {
            let by = &follows.by - own(follows) * &aligned;
            (&by * &self.covariance * by.transpose()).trace()
        };
        (all.iter().map(off).sum::<f64>() / (3.0 * count)).sqrt()
    }
}

/// How a point moves when the world turns, moves and grows about the origin.
pub(super) fn moved(x: &Vector3<f64>) -> SMatrix<f64, 3, DIRECTIONS> {
    let mut out = SMatrix::<f64, 3, DIRECTIONS>::zeros();
    out.fixed_columns_mut::<3>(0).copy_from(&-x.cross_matrix());
    out.fixed_columns_mut::<3>(3).copy_from(&Matrix3::identity());
    out.set_column(6, x);
    out
}
