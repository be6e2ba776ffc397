//! Whole images, made only when a caller asks for one.

use super::composite::{Canvas, Composite};
use super::encoding::Encoding;
use super::pseudo_gt::HeatMap;
use super::splat::{ALPHA_MAX, Splat};

/// A stack of images `(C, H, W)`, row-major.
#[derive(Debug, Clone, PartialEq)]
pub struct Images {
    /// Number of channels.
    pub channels: usize,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Values, channel by channel and row by row.
    pub values: Vec<f32>,
}

impl Images {
    fn new(channels: usize, size: [u32; 2]) -> Self {
        let pixels = size[0] as usize * size[1] as usize;
        Self { channels, size, values: vec![0.0; channels * pixels] }
    }

    fn line(&mut self, channel: usize, v: i32) -> &mut [f32] {
        let [w, h] = self.size.map(|s| s as usize);
        let v = usize::try_from(v).unwrap_or(0);
        let start = (channel * h + v) * w;
        &mut self.values[start..start + w]
    }

    fn paste(&mut self, channel: usize, canvas: &Canvas) {
        let start = usize::try_from(canvas.columns.start).unwrap_or(0);
        let rows = canvas.rows.start..canvas.rows.end;
        for (v, line) in rows.zip(canvas.values().chunks_exact(canvas.columns.len().max(1))) {
            let target = &mut self.line(channel, v)[start..start + line.len()];
            #[allow(clippy::cast_possible_truncation, reason = "images are f32")]
            target.iter_mut().zip(line).for_each(|(t, c)| *t = *c as f32);
        }
    }

    fn paste_splat(&mut self, channel: usize, splat: &Splat, limit: f32) {
        let heat = HeatMap::<f32>::new(splat);
        for v in splat.rows.start..splat.rows.end {
            let span = heat.span(v);
            let start = usize::try_from(span.start).unwrap_or(0);
            let (_, values) = heat.line(v, span);
            let target = &mut self.line(channel, v)[start..start + values.len()];
            target.iter_mut().zip(values).for_each(|(t, a)| *t = a.min(limit));
        }
    }
}

/// Renders `splats` (one per joint with its depth, `None` where the view does not see it).
#[must_use]
pub fn render(splats: &[Option<(Splat, f64)>], encoding: Encoding, size: [u32; 2]) -> Images {
    let mut images = Images::new(encoding.channels(splats.len()), size);
    if encoding == Encoding::OneHot {
        #[allow(clippy::cast_possible_truncation, reason = "images are f32")]
        let limit = ALPHA_MAX as f32;
        for (j, splat) in splats.iter().enumerate() {
            if let Some((splat, _)) = splat {
                images.paste_splat(j, splat, limit);
            }
        }
        return images;
    }
    let canvas = Composite::render(&nearest_first(splats));
    (0..images.channels).for_each(|channel| images.paste(channel, &canvas));
    images
}

/// Draws the pseudo ground truth of `heats` (one per joint, `None` where there is no detection).
#[must_use]
pub fn pseudo_ground_truth(heats: &[Option<Splat>], encoding: Encoding, size: [u32; 2]) -> Images {
    let mut images = Images::new(encoding.channels(heats.len()), size);
    if encoding == Encoding::OneHot {
        for (j, heat) in heats.iter().enumerate() {
            if let Some(heat) = heat {
                images.paste_splat(j, heat, 1.0);
            }
        }
        return images;
    }
    let shown: Vec<Splat> = heats.iter().flatten().copied().collect();
    let composite = Composite::new(&shown);
    (0..images.channels).for_each(|channel| images.paste(channel, composite.pseudo()));
    images
}

/// The splats that are there, by depth; of two at one depth the lower joint counts as nearer.
fn nearest_first(splats: &[Option<(Splat, f64)>]) -> Vec<Splat> {
    let mut order: Vec<(Splat, f64)> = splats.iter().flatten().copied().collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    order.into_iter().map(|(splat, _)| splat).collect()
}
