//! Which views find the same people, and which find others.

use nalgebra::Vector3;

use super::births::Free;
use super::body::Claims;
use super::crowd::Crowd;
use super::known::BodyModel;

/// Of the people of all frames who are in the images of two views.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Agreement {
    /// `(M, M)`: how many both see.
    pub together: Vec<usize>,
    /// `(M, M)`: how many the first sees and the second does not, although the second detects
    /// another person, whom the first does not see.
    pub apart: Vec<usize>,
}

impl Agreement {
    /// Of the people of a frame, and the figures that are nobody's.
    pub(super) fn of_frame(
        crowd: &Crowd,
        people: &[(&[Vector3<f64>], &Claims)],
        free: &Free,
        known: &BodyModel,
    ) -> Self {
        let m = crowd.views.len();
        let mut found = Self { together: vec![0; m * m], apart: vec![0; m * m] };
        let seen = |claims: &Claims, i: usize| claims[i][0].is_some();
        // Seen by the first view, in the image of the second but not seen there.
        let mut alone = vec![0; m * m];
        for (pose, claims) in people {
            for i in (0..m).filter(|i| seen(claims, *i)) {
                for k in (0..m).filter(|k| *k != i) {
                    let both = seen(claims, k);
                    found.together[i * m + k] += usize::from(both);
                    alone[i * m + k] += usize::from(!both && known.sees(k, pose));
                }
            }
        }
        for (i, k) in (0..m * m).map(|at| (at / m, at % m)) {
            let others = alone[k * m + i] + free[k].iter().filter(|free| **free).count();
            found.apart[i * m + k] = alone[i * m + k].min(others);
        }
        found
    }

    /// Adds that of another frame.
    pub(super) fn add(&mut self, other: &Self) {
        for (own, more) in [(&mut self.together, &other.together), (&mut self.apart, &other.apart)]
        {
            own.resize(more.len(), 0);
            own.iter_mut().zip(more).for_each(|(sum, n)| *sum += n);
        }
    }
}
