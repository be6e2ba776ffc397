//! A camera that was moved while it recorded: what two parts of a recording say of its place.
//!
//! The rigs of both parts hold the first camera, with errors of the covariances C₁ and C₂. Their
//! difference d has the covariance C₁ + C₂ if nothing moved, but for the scale, which is free in
//! each: d = s g. If camera i moved by δ ~ N(0, V), d = s g + Eᵢ δ, with Eᵢ its own parameters, or
//! of the first those in which all others move together. With W, the inverse of C₁ + C₂
//! without g, A = Eᵢᵀ W Eᵢ and b = Eᵢᵀ W d, this explains t² = bᵀ (A + V⁻¹)⁻¹ b more. It happens
//! with the probability ε, so that the logarithm of the odds is ln ε/(1−ε) + t²/2 − ½ ln |1 + A V|,
//! with the tails of a t statistic in place of t²/2. δ is a turn, or a turn and a shift. The odds
//! are to be strong, and to exceed the number of moments from which the search begins.

use nalgebra::{DMatrix, DVector, Vector3};

use super::fit::Fit;
use super::{FEW, Filmed, Part, Task, Unknown, WIDER};
use crate::batch::Progress;
use crate::camera::Camera;
use crate::error::Result;
use crate::rig::bundle::{PER_NOISE, unknowns};
use crate::rig::evidence::{CHANGED, log_odds, turning_point};
use crate::rig::gauge::moved;
use crate::rig::placed::{Change, Placed, reach};
use crate::rig::prior::CALIBRATED;
use crate::rig::scene::Scene;
use crate::rig::search::Explanation;
use crate::statistics::STRONG;

/// Turn and shift.
const PLACE: usize = 6;
/// A turn alone.
const TURN: usize = 3;
/// Standard deviation of the turn of a camera that is knocked, rad, and of its shift, relative to
/// its distance from the joints.
const KNOCKED: [f64; 2] = [0.05, 0.05];
/// Most frames among which the one is found in which it was moved.
const LOOKED_AT: usize = 1000;
/// Fewer frames are no part.
const LEAST_FRAMES: usize = 20;
/// Quarters of the recording after which the search of that frame begins,
const BEGINNINGS: [usize; 3] = [2, 1, 3];
/// most divisions that follow from there,
const DIVISIONS: usize = 4;
/// and the part of the recording that the last one differs from the one before.
const SETTLED: f64 = 0.02;

/// The camera of a rig with known lenses that was moved while it recorded, and when; by these
/// views.
pub(in crate::rig) fn moved_camera(
    rig: &[Placed],
    Filmed { frames, times }: Filmed<'_>,
    views: &[usize],
    progress: &Progress,
) -> Result<Option<(usize, usize)>> {
    let given: Vec<Camera> = rig.iter().map(|placed| placed.camera.clone()).collect();
    let cameras: Vec<Placed> = views.iter().map(|i| rig[*i].clone()).collect();
    let (unknown, lenses) = (Unknown::default(), &CALIBRATED);
    let task = Task { given: &given, frames, times, part: None, unknown, lenses, distorted: false };
    task.moved(views, &cameras, progress)
}

impl Task<'_> {
    /// The camera that was moved while it recorded, and when: each part of the recording explains
    /// itself, and one camera's place differs.
    pub(super) fn moved(
        &self,
        views: &[usize],
        cameras: &[Placed],
        progress: &Progress,
    ) -> Result<Option<(usize, usize)>> {
        let seen = self.of_views(views);
        let mut frames = self.shared(&seen, cameras, LOOKED_AT);
        frames.sort_by_key(|t| self.times[*t]);
        for quarters in BEGINNINGS {
            let mut first = frames.len() * quarters / 4;
            for _ in 0..DIVISIONS {
                if first.min(frames.len() - first) < LEAST_FRAMES {
                    break;
                }
                let parts = self.parts(views, cameras, self.times[frames[first]], progress)?;
                let rigs = parts.each_ref().map(|(rig, _)| rig);
                let fit = &parts[0].1;
                let likeliest = moved_between(rigs, &reach(&fit.points, &rigs[0].cameras));
                let Some((k, odds)) = likeliest.filter(|(_, odds)| *odds > 0.0) else { break };
                let since = when_moved(Scene::new(&seen), &frames, rigs, k, PER_NOISE * fit.noise);
                let settled = since.abs_diff(first) as f64 <= SETTLED * frames.len() as f64
                    && odds > (STRONG * BEGINNINGS.len() as f64).ln();
                let agrees = |fit: &Fit| views.len() == 2 || fit.worst().is_none();
                let agreed = settled && parts.iter().all(|(_, fit)| agrees(fit));
                if let Some(frame) = frames.get(since).filter(|_| agreed) {
                    return Ok(Some((views[k], self.times[*frame])));
                }
                first = since;
            }
        }
        Ok(None)
    }

    /// The rigs of a recording before a time and from it on, and how well they fit.
    fn parts(
        &self,
        views: &[usize],
        cameras: &[Placed],
        time: usize,
        progress: &Progress,
    ) -> Result<[(Explanation, Fit); 2]> {
        let of = |part: Part| -> Result<(Explanation, Fit)> {
            let task = Self { part: Some(part), ..*self };
            let rig = task.adjusted(views, cameras.to_vec(), FEW, WIDER, progress)?;
            let fit = task.fit(views, &rig.cameras);
            Ok((rig, fit))
        };
        Ok([of(Part::Before(time))?, of(Part::From(time))?])
    }
}

