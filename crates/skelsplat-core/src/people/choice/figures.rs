//! The figures of a frame, four joints at a time.

use std::ops::Range;

use nalgebra::Vector2;
use wide::f64x4;

use super::rules::Rules;
use crate::camera::{Camera, Undistorted};
use crate::detections::Detections;
use crate::triangulate::FourJoints;

/// Joints in a register.
pub(super) const LANES: usize = 4;
/// Numbers of a joint: ideal pixel from the principal point, confidence, pixel, pixel of the mirror
/// image.
const FIELDS: usize = 7;

/// What a view detects in one slot.
#[derive(Debug, Clone)]
pub(super) struct FigureBox {
    pub(super) view: usize,
    pub(super) slot: usize,
    /// Extent as a part of the image's diagonal.
    pub(super) share: f64,
    /// Corners of the box around the pixels.
    pub(super) low: Vector2<f64>,
    pub(super) high: Vector2<f64>,
}

/// The figures of a frame, by view and slot.
#[derive(Debug, Default)]
pub(super) struct Figures {
    pub(super) all: Vec<FigureBox>,
    /// Where those of a view are.
    pub(super) views: Vec<Range<usize>>,
    /// Registers per figure and number.
    pub(super) groups: usize,
    /// Whether some are left out.
    pub(super) cut: bool,
    /// Whether any joint has a mirror image.
    pub(super) has_sides: bool,
    numbers: Vec<f64x4>,
}

impl Figures {
    /// Collects the figures with enough joints, of each view at most `most`, the largest.
    pub(super) fn fill(
        &mut self,
        slots: &[Detections],
        cameras: &[Camera],
        rules: &Rules,
        most: usize,
    ) {
        self.all.clear();
        self.views.clear();
        self.numbers.clear();
        self.cut = false;
        self.has_sides = rules.mirror.iter().enumerate().any(|(j, &image)| image != j);
        self.groups = slots.first().map_or(0, |given| given.n_joints().div_ceil(LANES));
        for (view, camera) in cameras.iter().enumerate() {
            let first = self.all.len();
            let found = |(slot, given)| rules.figure(given, view, slot, camera);
            self.all.extend(slots.iter().enumerate().filter_map(found));
            if self.all.len() - first > most {
                self.all[first..].sort_by(|a, b| b.share.total_cmp(&a.share));
                self.all.truncate(first + most);
                self.all[first..].sort_by_key(|figure| figure.slot);
                self.cut = true;
            }
            self.views.push(first..self.all.len());
            for k in first..self.all.len() {
                self.add(&slots[self.all[k].slot], view, camera, rules);
            }
        }
    }

    fn add(&mut self, given: &Detections, view: usize, camera: &Camera, rules: &Rules) {
        let start = self.numbers.len();
        self.numbers.resize(start + FIELDS * self.groups, f64x4::splat(f64::NAN));
        let centre = Vector2::from(camera.principal_point());
        for g in 0..self.groups {
            let mut group = [[f64::NAN; LANES]; FIELDS];
            group[2] = [0.0; LANES];
            for (lane, j) in (g * LANES..given.n_joints().min((g + 1) * LANES)).enumerate() {
                if let Some((pixel, confidence)) = rules.used(given, view, j) {
                    group[2][lane] = confidence;
                    [group[3][lane], group[4][lane]] = pixel.into();
                    if let Undistorted::Converged(ideal) = camera.undistort(pixel) {
                        [group[0][lane], group[1][lane]] = (ideal - centre).into();
                    }
                }
                if let Some((pixel, _)) = rules.used(given, view, rules.mirror[j]) {
                    [group[5][lane], group[6][lane]] = pixel.into();
                }
            }
            for (field, numbers) in group.into_iter().enumerate() {
                self.numbers[start + field * self.groups + g] = f64x4::new(numbers);
            }
        }
    }

    fn numbers(&self, figure: usize, field: usize) -> &[f64x4] {
        let start = (figure * FIELDS + field) * self.groups;
        &self.numbers[start..start + self.groups]
    }

    /// Pixels of a figure, or of its mirror image.
    pub(super) fn pixels(&self, figure: usize, mirrored: bool) -> [&[f64x4]; 2] {
        let field = if mirrored { 5 } else { 3 };
        [self.numbers(figure, field), self.numbers(figure, field + 1)]
    }

    /// Ideal pixels and confidences of a figure.
    #[inline]
    pub(super) fn seen(&self, figure: usize) -> impl Iterator<Item = FourJoints> {
        let start = figure * FIELDS * self.groups;
        let (x, rest) = self.numbers[start..start + 3 * self.groups].split_at(self.groups);
        let (y, confidence) = rest.split_at(self.groups);
        (0..self.groups).map(move |g| FourJoints { x: x[g], y: y[g], confidence: confidence[g] })
    }
}

impl Rules {
    /// A joint's detection, if it is used.
    fn used(&self, given: &Detections, view: usize, joint: usize) -> Option<(Vector2<f64>, f64)> {
        given.get(view, joint).filter(|(_, confidence)| *confidence >= self.min_confidence)
    }

    /// A figure with enough joints.
    fn figure(
        &self,
        given: &Detections,
        view: usize,
        slot: usize,
        camera: &Camera,
    ) -> Option<FigureBox> {
        let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(-f64::INFINITY));
        let mut known = 0;
        for (pixel, _) in (0..given.n_joints()).filter_map(|j| self.used(given, view, j)) {
            (low, high) = (low.inf(&pixel), high.sup(&pixel));
            known += 1;
        }
        let [width, height] = camera.size().map(f64::from);
        let share = (high - low).norm() / width.hypot(height);
        (known >= self.min_joints.max(1)).then_some(FigureBox { view, slot, share, low, high })
    }
}
