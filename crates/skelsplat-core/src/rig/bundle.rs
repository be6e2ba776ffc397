//! Bundle adjustment: some cameras and all joints together, joints eliminated by the Schur
//! complement.
//!
//! A detection of confidence c with the residual r, px, at a joint where a pixel is a millimetres,
//! has e = a r and k = exp(−|e|²/4σ²), and costs c 2σ²(1 − k), the loss of the annealed method.
//! With W = c k a² its Gauss–Newton terms are W AᵀA for the joint, W BᵀB for the camera and W BᵀA
//! between them, A = ∂r/∂x, B = ∂r/∂θ. a counts as given, or a camera would gain by coming nearer.
//! For one joint with H = Σ W AᵀA, C = Σ W BᵀA, and gradients g of the cameras and h of the joint,
//!
//! ```text
//! S = Σ W BᵀB − C H⁻¹ Cᵀ      s = g − C H⁻¹ h      (Σ S) δθ = −Σ s      δx = −H⁻¹ Σ W Aᵀ(r + B δθ)
//! ```
//!
//! Each free parameter θ has a wide normal prior at its given value, which holds what no detection
//! does: ½ ŝ² (θ/σ_θ)², with the noise ŝ of a detection.

use nalgebra::{DMatrix, DVector, Matrix3, RowVector3, SMatrix, Vector2, Vector3};
use rayon::prelude::*;

use super::bias::{Follow, LastingErrors};
use super::placed::{Change, Freedom, PARAMETERS, Placed, Residual, Step, reach};
use super::prior::Lenses;
use super::reduced::{Judged, Reduced, jackknife, lasting, summed};
use super::scene::Scene;
use crate::error::Result;

/// Frames that one task sums up.
pub(super) const CHUNK: usize = 16;
/// Width of the final kernel in multiples of the noise.
pub const PER_NOISE: f64 = 2.5;
/// Least number of clusters.
const LEAST_CLUSTERS: usize = 12;
/// Most clusters where there are many joints.
const MOST_CLUSTERS: usize = 32;
/// Information on a joint that holds what no ray does, relative to a detection's.
const LOOSE: f64 = 1e-5;
/// Most widths above the final one, each half of the one before if so many suffice.
const WIDTHS: f64 = 8.0;
/// Most steps at the final width.
const STEPS: usize = 15;
/// The least that the kernel's own curvature leaves of what is known.
const LEAST_CURVED: f64 = 0.1;
/// Converged when no camera turns, rad, moves, relative to its distance, or changes otherwise by
/// more.
const STILL: f64 = 3e-6;
/// Cameras and joints that are adjusted together.
#[derive(Debug, Clone)]
pub struct Bundle<'a> {
    /// The detections.
    pub scene: Scene<'a>,
    /// Frames that are used.
    pub frames: &'a [usize],
    /// Cameras as given, to which the prior pulls.
    pub given: &'a [Placed],
    /// Cameras.
    pub cameras: Vec<Placed>,
    /// What of each may change.
    pub freedom: Vec<Freedom>,
    /// What is known of their focal lengths.
    pub lenses: &'a Lenses,
    /// Joints (frames, N), mm; NaN where unknown.
    pub points: Vec<Vector3<f64>>,
    /// Whether the joints are left where they are.
    pub fixed: bool,
    /// Errors of detections that last; `None`: they are noise as the others.
    pub offsets: Option<LastingErrors>,
}

/// One detection of a joint.
struct Term {
    view: usize,
    /// W.
    weight: f64,
    /// |e|²/2σ².
    size: f64,
    residual: Residual,
    /// d residual / d of the camera and of the offset.
    slope: Slopes,
}

/// A joint, and how it follows the cameras: d point / d of all their parameters (3, M · 9).
pub struct Follows {
    /// mm.
    pub point: Vector3<f64>,
    /// −H⁻¹ Σ W AᵀB.
    pub by: DMatrix<f64>,
}

/// Parameters of a camera, and the offset of a joint in its view.
const SLOPES: usize = PARAMETERS + 2;
type Slopes = SMatrix<f64, 2, SLOPES>;

/// Of an unknown its place, and its rows of C and of C H⁻¹.
type Row = (usize, RowVector3<f64>, RowVector3<f64>);

/// How the joints of one task move: of each H⁻¹ h, if anything is known of it, and where its rows
/// of C H⁻¹ end.
#[derive(Default)]
struct Moves {
    joints: Vec<(Option<Vector3<f64>>, usize)>,
    rows: Vec<(usize, RowVector3<f64>)>,
}

