//! What a stretch of a recording gives: rays and the poses of each frame alone, joint after joint.

use nalgebra::{Matrix3, Vector3};

use super::noise::DetectionNoise;
use super::times::BRIDGE;
use crate::annealed::Alone;
use crate::annealed::consensus::REJECTED;
use crate::annealed::rays::{Offset, Ray};
use crate::statistics::median;

/// Weight of rays that agree closely.
const CLOSE: f64 = 0.7;
/// Root mean square deviation, in standard deviations, of the joints from a steady motion that
/// shows a cut.
const JUMP: f64 = 2.0;
/// Least number of joints that show a cut, at least half of those that are estimated.
const LEAST_JOINTS: usize = 3;

/// How a ray is weighted.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Weights {
    /// Precision of the detection, mm⁻².
    pub precision: f64,
    /// 1/4σ² of its final kernel.
    narrow: f64,
    /// Its least k: that at a position on which all of at least three agree closely, else 0.
    pub held: f64,
}

impl Weights {
    /// k at this offset under a kernel with `narrower` times the final 1/4σ².
    #[inline]
    pub(super) fn kernel(&self, offset: &Offset, narrower: f64) -> f64 {
        if offset.range <= 0.0 {
            return 0.0;
        }
        (-self.narrow * narrower * offset.across.norm_squared()).exp()
    }
}

/// Rays and positions of T frames; `(N, T)` means joint after joint, each over all frames.
#[derive(Debug, Clone)]
pub struct Tracks {
    /// T.
    pub frames: usize,
    /// N.
    pub joints: usize,
    /// M.
    pub views: usize,
    /// Rays `(N, T, M)`.
    rays: Vec<Ray>,
    /// How they are weighted `(N, T, M)`.
    pub weights: Vec<Weights>,
    /// Positions of each frame alone `(N, T)`, mm; NaN where unknown.
    pub alone: Vec<Vector3<f64>>,
    /// Their covariances `(N, T)`, mm².
    pub spread: Vec<Matrix3<f64>>,
    /// Whether the joint is estimated in the frame `(N, T)`.
    pub active: Vec<bool>,
    /// Whether three views, or both of two, agree on the position of the frame alone `(N, T)`.
    pub sure: Vec<bool>,
    /// Whether the frame alone has exchanged the ray's side `(N, T, M)`.
    pub(super) turned: Vec<bool>,
    /// Number of cuts before each frame and at it `(T)`: a cut lies between a frame and the one
    /// before.
    cuts: Vec<usize>,
    /// Spectral density q of the acceleration `(N, T)`, mm²/s³; empty where it is the usual one at
    /// all times.
    pub process_noise: Vec<f64>,
}

impl Tracks {
    /// The tracks of `stretches` of consecutive frames, one after the other; motion does not
    /// connect them.
    ///
    /// A joint is estimated between frames that give it a position, over gaps of at most `longest`
    /// frames.
    pub fn new(stretches: &[&[Alone]], longest: usize, noise: &DetectionNoise) -> Self {
        let first = &stretches[0][0];
        let (n, m) = (first.points.len(), first.rays.n_views());
        let own: usize = stretches.iter().map(|s| s.len()).sum();
        let t = own + stretches.len() - 1;
        let mut tracks = Self {
            frames: t,
            joints: n,
            views: m,
            rays: vec![Ray::default(); n * t * m],
            weights: vec![Weights::default(); n * t * m],
            alone: vec![Vector3::repeat(f64::NAN); n * t],
            spread: vec![Matrix3::repeat(f64::NAN); n * t],
            active: vec![false; n * t],
            sure: vec![false; n * t],
            turned: vec![false; n * t * m],
            cuts: vec![0; t],
            process_noise: Vec::new(),
        };
        let mut begin = 0;
        for stretch in stretches {
            for (k, frame) in stretch.iter().enumerate() {
                (0..n).for_each(|j| tracks.place(j, begin + k, frame));
            }
            for j in 0..n {
                tracks.activate(j, begin..begin + stretch.len(), longest);
            }
            begin += stretch.len() + 1;
            tracks.cuts[(begin - 1).min(t)..].iter_mut().for_each(|cuts| *cuts += 1);
        }
        tracks.weigh(noise, &[]);
        tracks
    }

