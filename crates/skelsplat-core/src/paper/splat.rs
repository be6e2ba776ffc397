//! A Gaussian on the image plane and the pixel rows it covers.

use nalgebra::{Matrix2, Vector2};

/// A rendered splat never exceeds 0.99, as in 3D Gaussian splatting.
pub const ALPHA_MAX: f64 = 0.99;

/// The Mahalanobis distance squared at which exp(−½ q) = 1/255: 2 ln 255. A splat is zero beyond
/// it, as in 3D Gaussian splatting.
pub const CUT: f64 = 11.082_527_090_316_852;

/// A run of pixels `[start, end)` in one row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Span {
    /// First column.
    pub start: i32,
    /// One past the last column; not after `start` if the run is empty.
    pub end: i32,
}

impl Span {
    /// Number of pixels.
    pub fn len(self) -> usize {
        usize::try_from(self.end - self.start).unwrap_or(0)
    }

    /// Whether it is empty.
    pub fn is_empty(self) -> bool {
        self.end <= self.start
    }

    /// Whether it has this pixel.
    pub fn contains(self, at: i32) -> bool {
        self.start <= at && at < self.end
    }

    /// The intersection.
    #[must_use]
    pub fn intersection(self, other: Self) -> Self {
        Self { start: self.start.max(other.start), end: self.end.min(other.end) }
    }

    /// The smallest run that contains both; empty runs are ignored.
    #[must_use]
    pub fn hull(self, other: Self) -> Self {
        match (self.is_empty(), other.is_empty()) {
            (true, _) => other,
            (_, true) => self,
            _ => Self { start: self.start.min(other.start), end: self.end.max(other.end) },
        }
    }
}

/// One row of a splat: q = a (x − x₀)² + e with x = u − m_u, over the pixels of `span`.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Columns with q ≤ 2 ln 255, inside the image.
    pub span: Span,
    /// v − m_v.
    pub y: f64,
    /// x₀ = −(b/a) y, the row's own centre relative to m_u.
    pub centre: f64,
    /// e = (c − b²/a) y², the least q of the row.
    pub floor: f64,
}

/// exp(−½ q) with q = (p−m)ᵀ A (p−m), A = Σ⁻¹ = [[a, b], [b, c]], cut at 1/255 and at the image's
/// border.
#[derive(Debug, Clone, Copy)]
pub struct Splat {
    /// Centre m, pixels.
    pub mean: Vector2<f64>,
    /// The conic A, pixels⁻².
    pub conic: Matrix2<f64>,
    /// Rows with at least one pixel of the uncut ellipse's bounding box, `[start, end)`.
    pub rows: Span,
    /// Columns of the same bounding box.
    pub columns: Span,
    /// −b/a: how far the centre of a row moves from one row to the next.
    slope: f64,
    /// c − b²/a: the curvature of a row's floor.
    floor: f64,
    /// 1/a.
    inverse: f64,
}

/// The integers in [centre − half, centre + half] ∩ [0, limit).
#[inline]
fn pixels_within(centre: f64, half: f64, limit: f64) -> Span {
    // Clamped to [0, limit] first, where a cast truncates downwards and image sizes fit an i32.
    #[allow(clippy::cast_possible_truncation, reason = "bounded by the image size")]
    let floor = |x: f64| x.clamp(0.0, limit) as i32;
    let low = (centre - half).clamp(0.0, limit);
    let start = floor(low);
    let start = start + i32::from(f64::from(start) < low);
    let high = centre + half;
    let end = if high < 0.0 { 0 } else { floor(high + 1.0) };
    Span { start, end: end.max(start) }
}

impl Splat {
    /// The splat of `mean` and `covariance` (pixels², positive definite) in an image of `size` =
    /// (width, height); `None` if the covariance has no inverse.
    pub fn new(mean: Vector2<f64>, covariance: &Matrix2<f64>, size: [u32; 2]) -> Option<Self> {
        let conic = covariance.try_inverse()?;
        let (a, b, c) = (conic[(0, 0)], conic[(0, 1)], conic[(1, 1)]);
        let [width, height] = size.map(f64::from);
        let reach = |variance: f64| (CUT * variance).sqrt();
        Some(Self {
            mean,
            conic,
            columns: pixels_within(mean.x, reach(covariance[(0, 0)]), width),
            rows: pixels_within(mean.y, reach(covariance[(1, 1)]), height),
            slope: -b / a,
            floor: c - b * b / a,
            inverse: 1.0 / a,
        })
    }

    /// Row `v` of the splat; its span is empty where the ellipse misses every pixel centre of the
    /// row.
    pub fn row(&self, v: i32) -> Row {
        let y = f64::from(v) - self.mean.y;
        let centre = self.slope * y;
        let floor = self.floor * y * y;
        let half_squared = (CUT - floor) * self.inverse;
        let span = if half_squared < 0.0 {
            Span::default()
        } else {
            let limit = f64::from(self.columns.end);
            pixels_within(self.mean.x + centre, half_squared.sqrt(), limit)
        };
        Row { span, y, centre, floor }
    }

    /// The non-empty rows, with their row number.
    pub fn covered_rows(&self) -> impl Iterator<Item = (i32, Row)> + '_ {
        (self.rows.start..self.rows.end)
            .map(|v| (v, self.row(v)))
            .filter(|(_, row)| !row.span.is_empty())
    }

    /// Whether any pixel belongs to both splats.
    pub fn overlaps(&self, other: &Self) -> bool {
        let rows = self.rows.intersection(other.rows);
        (rows.start..rows.end).any(|v| !self.row(v).span.intersection(other.row(v).span).is_empty())
    }
}
