//! The joints of a frame and their rays, four joints to a vector, and sums over the rays.

use nalgebra::Vector3;

use super::across::FourRays;
use super::consensus::agrees;
use super::depth::may_be_fixed;
use super::equations::inverse_of;
use super::lanes::{Four, FourSymmetric, LANES, ZERO, lane, set_lane, set_lanes};
use super::noise::{Residuals, pixel_of};
use super::problem::{Annealing, Prior};
use super::rays::{Rays, there};
use super::starts::{is_narrow, nearest_to_all};
use crate::matrix3::Symmetric;
use crate::symmetry::LimbPair;

/// A prior of each of four joints.
#[derive(Debug, Clone, Copy)]
struct FourPriors {
    /// Π.
    precision: FourSymmetric,
    /// x⁰.
    mean: [Four; 3],
}

/// Four joints.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    pub(super) at: [Four; 3],
    /// 1 where the joint is estimated, else 0.
    pub(super) live: Four,
    /// σ of the kernel.
    pub(super) sigma: Four,
    /// Σ c k |e|².
    pub(super) squares: Four,
    /// Σ k.
    pub(super) support: Four,
    /// D, and minus its gradient.
    pub(super) block: FourSymmetric,
    pub(super) pull: [Four; 3],
    /// D⁻¹, zero where a joint does not move.
    pub(super) inverse: FourSymmetric,
    pub(super) step: [Four; 3],
    /// Joints that do not move or no longer do.
    pub(super) settled: [bool; LANES],
    /// Joints that a limb pair or a bone couples.
    pub(super) coupled: [bool; LANES],
    /// Joints with their final kernel.
    pub(super) narrow: [bool; LANES],
}

/// The joints of a frame.
#[derive(Debug, Clone)]
pub(super) struct Joints {
    pub(super) n_joints: usize,
    pub(super) n_views: usize,
    /// Where each joint is, four times the group plus the lane, and which joint is there: those of
    /// limb pairs come first, so that groups without any settle early.
    pub(super) slot: Vec<usize>,
    pub(super) joint: Vec<usize>,
    pub(super) centres: Vec<[f64; 3]>,
    /// The views of each group.
    pub(super) rays: Vec<FourRays>,
    pub(super) groups: Vec<Group>,
    priors: Vec<FourPriors>,
    /// Whether a joint has a detection or a prior.
    informed: Vec<bool>,
    /// Mean weight of the detections.
    pub(super) weight: f64,
    /// Mean size of a pixel at the joints, mm.
    pub(super) pixel: f64,
}

impl Group {
    /// No joint.
    const NONE: Self = Self {
        at: [Four::ZERO; 3],
        live: Four::ZERO,
        sigma: Four::ONE,
        squares: Four::ZERO,
        support: Four::ZERO,
        block: ZERO,
        pull: [Four::ZERO; 3],
        inverse: ZERO,
        step: [Four::ZERO; 3],
        settled: [true; LANES],
        coupled: [false; LANES],
        narrow: [false; LANES],
    };

    pub(super) fn is_settled(&self) -> bool {
        self.settled == [true; LANES]
    }

    /// D⁻¹ of each joint by itself, where cofactors lose too many digits.
    #[cold]
    pub(super) fn invert_carefully(&mut self) {
        for l in (0..LANES).filter(|l| !self.settled[*l]) {
            let inverse = inverse_of(&Symmetric(self.block.0.map(|a| lane(&a, l))).matrix());
            set_lanes(&mut self.inverse.0, l, &Symmetric::of(&inverse).0);
        }
    }
}

impl Joints {
    /// The joints of `rays`, nowhere yet.
    pub(super) fn new(rays: &Rays, pairs: &[LimbPair]) -> Self {
        let (n_views, n_joints) = (rays.n_views(), rays.n_joints());
        let mut paired = vec![false; n_joints];
        pairs.iter().flat_map(|(l, r)| l.iter().chain(r)).for_each(|j| paired[*j] = true);
        let joints = 0..n_joints;
        let joint: Vec<usize> =
            (joints.clone().filter(|j| paired[*j])).chain(joints.filter(|j| !paired[*j])).collect();
        let mut slot = vec![0; n_joints];
        joint.iter().enumerate().for_each(|(s, j)| slot[*j] = s);
        let groups = n_joints.div_ceil(LANES);
        let mut joints = Self {
            n_joints,
            n_views,
            slot,
            joint,
            centres: vec![[0.0; 3]; n_views],
            rays: vec![FourRays::MISSING; groups * n_views],
            groups: vec![Group::NONE; groups],
            priors: Vec::new(),
            informed: (0..n_joints).map(|j| there(rays.of_joint(j)).next().is_some()).collect(),
            weight: rays.mean_weight(),
            pixel: 1.0,
        };
        joints.set_all_rays(rays);
        joints
    }