    /// Weights the detections by their noise, of which every view has `factors` `(M, T)` times the
    /// usual one (empty: once), and marks positions on which the views agree.
    pub fn weigh(&mut self, noise: &DetectionNoise, factors: &[f64]) {
        let (t, m) = (self.frames, self.views);
        for (k, own) in self.weights.chunks_mut(m).enumerate() {
            let (j, frame, rays) = (k / t, k % t, self.rays[k * m..].iter().enumerate().zip(own));
            for ((i, ray), weights) in rays.filter(|((_, ray), _)| ray.is_there()) {
                let factor = factors.get(i * t + frame).copied().unwrap_or(1.0);
                [weights.precision, weights.narrow] = noise.of(j, i, ray.weight, factor);
            }
        }
        self.judge();
    }

    /// k of view `i` for joint and frame `k` at `x`, under a kernel so many times as wide as the
    /// final one; 0 where the detection is missing or the camera looks away.
    #[inline]
    pub fn trust(&self, k: usize, i: usize, x: &Vector3<f64>, wider: f64) -> f64 {
        let r = k * self.views + i;
        if !self.rays[r].is_there() {
            return 0.0;
        }
        self.weights[r].kernel(&self.rays[r].offset(x), wider.powi(-2))
    }

    /// F of the detections of joint and frame `k` with these k.
    pub fn loss(&self, k: usize, kept: &[f64]) -> f64 {
        let weights = &self.weights[k * self.views..];
        let of = |(w, kept): (&Weights, &f64)| 0.5 * w.precision / w.narrow * (1.0 - kept);
        weights.iter().zip(kept).filter(|(_, kept)| kept.is_finite()).map(of).sum()
    }

    fn place(&mut self, j: usize, t: usize, frame: &Alone) {
        let k = j * self.frames + t;
        self.rays[k * self.views..(k + 1) * self.views].copy_from_slice(frame.rays.of_joint(j));
        (self.alone[k], self.spread[k]) = (frame.points[j], frame.bars.covariances[j]);
        for i in 0..self.views {
            self.turned[k * self.views + i] = frame.used_for[i * self.joints + j] != j;
        }
    }

    fn activate(&mut self, j: usize, frames: std::ops::Range<usize>, longest: usize) {
        let own = j * self.frames;
        let placed = |t: &usize| {
            self.alone[own + t].x.is_finite() && self.rays(j, *t).iter().any(Ray::is_there)
        };
        let there: Vec<usize> = frames.filter(placed).collect();
        there.iter().for_each(|t| self.active[own + t] = true);
        for pair in there.windows(2).filter(|pair| pair[1] - pair[0] <= longest) {
            self.active[own + pair[0]..own + pair[1]].fill(true);
        }
    }

    /// Marks positions on which the views agree.
    fn judge(&mut self) {
        let m = self.views;
        self.weights.iter_mut().for_each(|weights| weights.held = 0.0);
        let mut trusts = vec![0.0; m];
        for k in (0..self.alone.len()).filter(|k| self.alone[*k].x.is_finite()) {
            let (mut n, mut agree, mut close) = (0, 0, 0);
            for (i, trust) in trusts.iter_mut().enumerate() {
                *trust = self.trust(k, i, &self.alone[k], 1.0);
                n += usize::from(self.rays[k * m + i].is_there());
                agree += usize::from(*trust >= REJECTED);
                close += usize::from(*trust >= CLOSE);
            }
            self.sure[k] = agree >= 3 || (n == 2 && agree == 2);
            if close >= 3 && close == n {
                let own = self.weights[k * m..].iter_mut();
                own.zip(&trusts).for_each(|(weights, trust)| weights.held = *trust);
            }
        }
    }

    /// Looks for cuts: frames between which the body jumps, in the median of the joints whose
    /// positions are sure. Wrong positions are those of single joints. `usual` is each joint's
    /// usual process noise, mm²/s³. Frames that are further apart than a gap that is bridged are
    /// all cut from each other.
    pub fn find_cuts(&mut self, fps: f64, usual: &[f64]) {
        let apart = fps * BRIDGE < 1.0;
        let mut cuts = 0;
        for t in 0..self.frames {
            cuts += usize::from(apart || self.jumps(t, fps, usual) > JUMP * JUMP);
            self.cuts[t] += cuts;
        }
    }

