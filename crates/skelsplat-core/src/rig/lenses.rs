//! What may be true of lenses: that those given are wrong, or that unknown ones are of one kind.
//!
//! Each is a normal prior of the logarithms z of focal lengths, z ~ N(0, P). A rig with free lenses
//! finds d with the covariance C; the prior explains it by N(d; 0, P + C), and z would be P (P +
//! C)⁻¹ d with the covariance P − P (P + C)⁻¹ P. Unknown lenses of n₁, n₂, … cameras of one make
//! each are as likely as in a Chinese restaurant process, ∏ (nᵢ − 1)!/m!.

use nalgebra::{DMatrix, DVector};

use super::evidence::CHANGED;
use super::gauge::{Sureness, Zooms};
use super::prior::CALIBRATED;

/// Standard deviation of the logarithm of a focal length that was given, if it is right: another
/// focus.
const OTHER_FOCUS: f64 = 0.01;
/// Standard deviation of the logarithm of a focal length that is unknown: the widths of lenses of
/// phones and action cameras, 50 to 90°, about 65°.
pub const FOCAL_SIGMA: f64 = 0.3;
/// By how much lenses of one make differ: the four of Human3.6M, 0.2 %.
pub const ONE_MAKE: f64 = 0.002;
/// By how much those of makes differ from their common one: of any lenses, and of main cameras of
/// phones (24 to 28 mm for an image 36 mm wide); beforehand equally likely.
pub const KINDS: [f64; 2] = [FOCAL_SIGMA, 0.05];

/// Covariance of unknown focal lengths of cameras of these makes, which differ by so much.
pub fn alike(makes: &[usize], apart: f64) -> DMatrix<f64> {
    let covariance = |i: usize, j: usize| {
        let make = if makes[i] == makes[j] { apart.powi(2) - ONE_MAKE.powi(2) } else { 0.0 };
        let own = if i == j { ONE_MAKE.powi(2) } else { 0.0 };
        FOCAL_SIGMA.powi(2) - apart.powi(2) + make + own
    };
    DMatrix::from_fn(makes.len(), makes.len(), covariance)
}

/// Focal lengths if something is true of them.
struct Supposed {
    /// Logarithm of its probability, up to a constant.
    evidence: f64,
    prior: DMatrix<f64>,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Supposed {
    /// By its odds and its prior; `None` if nothing can be told.
    fn of(zooms: &Zooms, odds: f64, prior: DMatrix<f64>) -> Option<Self> {
        let both = (&prior + &zooms.covariance).cholesky()?;
        let gain = both.solve(&prior).transpose();
        let surprise = zooms.estimate.dot(&both.solve(&zooms.estimate));
        Some(Self {
            evidence: odds.ln() - 0.5 * (both.ln_determinant() + surprise),
            mean: &gain * &zooms.estimate,
            covariance: &prior - &gain * &prior,
            prior,
        })
    }
}

/// What is known of focal lengths, by what may be true of them.
pub struct LensPosterior {
    zooms: Zooms,
    supposed: Vec<Supposed>,
    /// Of which the rig was solved; `None`: with the lenses given, which are right in the first.
    held: Option<usize>,
}

impl LensPosterior {
    /// Of lenses that are unknown, and may be of one kind.
    pub fn of_kinds(zooms: Zooms) -> Option<Self> {
        let m = zooms.estimate.len();
        let each: Vec<usize> = (0..m).collect();
        let of_one_make = (1.0, alike(&vec![0; m], FOCAL_SIGMA));
        let kinds = KINDS.map(|apart| (1.0, alike(&each, apart))).into_iter().chain([of_one_make]);
        let all: Vec<_> = kinds.chain(of_makes(&zooms)).collect();
        let mut found = Self::of(zooms, all)?;
        found.held = Some(found.likeliest());
        Some(found)
    }

    /// Of lenses that are said to be of one make; one may be another.
    pub fn of_one_make(zooms: Zooms) -> Option<Self> {
        let m = zooms.estimate.len();
        let found = Self::of_wrong(zooms, &alike(&vec![0; m], FOCAL_SIGMA), &lone(m))?;
        Some(Self { held: Some(0), ..found })
    }

    /// Of lenses that are given; one may be another, or all.
    pub fn of_given(zooms: Zooms) -> Option<Self> {
        let m = zooms.estimate.len();
        let mut others = lone(m);
        others.push((1.0, DVector::from_element(m, 1.0)));
        let right = DMatrix::from_diagonal_element(m, m, OTHER_FOCUS.powi(2));
        Self::of_wrong(zooms, &right, &others)
    }