    /// Takes over the rays of all joints.
    pub(super) fn set_all_rays(&mut self, rays: &Rays) {
        (0..self.n_joints).for_each(|j| self.set_rays(rays, j));
        self.weight = rays.mean_weight();
    }

    /// Takes over the rays of joint `j`.
    pub(super) fn set_rays(&mut self, rays: &Rays, j: usize) {
        let (g, l) = self.place_of(j);
        for (i, ray) in rays.of_joint(j).iter().enumerate() {
            self.rays[g * self.n_views + i].set(l, ray);
            if ray.is_there() {
                self.centres[i] = ray.centre.into();
            }
        }
    }

    /// Adds a prior of every joint.
    pub(super) fn set_priors(&mut self, priors: &[Prior]) {
        let none = FourPriors { precision: ZERO, mean: [Four::ZERO; 3] };
        self.priors = vec![none; if priors.is_empty() { 0 } else { self.groups.len() }];
        for (j, prior) in priors.iter().enumerate() {
            let (g, l) = self.place_of(j);
            let (four, precision) = (&mut self.priors[g], Symmetric::of(&prior.precision));
            set_lanes(&mut four.precision.0, l, &precision.0);
            set_lanes(&mut four.mean, l, prior.mean.as_slice());
            self.informed[j] |= precision.trace() > 0.0;
        }
    }

    /// ½ Σ (x−x⁰)ᵀ Π (x−x⁰) of the joints of group `g`; adds Π to their `information`.
    pub(super) fn against_priors(&self, g: usize, information: &mut FourSymmetric) -> f64 {
        let Some(prior) = self.priors.get(g) else { return 0.0 };
        let group = &self.groups[g];
        information.add(&prior.precision);
        let off: [Four; 3] = std::array::from_fn(|a| (group.at[a] - prior.mean[a]) * group.live);
        let held = prior.precision.times(&off);
        (off[0] * held[0] + off[1] * held[1] + off[2] * held[2]).reduce_add() * 0.5
    }

    /// The group and the lane of joint `j`.
    pub(super) fn place_of(&self, j: usize) -> (usize, usize) {
        (self.slot[j] / LANES, self.slot[j] % LANES)
    }

    /// Where joint `j` is; NaN if it has no position.
    pub(super) fn at(&self, j: usize) -> Vector3<f64> {
        let (g, l) = self.place_of(j);
        let Group { at: [x, y, z], live, .. } = &self.groups[g];
        if lane(live, l) == 0.0 {
            return Vector3::repeat(f64::NAN);
        }
        Vector3::new(lane(x, l), lane(y, l), lane(z, l))
    }

    /// Puts joint `j` at `x`, NaN: nowhere.
    pub(super) fn put(&mut self, j: usize, x: &Vector3<f64>) {
        let (g, l) = self.place_of(j);
        let group = &mut self.groups[g];
        let known = x.iter().all(|v| v.is_finite());
        set_lane(&mut group.live, l, if known { 1.0 } else { 0.0 });
        let x = if known { *x } else { Vector3::zeros() };
        set_lanes(&mut group.at, l, x.as_slice());
        if !known {
            set_lane(&mut group.squares, l, 0.0);
            set_lane(&mut group.support, l, 0.0);
        }
    }

    /// The step of the joint in slot `s`.
    pub(super) fn step(&self, s: usize) -> Vector3<f64> {
        self.groups[s / LANES].step.each_ref().map(|v| lane(v, s % LANES)).into()
    }

    /// Whether joint `j` has a position.
    pub(super) fn is_live(&self, j: usize) -> bool {
        let (g, l) = self.place_of(j);
        lane(&self.groups[g].live, l) > 0.0
    }

    /// Whether joint `j` is estimated: it has a position, and a detection or a prior.
    pub(super) fn is_active(&self, j: usize) -> bool {
        self.informed[j] && self.is_live(j)
    }

    pub(super) fn sigma(&self, j: usize) -> f64 {
        let (g, l) = self.place_of(j);
        lane(&self.groups[g].sigma, l)
    }

    pub(super) fn set_sigma(&mut self, j: usize, sigma: f64) {
        let (g, l) = self.place_of(j);
        set_lane(&mut self.groups[g].sigma, l, sigma);
    }

    pub(super) fn residuals(&self, j: usize) -> Residuals {
        let (g, l) = self.place_of(j);
        let group = &self.groups[g];
        Residuals::new(lane(&group.squares, l), lane(&group.support, l))
    }

