//! Rays, four at a time, and where points lie relative to them.

use nalgebra::Vector3;

use super::lanes::{Four, LANES, exp, set_lane, set_lanes};
use super::rays::{Ray, there};

/// Four rays: of four joints in one view, or of one joint in four views.
#[derive(Debug, Clone, Copy)]
pub(super) struct FourRays {
    /// d.
    pub(super) direction: [Four; 3],
    /// c, 0 where missing.
    pub(super) weight: Four,
}

/// The rays of one joint in four views.
#[derive(Debug, Clone, Copy)]
pub(super) struct FourViews {
    pub(super) rays: FourRays,
    /// The views; too large where there are fewer than four.
    pub(super) views: [usize; LANES],
    centre: [Four; 3],
}

/// Positions relative to rays.
pub(super) struct Across {
    /// e.
    pub(super) e: [Four; 3],
    /// Distance along the ray, negative behind the camera.
    pub(super) range: Four,
    /// |e|².
    pub(super) square: Four,
}

impl Across {
    /// k = exp(−|e|²/4σ²), 0 behind the camera; `quarter` is −1/4σ².
    #[inline(always)]
    pub(super) fn trust(&self, quarter: Four) -> Four {
        self.range.simd_gt(Four::ZERO) & exp(self.square * quarter)
    }
}

impl FourRays {
    /// No rays.
    pub(super) const MISSING: Self = Self { direction: [Four::ZERO; 3], weight: Four::ZERO };

    /// Sets one of the four.
    pub(super) fn set(&mut self, l: usize, ray: &Ray) {
        set_lane(&mut self.weight, l, ray.weight);
        set_lanes(&mut self.direction, l, ray.direction.as_slice());
    }

    /// The points `at` relative to rays that begin at `centre`.
    #[inline(always)]
    pub(super) fn across(&self, at: &[Four; 3], centre: &[Four; 3]) -> Across {
        let d = &self.direction;
        let from: [Four; 3] = std::array::from_fn(|a| at[a] - centre[a]);
        let range = d[0] * from[0] + d[1] * from[1] + d[2] * from[2];
        let e: [Four; 3] = std::array::from_fn(|a| from[a] - d[a] * range);
        let square = e[0] * e[0] + e[1] * e[1] + e[2] * e[2];
        Across { e, range, square }
    }
}

impl FourViews {
    /// No views.
    const NONE: Self =
        Self { rays: FourRays::MISSING, views: [usize::MAX; LANES], centre: [Four::ZERO; 3] };

    /// Those that detect the joint, in their order.
    pub(super) fn of(rays: &[Ray]) -> Vec<Self> {
        let mut all = vec![Self::NONE; there(rays).count().div_ceil(LANES)];
        let seen = rays.iter().enumerate().filter(|(_, ray)| ray.is_there());
        for (k, (i, ray)) in seen.enumerate() {
            let (four, l) = (&mut all[k / LANES], k % LANES);
            four.rays.set(l, ray);
            four.views[l] = i;
            set_lanes(&mut four.centre, l, ray.centre.as_slice());
        }
        all
    }

    /// The point `x` relative to the rays.
    #[inline(always)]
    pub(super) fn across(&self, x: &Vector3<f64>) -> Across {
        let at = std::array::from_fn(|a| Four::splat(x[a]));
        self.rays.across(&at, &self.centre)
    }
}