    /// Of lenses that are right, or some wrong alike, each of so large a part of all ways.
    fn of_wrong(
        zooms: Zooms,
        right: &DMatrix<f64>,
        others: &[(f64, DVector<f64>)],
    ) -> Option<Self> {
        let wrong = |(part, which): &(f64, DVector<f64>)| {
            (CHANGED * part, right + which * which.transpose() * CALIBRATED.sigma.powi(2))
        };
        let all: Vec<_> =
            std::iter::once((1.0, right.clone())).chain(others.iter().map(wrong)).collect();
        Self::of(zooms, all)
    }

    /// Of what may be true, with its odds and its prior; `None` if nothing can be told.
    fn of(zooms: Zooms, all: impl IntoIterator<Item = (f64, DMatrix<f64>)>) -> Option<Self> {
        let given = |(odds, prior)| Supposed::of(&zooms, odds, prior);
        let supposed = all.into_iter().map(given).collect::<Option<Vec<_>>>()?;
        Some(Self { zooms, supposed, held: None })
    }

    fn likeliest(&self) -> usize {
        let evidence = |k: &usize| self.supposed[*k].evidence;
        let all = 0..self.supposed.len();
        all.max_by(|a, b| evidence(a).total_cmp(&evidence(b))).unwrap_or(0)
    }

    /// The prior of the likeliest, or of those given.
    pub fn prior(&self) -> &DMatrix<f64> {
        &self.supposed[self.held.unwrap_or(0)].prior
    }

    /// Adds to the errors of a rig what is true instead of what was held.
    pub fn widen(&self, known: &mut Sureness) {
        let mut parts = self.besides().symmetric_eigen();
        parts.eigenvalues.apply(|value| *value = value.max(0.0));
        known.widen(&self.zooms.by, &parts.recompose());
    }

    /// What the covariance of focal lengths lacks, Σ p (S + δ δᵀ − S_held): what may be true has
    /// the probability p, and differs by δ from what is held.
    pub fn besides(&self) -> DMatrix<f64> {
        let most = self.supposed[self.likeliest()].evidence;
        let odds: Vec<f64> = self.supposed.iter().map(|s| (s.evidence - most).exp()).collect();
        let all: f64 = odds.iter().sum();
        let m = self.zooms.estimate.len();
        let mut more = DMatrix::zeros(m, m);
        let held = self.held.map(|k| &self.supposed[k]);
        let others = self.supposed.iter().zip(odds).skip(usize::from(held.is_none()));
        for (Supposed { mean, covariance, .. }, odds) in others {
            let off = held.map_or(mean.clone(), |held| mean - &held.mean);
            more += (covariance + &off * off.transpose()) * (odds / all);
            held.into_iter().for_each(|held| more -= &held.covariance * (odds / all));
        }
        more
    }

    /// By which factors focal lengths differ from those held, if others are likelier.
    pub fn zooms(&self) -> Vec<f64> {
        let k = self.likeliest();
        let m = self.zooms.estimate.len();
        if k == 0 || self.held.is_some_and(|held| held == k) {
            return vec![1.0; m];
        }
        let off = &self.supposed[k].mean;
        let off = self.held.map_or(off.clone(), |held| off - &self.supposed[held].mean);
        (0..m).map(|i| if k > m || i == k - 1 { off[i].exp() } else { 1.0 }).collect()
    }
}

/// Cameras of some makes each, with their odds: those that are likeliest to be of one make are
/// joined, one pair of makes after the other.
fn of_makes(zooms: &Zooms) -> Vec<(f64, DMatrix<f64>)> {
    let mut makes: Vec<usize> = (0..zooms.estimate.len()).collect();
    let mut out = Vec::new();
    for _ in 2..makes.len() {
        let joined = |(a, b): (usize, usize)| {
            let makes: Vec<usize> = makes.iter().map(|i| if *i == b { a } else { *i }).collect();
            let evidence = Supposed::of(zooms, odds(&makes), alike(&makes, FOCAL_SIGMA))?.evidence;
            Some((evidence, makes))
        };
        let pairs = (0..makes.len()).flat_map(|a| (a + 1..makes.len()).map(move |b| (a, b)));
        let pairs = pairs.filter(|(a, b)| makes.contains(a) && makes.contains(b));
        let Some(best) = pairs.filter_map(joined).max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        makes = best.1;
        let odds = odds(&makes) / KINDS.len() as f64;
        out.extend(KINDS.map(|apart| (odds, alike(&makes, apart))));
    }
    out
}

/// How likely cameras are of these makes.
fn odds(makes: &[usize]) -> f64 {
    let before = |i: usize| makes[..i].iter().filter(|make| **make == makes[i]).count().max(1);
    (0..makes.len()).map(|i| before(i) as f64 / (i + 1) as f64).product()
}

/// Each camera alone.
fn lone(m: usize) -> Vec<(f64, DVector<f64>)> {
    (0..m)
        .map(|k| (1.0 / m as f64, DVector::from_fn(m, |i, _| f64::from(u8::from(i == k)))))
        .collect()
}