    /// Sums over all joints: Σ c k |e|², the degrees of freedom, and the kernels' σ.
    pub(super) fn totals(&self) -> [f64; 3] {
        let mut totals = [Four::ZERO; 3];
        for Group { squares, support, sigma, .. } in &self.groups {
            let freedom = (*support * 2.0 - 3.0).fast_max(Four::ZERO);
            totals = [totals[0] + *squares, totals[1] + freedom, totals[2] + *sigma];
        }
        let [squares, freedom, sigma] = totals.map(Four::reduce_add);
        // The places without a joint have σ = 1.
        [squares, freedom, sigma - (LANES * self.groups.len() - self.n_joints) as f64]
    }

    /// Sums over the rays of the joints that are not settled: D = Σ c k (I − d dᵀ)/ŝ² + Π + μ I,
    /// minus its gradient −Σ c k e/ŝ² − Π (x − x⁰), and the residuals.
    #[inline(never)]
    pub(super) fn sum(&mut self, precision: f64, damping: f64) {
        let (m, precision, damping) = (self.n_views, Four::splat(precision), Four::splat(damping));
        for (g, group) in self.groups.iter_mut().enumerate().filter(|(_, g)| !g.is_settled()) {
            let quarter = Four::splat(-0.25) / (group.sigma * group.sigma);
            let (mut weight, mut outer, mut pull) = (Four::ZERO, ZERO, [Four::ZERO; 3]);
            let (mut squares, mut support) = (Four::ZERO, Four::ZERO);
            for (centre, ray) in self.centres.iter().zip(&self.rays[g * m..(g + 1) * m]) {
                let across = ray.across(&group.at, &centre.map(Four::splat));
                let k = ray.weight.simd_gt(Four::ZERO) & across.trust(quarter);
                let w = ray.weight * k;
                outer.add_outer(w, &ray.direction);
                weight += w;
                (0..3).for_each(|a| pull[a] -= w * across.e[a]);
                squares += w * across.square;
                support += k;
            }
            group.block = outer.below(weight, precision, damping);
            group.pull = pull.map(|p| p * precision);
            if let Some(prior) = self.priors.get(g) {
                let off = std::array::from_fn(|a| prior.mean[a] - group.at[a]);
                let held = prior.precision.times(&off);
                group.block.add(&prior.precision);
                (0..3).for_each(|a| group.pull[a] += held[a]);
            }
            for l in (0..LANES).filter(|l| !group.settled[*l]) {
                set_lane(&mut group.squares, l, lane(&squares, l));
                set_lane(&mut group.support, l, lane(&support, l));
            }
        }
    }

    /// Puts every joint at the point nearest to its rays, with the kernel that reaches the farthest
    /// of these, at most the widest.
    pub(super) fn start(&mut self, rays: &Rays, annealing: &Annealing) {
        (0..self.n_joints).for_each(|j| self.begin(rays, annealing, j, &nearest_to_all(rays, j)));
        self.scale_to(rays);
    }

    /// Removes the positions of joints whose rays do not determine their depth.
    pub(super) fn drop_undetermined(&mut self, rays: &Rays) {
        for j in 0..self.n_joints {
            let of_joint = rays.of_joint(j);
            if !is_narrow(of_joint) {
                continue;
            }
            // The remaining rays may be parallel because others contradict them: then all rays are
            // tested.
            let (x, sigma) = (self.at(j), self.sigma(j));
            let two = there(of_joint).filter(|ray| agrees(ray, &x, sigma)).count() > 1;
            if !may_be_fixed(of_joint, &x, if two { sigma } else { f64::INFINITY }) {
                self.put(j, &Vector3::repeat(f64::NAN));
            }
        }
    }

    /// Takes the size of a pixel from where the joints are.
    pub(super) fn scale_to(&mut self, rays: &Rays) {
        let points = (0..self.n_joints).map(|j| self.at(j));
        self.pixel = pixel_of(rays, points).unwrap_or(self.pixel);
    }

    /// Puts joint `j` at `x`, with the kernel that reaches its farthest ray, at most the widest.
    pub(super) fn begin(&mut self, rays: &Rays, annealing: &Annealing, j: usize, x: &Vector3<f64>) {
        self.put(j, x);
        let off = there(rays.of_joint(j)).map(|ray| ray.offset(x).across.norm_squared());
        let farthest = off.fold(0.0, f64::max).sqrt();
        self.set_sigma(j, farthest.min(annealing.start).max(annealing.end[j]));
    }
}
