//! What may be true of lenses: that those given are wrong, or that unknown ones are of one kind.
//!
//! Each is a normal prior of the logarithms z of focal lengths, z ~ N(0, P). A rig with free lenses
//! finds d with the covariance C; the prior explains it by N(d; 0, P + C), and z would be P (P +
//! C)⁻¹ d with the covariance P − P (P + C)⁻¹ P.

use nalgebra::{DMatrix, DVector};

use super::gauge::{Sureness, Zooms};

/// The probability that the lens of one camera, or of all, is not the one that was given,
const WRONG_LENS: f64 = 0.05;
/// the standard deviation of the logarithm of its focal length then: another zoom,
const OTHER_ZOOM: f64 = 0.1;
/// and if it is: another focus.
const OTHER_FOCUS: f64 = 0.01;
/// Standard deviation of the logarithm of a focal length that is unknown: the widths of lenses of
/// phones and action cameras, 50 to 90°, about 65°.
pub const FOCAL_SIGMA: f64 = 0.3;
/// By how much lenses of one make differ: the four of Human3.6M, 0.2 %.
pub const ONE_MAKE: f64 = 0.002;
/// By how much focal lengths differ from their common one: of any lenses, of main cameras of phones
/// (24 to 28 mm for an image 36 mm wide), of lenses of one make; beforehand equally likely.
pub const KINDS: [f64; 3] = [FOCAL_SIGMA, 0.05, ONE_MAKE];

/// Focal lengths of one kind: the covariance of m that differ by so much from those of all.
fn alike(m: usize, apart: f64) -> DMatrix<f64> {
    let common = FOCAL_SIGMA.powi(2) - apart.powi(2);
    DMatrix::from_fn(m, m, |i, j| common + if i == j { apart.powi(2) } else { 0.0 })
}

/// Focal lengths if something is true of them.
struct Supposed {
    /// Logarithm of its probability, up to a constant.
    evidence: f64,
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
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
        let all = KINDS.map(|apart| (1.0, alike(m, apart)));
        let mut found = Self::of(zooms, all)?;
        found.held = Some(found.likeliest());
        Some(found)
    }

    /// Of lenses that are said to be of one make; one may be another.
    pub fn of_one_make(zooms: Zooms) -> Option<Self> {
        let m = zooms.estimate.len();
        let found = Self::of_wrong(zooms, &alike(m, ONE_MAKE), &lone(m))?;
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
            (WRONG_LENS * part, right + which * which.transpose() * OTHER_ZOOM.powi(2))
        };
        let all: Vec<_> =
            std::iter::once((1.0, right.clone())).chain(others.iter().map(wrong)).collect();
        Self::of(zooms, all)
    }

    /// Of what may be true, with its odds and its prior; `None` if nothing can be told.
    fn of(zooms: Zooms, all: impl IntoIterator<Item = (f64, DMatrix<f64>)>) -> Option<Self> {
        let given = |(odds, prior): (f64, DMatrix<f64>)| {
            let both = (&prior + &zooms.covariance).cholesky()?;
            let gain = both.solve(&prior).transpose();
            let surprise = zooms.estimate.dot(&both.solve(&zooms.estimate));
            Some(Supposed {
                evidence: odds.ln() - 0.5 * (both.ln_determinant() + surprise),
                mean: &gain * &zooms.estimate,
                covariance: &prior - &gain * &prior,
            })
        };
        let supposed = all.into_iter().map(given).collect::<Option<Vec<_>>>()?;
        Some(Self { zooms, supposed, held: None })
    }

    fn likeliest(&self) -> usize {
        let evidence = |k: &usize| self.supposed[*k].evidence;
        let all = 0..self.supposed.len();
        all.max_by(|a, b| evidence(a).total_cmp(&evidence(b))).unwrap_or(0)
    }

    /// By how much lenses of unknown kind differ from those of all.
    pub fn apart(&self) -> f64 {
        KINDS[self.held.unwrap_or(0)]
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

/// Each camera alone.
fn lone(m: usize) -> Vec<(f64, DVector<f64>)> {
    (0..m)
        .map(|k| (1.0 / m as f64, DVector::from_fn(m, |i, _| f64::from(u8::from(i == k)))))
        .collect()
}
