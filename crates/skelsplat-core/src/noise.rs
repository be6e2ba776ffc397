//! The noise of detections, by joint, view and whatever else divides them: hierarchical scales.
//!
//! Every cell c (a joint in a view, perhaps in a part of a recording) has weighted squares S_c with
//! ν_c degrees of freedom of residuals of variance v_c. Levels divide the cells into groups (all,
//! views, joints, single cells), each with a factor f, and a variance is the product of its cell's
//! factors. A factor is a scaled inverse χ² around the mode m of its level, as certain as ν₀
//! residuals: m is the expected variance for the factor of all cells, 1 below. With θ = ln f,
//!
//! ```text
//! −2 log p = Σ_c (ν_c ln v_c + S_c/v_c) + Σ_g ν₀ (θ_g + m exp(−θ_g))      ln v_c = Σ_{g∋c} θ_g
//! ```
//!
//! is convex: −θ and exp(−Σθ) are. Given the others, a factor is the mean of what its cells show,
//! shrunk to its mode by the number of residuals,
//!
//! ```text
//! f_g = (Σ_{c∈g} S_c f_g/v_c + ν₀ m) / (Σ_{c∈g} ν_c + ν₀)
//! ```
//!
//! and repeating this for one level after another leads to the only maximum.

/// One division of the cells.
#[derive(Debug, Clone, PartialEq)]
pub struct Level {
    /// The group of each cell.
    pub group: Vec<usize>,
    /// ν₀, how many residuals the mode of a factor counts for; infinite keeps it there.
    pub certainty: f64,
}

/// Levels of cells, from the widest, which contains all cells in one group, to the narrowest.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scales {
    levels: Vec<Level>,
    factors: Vec<Vec<f64>>,
    /// Σ S f/v and Σ ν of the groups of a level.
    sums: Vec<[f64; 2]>,
    /// Number of cells.
    cells: usize,
    variances: Vec<f64>,
}

/// Change of a factor, relative, below which the search ends.
const TOLERANCE: f64 = 1e-9;
/// Most rounds of the search; with as many residuals as certainty ten suffice.
const ROUNDS: usize = 200;

impl Scales {
    /// All `cells` in one group of this `certainty`.
    pub fn new(cells: usize, certainty: f64) -> Self {
        let none = Self { cells, variances: vec![1.0; cells], ..Self::default() };
        none.by(|_| 0, certainty)
    }

    /// The same, divided once more: cell c belongs to `group(c)`.
    #[must_use]
    pub fn by(mut self, group: impl Fn(usize) -> usize, certainty: f64) -> Self {
        let group: Vec<usize> = (0..self.cells).map(group).collect();
        let groups = group.iter().max().map_or(0, |last| last + 1);
        self.factors.push(vec![1.0; groups]);
        self.sums.resize(self.sums.len().max(groups), [0.0; 2]);
        self.levels.push(Level { group, certainty });
        self
    }

    /// The variances of all cells, from their `squares` S and degrees of `freedom` ν, where
    /// `expected` is the variance before any residual. Starts from those of the last call.
    pub fn fit(&mut self, squares: &[f64], freedom: &[f64], expected: f64) -> &[f64] {
        for _ in 0..ROUNDS {
            if self.round(squares, freedom, expected, TOLERANCE) {
                break;
            }
        }
        &self.variances
    }

    /// One round over all levels; returns whether no factor changed by more than `tolerance`.
    pub fn round(
        &mut self,
        squares: &[f64],
        freedom: &[f64],
        expected: f64,
        tolerance: f64,
    ) -> bool {
        let mut most = 0.0_f64;
        for (k, level) in self.levels.iter().enumerate().filter(|(_, l)| l.certainty.is_finite()) {
            let factors = &mut self.factors[k];
            self.sums[..factors.len()].fill([0.0; 2]);
            for (c, g) in level.group.iter().enumerate() {
                let sum = &mut self.sums[*g];
                *sum = [sum[0] + squares[c] / self.variances[c], sum[1] + freedom[c]];
            }
            let mode = if k == 0 { expected } else { 1.0 };
            for (factor, sum) in factors.iter_mut().zip(&mut self.sums) {
                let next = (sum[0] * *factor + level.certainty * mode) / (sum[1] + level.certainty);
                // From here on the ratio of the variances before and after.
                sum[0] = next / *factor;
                most = most.max((sum[0] - 1.0).abs());
                *factor = next;
            }
            for (variance, g) in self.variances.iter_mut().zip(&level.group) {
                *variance *= self.sums[*g][0];
            }
        }
        most <= tolerance
    }

    /// The factors of a level, one for each of its groups.
    pub fn factors(&self, level: usize) -> &[f64] {
        &self.factors[level]
    }

    /// The variances of all cells.
    pub fn variances(&self) -> &[f64] {
        &self.variances
    }

    /// Sets the factors of a level, as a start or, where its certainty is infinite, as known.
    pub fn set_factors(&mut self, level: usize, factors: &[f64]) {
        self.factors[level].copy_from_slice(factors);
        for (c, variance) in self.variances.iter_mut().enumerate() {
            *variance = (self.levels.iter().zip(&self.factors))
                .map(|(level, factors)| factors[level.group[c]])
                .product();
        }
    }

    /// −2 log p of these residuals and the present factors, up to a constant.
    pub fn objective(&self, squares: &[f64], freedom: &[f64], expected: f64) -> f64 {
        let of_cells = self.variances.iter().zip(squares.iter().zip(freedom));
        let data: f64 = of_cells.map(|(v, (s, nu))| nu * v.ln() + s / v).sum();
        let of_level = |(k, (level, factors)): (usize, (&Level, &Vec<f64>))| -> f64 {
            let mode = if k == 0 { expected } else { 1.0 };
            let certainty = if level.certainty.is_finite() { level.certainty } else { 0.0 };
            factors.iter().map(|f| certainty * (f.ln() + mode / f)).sum()
        };
        data + self.levels.iter().zip(&self.factors).enumerate().map(of_level).sum::<f64>()
    }
}