    /// How far the median joint moves before frame `t` beyond what is explained, as in
    /// [`Tracks::jump`]; 0 where too few are sure.
    fn jumps(&self, t: usize, fps: f64, usual: &[f64]) -> f64 {
        let both = |j: &usize| t > 0 && [t - 1, t].iter().all(|t| self.active[self.at(*j, *t)]);
        let asked = (0..self.joints).filter(both).count();
        let jumps = (0..self.joints).filter_map(|j| self.jump(j, t, usual[j] / fps.powi(3)));
        let jumps: Vec<f64> = jumps.collect();
        let is_enough = jumps.len() >= LEAST_JOINTS && 2 * jumps.len() >= asked;
        if is_enough { median(jumps) } else { 0.0 }
    }

    /// How far joint `j` moves before frame `t` beyond what its velocity before and after explains:
    /// the square over the variance of errors of the positions and of white acceleration, which
    /// adds `moved` mm² to a second difference. `None` where positions are not sure.
    fn jump(&self, j: usize, t: usize, moved: f64) -> Option<f64> {
        let at = |t: usize| Some(self.at(j, t)).filter(|k| t < self.frames && self.sure[*k]);
        let (b, c) = (at(t.checked_sub(1)?)?, at(t)?);
        let (a, d) = (t.checked_sub(2).and_then(at), at(t + 1));
        let x = |k: usize| self.alone[k];
        // Weights of the positions at a, b, c and d.
        let (weights, motion) = match (a, d) {
            (Some(_), Some(_)) => ([0.5, -1.5, 1.5, -0.5], 0.25),
            (Some(_), None) => ([1.0, -2.0, 1.0, 0.0], 2.0 / 3.0),
            (None, Some(_)) => ([0.0, -1.0, 2.0, -1.0], 2.0 / 3.0),
            (None, None) => return None,
        };
        let of = [a.unwrap_or(b), b, c, d.unwrap_or(c)];
        let terms = || weights.iter().zip(of);
        let off: Vector3<f64> = terms().map(|(w, k)| x(k) * *w).sum();
        let noise: f64 = terms().map(|(w, k)| w * w * self.spread[k].trace()).sum();
        Some(off.norm_squared() / (noise + 3.0 * motion * moved)).filter(|jump| jump.is_finite())
    }

    /// Whether there is a cut between frames `a` < `b`.
    #[inline]
    pub fn is_cut(&self, a: usize, b: usize) -> bool {
        self.cuts[b] > self.cuts[a]
    }

    /// Where joint `j` is in frame `t`.
    pub(super) fn at(&self, j: usize, t: usize) -> usize {
        j * self.frames + t
    }

    /// Whether the positions of both ends of a bone are sure in frame `t`.
    pub(super) fn see_bone(&self, bone: [usize; 2], t: usize) -> bool {
        bone.iter().all(|j| self.sure[self.at(*j, t)])
    }

    /// The rays of joint `j` in frame `t`, one per view.
    #[inline]
    pub fn rays(&self, j: usize, t: usize) -> &[Ray] {
        let k = (j * self.frames + t) * self.views;
        &self.rays[k..k + self.views]
    }

    /// All rays of joint `j` `(T, M)`, and how they are weighted.
    pub fn of_joint(&self, j: usize) -> (&[Ray], &[Weights]) {
        let n = self.frames * self.views;
        (&self.rays[j * n..(j + 1) * n], &self.weights[j * n..(j + 1) * n])
    }

    /// Exchanges all that frame `t` has of joints `a` and `b`.
    pub fn exchange(&mut self, t: usize, a: usize, b: usize) {
        let (a, b, m) = (self.at(a, t), self.at(b, t), self.views);
        for i in 0..m {
            self.rays.swap(a * m + i, b * m + i);
            self.weights.swap(a * m + i, b * m + i);
        }
        self.alone.swap(a, b);
        self.spread.swap(a, b);
        self.active.swap(a, b);
        self.sure.swap(a, b);
    }

    /// Swaps the detections of joints `a` and `b` in view `i` of frame `t`; they are no longer
    /// held.
    pub fn swap(&mut self, i: usize, t: usize, a: usize, b: usize) {
        let at = |j: usize| (j * self.frames + t) * self.views + i;
        let (a, b) = (at(a), at(b));
        self.rays.swap(a, b);
        self.weights.swap(a, b);
        (self.weights[a].held, self.weights[b].held) = (0.0, 0.0);
    }
}