/// The camera that likeliest moved between two rigs of the same cameras, and the logarithm of its
/// odds.
fn moved_between(parts: [&Explanation; 2], reach: &[f64]) -> Option<(usize, f64)> {
    let difference = Difference::between(parts)?;
    let odds = (0..reach.len()).filter_map(|i| Some((i, difference.odds(i, reach[i])?)));
    odds.max_by(|a, b| a.1.total_cmp(&b.1))
}

struct Difference<'a> {
    first: &'a Explanation,
    /// d of the turns and shifts of all cameras but the first.
    change: DVector<f64>,
    /// W.
    weight: DMatrix<f64>,
    clusters: usize,
}

impl<'a> Difference<'a> {
    /// `None` where one of the rigs has no error bars.
    fn between([first, second]: [&'a Explanation; 2]) -> Option<Self> {
        let m = first.cameras.len();
        let q = PLACE * (m - 1);
        let mut covariance = DMatrix::zeros(q, q);
        for part in [first, second] {
            let known = unknowns(&part.freedom).into_iter().enumerate();
            let known: Vec<_> = known.filter(|(_, (i, k))| *i > 0 && *k < PLACE).collect();
            for (a, (i, k)) in &known {
                for (b, (j, l)) in &known {
                    covariance[(PLACE * (i - 1) + k, PLACE * (j - 1) + l)] +=
                        part.judged.steady[(*a, *b)];
                }
            }
        }
        let inverse = covariance.cholesky()?.inverse();
        let change = |i: usize| Change::between(&first.cameras[i], &second.cameras[i]);
        let changes: Vec<Change> = (1..m).map(change).collect();
        let change = DVector::from_fn(q, |a, _| changes[a / PLACE].parameter(a % PLACE));
        let grown = Self::directions(first).column(PLACE).into_owned();
        let pulled = &inverse * &grown;
        let weight = &inverse - &pulled * pulled.transpose() / grown.dot(&pulled);
        let clusters = first.judged.costs.len().min(second.judged.costs.len());
        Some(Self { first, change, weight, clusters })
    }

    /// Turns, shifts and growth of all other cameras about the first.
    fn directions(rig: &Explanation) -> DMatrix<f64> {
        let first = rig.cameras[0].camera.centre();
        let mut out = DMatrix::zeros(PLACE * (rig.cameras.len() - 1), PLACE + 1);
        for (i, placed) in rig.cameras.iter().skip(1).enumerate() {
            let arm = placed.camera.centre() - first;
            out.view_mut((PLACE * i, 0), (3, 3)).copy_from(&-placed.camera.rotation());
            out.view_mut((PLACE * i + 3, 0), (3, PLACE + 1)).copy_from(&moved(&arm));
        }
        out
    }

    /// The logarithm of the odds that camera i, so far from the joints, moved.
    fn odds(&self, i: usize, reach: f64) -> Option<f64> {
        let q = self.change.len();
        let own = match i.checked_sub(1) {
            None => Self::directions(self.first).columns(0, PLACE).into_owned(),
            Some(k) => {
                DMatrix::from_fn(q, PLACE, |a, b| if a == PLACE * k + b { 1.0 } else { 0.0 })
            }
        };
        let turned = self.explained(&own.columns(0, TURN).into_owned(), reach)?;
        Some((CHANGED / (1.0 - CHANGED)).ln() + self.explained(&own, reach)?.max(turned))
    }

    /// How much more likely the difference is with these parameters of a camera.
    fn explained(&self, own: &DMatrix<f64>, reach: f64) -> Option<f64> {
        let sigma = |k: usize| if k < TURN { KNOCKED[0] } else { KNOCKED[1] * reach };
        let mut wide = own.transpose() * &self.weight * own;
        let pull = own.transpose() * &self.weight * &self.change;
        (0..own.ncols()).for_each(|k| wide[(k, k)] += sigma(k).powi(-2));
        let factor = wide.cholesky()?;
        let t = pull.dot(&factor.solve(&pull)).sqrt();
        let free = (0..own.ncols()).map(|k| (factor.l_dirty()[(k, k)] * sigma(k)).ln());
        Some(log_odds(t, self.clusters) - free.sum::<f64>())
    }
}

/// The place among these frames, in order of time, from which on camera i is where the second rig
/// has it: before it, the first rig costs least, and the second from it on.
fn when_moved(
    scene: Scene<'_>,
    frames: &[usize],
    rigs: [&Explanation; 2],
    i: usize,
    width: f64,
) -> usize {
    let m = rigs[0].cameras.len();
    let placed = rigs.map(|rig| scene.points(frames, &rig.cameras, |k| k != i || m == 2));
    let n = scene.n_joints();
    let more = |t: usize| {
        let cost = |part: usize| {
            let points: &[Vector3<f64>] = &placed[part][n * t..n * (t + 1)];
            let off = scene.distances(&frames[t..=t], points, i, &rigs[part].cameras[i]);
            off.iter().map(|(px, mm)| 1.0 - (-0.5 * (px * mm / width).powi(2)).exp()).sum::<f64>()
        };
        cost(0) - cost(1)
    };
    turning_point((0..frames.len()).map(more))
}