/// What a step sums up: the equations of every cluster in each part of the recording, in order, how
/// the joints move, and how offsets follow.
struct Cells {
    equations: Vec<Vec<Reduced>>,
    moves: Vec<Moves>,
    follow: Vec<Follow>,
}

/// Where a camera's parameters stand among those of all.
type Columns = Vec<Vec<(usize, usize)>>;

impl Bundle<'_> {
    /// Solves under kernels that narrow from `start` to `sigma`, mm. Ends early where a step would
    /// leave no camera.
    pub fn solve(&mut self, start: f64, sigma: f64) {
        let wider = if start.is_finite() { start / sigma } else { 1.0 };
        let widths = wider.log2().ceil().clamp(0.0, WIDTHS);
        for k in 0..widths as usize {
            let width = sigma * wider.powf(1.0 - k as f64 / widths);
            self.step(width);
            self.step(width);
        }
        for _ in 0..STEPS {
            if self.step(sigma) < STILL {
                break;
            }
        }
    }

    /// One step under kernels of the width `sigma`; how far it goes.
    fn step(&mut self, sigma: f64) -> f64 {
        let free = unknowns(&self.freedom);
        let Cells { equations, moves, follow } = self.cells(sigma);
        let mut sum = Reduced::sum(&summed(&equations));
        let reach = reach(&self.points, self.given);
        let prior = self.lenses.precision(&free, sigma / PER_NOISE, &reach);
        let changes: Vec<Change> = (0..self.cameras.len())
            .map(|i| Change::between(&self.given[i], &self.cameras[i]))
            .collect();
        let changed = free.iter().map(|(i, k)| changes[*i].parameter(*k));
        sum.gradient += &prior * DVector::from_iterator(free.len(), changed);
        sum.matrix += prior;
        let Some(factor) = sum.matrix.cholesky() else { return 0.0 };
        let delta = -factor.solve(&sum.gradient);
        let offsets = self.offsets.as_ref().map(|all| all.steps(&follow, &delta));
        let mut steps = vec![Step::zeros(); self.cameras.len()];
        let mut farthest = 0.0_f64;
        for (q, (i, k)) in free.into_iter().enumerate() {
            steps[i][k] = delta[q];
            let size = if (3..6).contains(&k) { delta[q] / reach[i] } else { delta[q] };
            farthest = farthest.max(size.abs());
        }
        let stepped = self.cameras.iter().zip(&steps).map(|(camera, step)| camera.stepped(step));
        let Ok(cameras) = stepped.collect::<Result<Vec<Placed>>>() else { return 0.0 };
        if !self.fixed {
            self.move_points(&moves, delta.as_slice(), offsets.as_deref());
        }
        self.cameras = cameras;
        if let (Some(all), Some(steps)) = (&mut self.offsets, &offsets) {
            all.add(steps);
            let near = reach.iter().copied().fold(f64::INFINITY, f64::min);
            let views = steps.iter().flat_map(|step| step.as_slice().chunks_exact(2));
            let sizes = views.map(|b| Vector2::new(b[0], b[1]).norm() / near);
            farthest = sizes.fold(farthest, f64::max);
        }
        farthest
    }

    /// The equations of every cluster: a joint, or where there are few joints a joint in a part of
    /// the recording.
    pub fn clusters(&self, sigma: f64) -> Vec<Reduced> {
        summed(&self.cells(sigma).equations)
    }

    /// What the detections of every joint cost in each part of the recording.
    pub fn costs(&self, sigma: f64) -> Vec<f64> {
        self.cells(sigma).equations.iter().flatten().map(|cell| cell.cost).collect()
    }

    /// All detections, each part of the recording by one task.
    fn cells(&self, sigma: f64) -> Cells {
        let n = self.scene.n_joints();
        let (columns, q) = self.columns();
        let parts = LEAST_CLUSTERS.div_ceil(n).min(self.frames.len()).max(1);
        let cell = |t: usize, j: usize| j + n * (t * parts / self.frames.len());
        let sum_of = |first: usize| {
            let mut out = vec![Reduced::nothing(q); n * parts];
            let (mut terms, mut rows, mut moves) = (Vec::new(), Vec::new(), Moves::default());
            for t in first..(first + CHUNK).min(self.frames.len()) {
                for j in 0..n {
                    out[cell(t, j)].cost += self.terms(t, j, sigma, &mut terms);
                    let pull = self.eliminate(&terms, &columns, &mut rows, &mut out[cell(t, j)]);
                    if !self.fixed {
                        moves.rows.extend(rows.iter().map(|(a, _, left): &Row| (*a, *left)));
                        moves.joints.push((pull, moves.rows.len()));
                    }
                }
            }
            (out, moves)
        };
        let starts: Vec<usize> = (0..self.frames.len()).step_by(CHUNK).collect();
        let (mut cells, moves): (Vec<Vec<Reduced>>, Vec<Moves>) =
            starts.into_par_iter().map(sum_of).unzip();
        let follow = self.offsets.as_ref().map_or_else(Vec::new, |all| all.eliminated(&mut cells));
        let joints = n.min(MOST_CLUSTERS);
        let merged = |all: Vec<Reduced>| {
            let mut out = vec![Reduced::nothing(all[0].gradient.len()); joints * parts];
            for (k, cell) in all.iter().enumerate() {
                out[k % n % joints + joints * (k / n)].add(cell);
            }
            out
        };
        Cells { equations: cells.into_iter().map(merged).collect(), moves, follow }
    }

    /// How each joint of which something is known follows the cameras.
    pub fn follows(&self, sigma: f64) -> Vec<Follows> {
        let (n, mut terms) = (self.scene.n_joints(), Vec::new());
        let follows = |(k, point): (usize, &Vector3<f64>)| {
            self.terms(k / n, k % n, sigma, &mut terms);
            let (inverse, _) = information(&terms)?;
            let mut by = DMatrix::zeros(3, PARAMETERS * self.cameras.len());
            for Term { view, weight, residual, .. } in &terms {
                let own = -inverse * residual.by_point.transpose() * residual.by_camera * *weight;
                by.fixed_columns_mut::<PARAMETERS>(PARAMETERS * view).copy_from(&own);
            }
            Some(Follows { point: *point, by })
        };
        self.points.iter().enumerate().filter_map(follows).collect()
    }

    /// Where the unknowns of each camera stand, and the offsets of its detections of a joint;
    /// number of all.
    fn columns(&self) -> (Columns, usize) {
        let mut columns: Columns = vec![Vec::new(); self.cameras.len()];
        let unknowns = unknowns(&self.freedom);
        let free = unknowns.len();
        unknowns.into_iter().enumerate().for_each(|(q, (i, k))| columns[i].push((q, k)));
        if self.offsets.is_none() {
            return (columns, free);
        }
        for (i, own) in columns.iter_mut().enumerate() {
            let at = free + 2 * i;
            own.extend([(at, PARAMETERS), (at + 1, PARAMETERS + 1)]);
        }
        (columns, free + 2 * self.cameras.len())
    }

    /// The detections of a joint that count, and what all of them cost.
    fn terms(&self, t: usize, j: usize, sigma: f64, out: &mut Vec<Term>) -> f64 {
        out.clear();
        let x = &self.points[t * self.scene.n_joints() + j];
        if !x.x.is_finite() {
            return 0.0;
        }
        let (mut cost, most) = (0.0, 2.0 * sigma * sigma);
        for (view, placed) in self.cameras.iter().enumerate() {
            let Some(sight) =
                self.scene.sight(self.frames[t], view, j, placed, self.freedom[view].clock)
            else {
                continue;
            };
            let Some(mut residual) = placed.residual(x, &sight) else {
                cost += sight.confidence * most;
                continue;
            };
            let mut slope = Slopes::zeros();
            slope.fixed_columns_mut::<PARAMETERS>(0).copy_from(&residual.by_camera);
            if let Some(offsets) = &self.offsets {
                residual.value -= offsets.at(view, j) / residual.pixel;
                let own = -1.0 / residual.pixel;
                slope[(0, PARAMETERS)] = own;
                slope[(1, PARAMETERS + 1)] = own;
            }
            let size = residual.pixel * residual.pixel;
            let scaled = size * residual.value.norm_squared() / most;
            let k = (-0.5 * scaled).exp();
            cost += sight.confidence * most * (1.0 - k);
            out.push(Term {
                view,
                weight: sight.confidence * k * size,
                size: scaled,
                residual,
                slope,
            });
        }
        cost
    }

    /// Adds what a joint says about the cameras, and returns H⁻¹ h, or `None` if nothing is known
    /// of the joint. Overwrites `rows`.
    fn eliminate(
        &self,
        terms: &[Term],
        columns: &Columns,
        rows: &mut Vec<Row>,
        out: &mut Reduced,
    ) -> Option<Vector3<f64>> {
        rows.clear();
        let (inverse, pull) = match self.fixed {
            true => (Matrix3::zeros(), Vector3::zeros()),
            false => information(terms).map(|(inverse, gradient)| (inverse, inverse * gradient))?,
        };
        for Term { view, weight, size, residual: r, slope } in terms {
            if columns[*view].is_empty() {
                continue;
            }
            out.weights[0] += weight;
            out.weights[1] += weight * (1.0 - 0.5 * size);
            for (a, k) in &columns[*view] {
                let own = slope.column(*k).transpose() * *weight;
                out.gradient[*a] += own.dot(&r.value.transpose());
                for (b, l) in &columns[*view] {
                    out.matrix[(*a, *b)] += own.dot(&slope.column(*l).transpose());
                }
                let mixed = own * r.by_point;
                rows.push((*a, mixed, mixed * inverse));
            }
        }
        for (a, mixed, left) in &*rows {
            out.gradient[*a] -= (mixed * pull).x;
            for (b, other, _) in &*rows {
                out.matrix[(*a, *b)] -= left.dot(other);
            }
        }
        Some(pull)
    }

    /// The joints' part of a step of the unknowns, and of the offsets.
    fn move_points(&mut self, moves: &[Moves], delta: &[f64], offsets: Option<&[DVector<f64>]>) {
        let n = self.scene.n_joints();
        let change = |j: usize, a: usize| match (a.checked_sub(delta.len()), offsets) {
            (Some(b), Some(all)) => all[j][b],
            _ => delta[a],
        };
        let mut points = self.points.iter_mut().enumerate();
        for Moves { joints, rows } in moves {
            let mut first = 0;
            for (pull, end) in joints {
                let Some((k, x)) = points.next() else { return };
                if let Some(pull) = pull {
                    let own = rows[first..*end].iter();
                    let shift: Vector3<f64> =
                        own.map(|(a, left)| left.transpose() * change(k % n, *a)).sum();
                    *x -= pull + shift;
                }
                first = *end;
            }
        }
    }

    /// Cost of every cluster, and the covariance of the unknowns by leaving out one cluster after
    /// the other, as detections err in common over time.
    ///
    /// Without cluster j the solution moves by δ_j = (S − S_j)⁻¹ s_j; their scatter J = (G−1)/G Σ
    /// δ_j δ_jᵀ is that of the solution (jackknife), to which the prior adds S⁻¹ Π S⁻¹. From some
    /// ten clusters single elements of J are uncertain by a third, but not its size relative to
    /// S⁻¹, φ = tr(S J)/tr(S⁻¹(S − Π)), without what the prior knows: error bars are those of φ
    /// S⁻¹/κ², where κ S has the curvature of the kernel itself.
    pub fn judge(&self, sigma: f64) -> Judged {
        let Cells { equations: cells, .. } = self.cells(sigma);
        let clusters = summed(&cells);
        let costs: Vec<f64> = clusters.iter().map(|cluster| cluster.cost).collect();
        let noise = sigma / PER_NOISE;
        let reach = reach(&self.points, self.given);
        let prior = self.lenses.precision(&unknowns(&self.freedom), noise, &reach);
        let q = prior.nrows();
        let mut whole = prior.clone();
        clusters.iter().for_each(|cluster| whole += &cluster.matrix);
        let of_joints = jackknife(&whole, &clusters);
        let (Some(of_joints), Some(inverse)) = (of_joints, whole.clone().try_inverse()) else {
            return Judged::unknown(costs, q);
        };
        let jackknife = of_joints + lasting(&whole, &cells);
        let even = (&whole * &jackknife).trace() / (q as f64 - (&inverse * &prior).trace());
        let held = &inverse * prior * &inverse * noise.powi(2);
        let [all, curved] = Reduced::sum(&clusters).weights;
        let curve = (curved / all).max(LEAST_CURVED);
        Judged {
            costs,
            steady: &inverse * (even / curve.powi(2)) + &held,
            covariance: jackknife + held,
            evidence: curve / even,
            moving: Vec::new(),
        }
    }
}

/// Camera and parameter of every unknown.
pub fn unknowns(freedom: &[Freedom]) -> Vec<(usize, usize)> {
    let all = freedom.iter().enumerate();
    all.flat_map(|(i, freedom)| freedom.columns().map(move |k| (i, k))).collect()
}

/// H⁻¹ and h of a joint; `None` if nothing is known of it.
fn information(terms: &[Term]) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    let (mut matrix, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    for Term { weight, residual, .. } in terms {
        let left = residual.by_point.transpose() * *weight;
        matrix += left * residual.by_point;
        gradient += left * residual.value;
    }
    let loose = LOOSE * matrix.trace();
    let inverse = (matrix + Matrix3::from_diagonal_element(loose)).try_inverse();
    inverse.filter(|_| loose > 0.0).map(|inverse| (inverse, gradient))
}
