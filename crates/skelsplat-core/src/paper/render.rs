//! Whole images, rendered only on request.

use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix3, Vector2, Vector3};

use super::composite::{self, Canvas, Composite};
use super::encoding::Encoding;
use super::splat::{ALPHA_MAX, Splat};
use crate::error::{Result, unless_cancelled};
use crate::memory;
use crate::projection::View;

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
    /// Black images, if there is enough memory for them and `buffers` more bytes.
    fn new(channels: usize, size: [u32; 2], buffers: u128) -> Result<Self> {
        let [w, h] = size.map(|s| s as usize);
        let count = channels as u128 * w as u128 * h as u128;
        let bytes = count * size_of::<f32>() as u128 + buffers;
        memory::check(bytes, || format!("images: {channels} x {h} x {w} float32 values"))?;
        // Fits in usize: the check has reserved this size.
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        Ok(Self { channels, size, values: vec![0.0; count] })
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

    fn paste_splat(&mut self, channel: usize, splat: &Splat, limit: f64, cancel: &AtomicBool) {
        composite::each_row(splat, limit, &mut Vec::new(), cancel, |v, span, values| {
            let start = usize::try_from(span.start).unwrap_or(0);
            self.line(channel, v)[start..start + values.len()].copy_from_slice(values);
        });
    }
}

/// A splat with its depth, `None` if the Gaussian is not in front of the camera.
pub type DepthSplat = Option<(Splat, f64)>;

/// Splats in `view` of Gaussians `(mean, covariance)`, the projected variances enlarged by
/// `dilation`.
pub fn splats(
    view: &View,
    shapes: &[(Vector3<f64>, Matrix3<f64>)],
    dilation: f64,
) -> Vec<DepthSplat> {
    let splat = |(mean, covariance): &(Vector3<f64>, Matrix3<f64>)| {
        let p = view.project(mean, covariance, dilation)?;
        Some((Splat::new(p.mean, &p.covariance, view.size)?, p.in_camera.z))
    };
    shapes.iter().map(splat).collect()
}

/// The shapes of `splats` at `detections`, `None` where one is missing.
pub fn heats(
    splats: &[DepthSplat],
    detections: &[Option<Vector2<f64>>],
    size: [u32; 2],
) -> Vec<Option<Splat>> {
    let heat = |(seen, detection): (&DepthSplat, &Option<Vector2<f64>>)| {
        Splat::new((*detection)?, &seen.as_ref()?.0.conic.try_inverse()?, size)
    };
    splats.iter().zip(detections).map(heat).collect()
}

/// Renders `splats` (one per joint with its depth, `None` if it is not in front of the camera).
/// Errors: [`crate::Error::OutOfMemory`] before rendering, [`crate::Error::Cancelled`] once
/// `cancel` is set.
pub fn render(
    splats: &[DepthSplat],
    encoding: Encoding,
    size: [u32; 2],
    cancel: &AtomicBool,
) -> Result<Images> {
    if encoding == Encoding::OneHot {
        let splats = splats.iter().map(|s| s.map(|(splat, _)| splat));
        return apart(splats, ALPHA_MAX, size, cancel);
    }
    shared(&nearest_first(splats), encoding, size, cancel, Composite::render)
}

/// Renders the pseudo ground truth of `heats` (one per joint, `None` where missing).
pub fn pseudo_ground_truth(
    heats: &[Option<Splat>],
    encoding: Encoding,
    size: [u32; 2],
    cancel: &AtomicBool,
) -> Result<Images> {
    if encoding == Encoding::OneHot {
        return apart(heats.iter().copied(), 1.0, size, cancel);
    }
    let shown: Vec<Splat> = heats.iter().flatten().copied().collect();
    let draw = |heats: &[Splat], cancel: &AtomicBool| Composite::new(heats, cancel).pseudo;
    shared(&shown, encoding, size, cancel, draw)
}

/// Every splat, cut at `limit`, on its own channel.
fn apart(
    splats: impl ExactSizeIterator<Item = Option<Splat>>,
    limit: f64,
    size: [u32; 2],
    cancel: &AtomicBool,
) -> Result<Images> {
    let mut images = Images::new(splats.len(), size, 0)?;
    for (j, splat) in splats.enumerate() {
        if let Some(splat) = splat {
            images.paste_splat(j, &splat, limit, cancel);
        }
    }
    unless_cancelled(cancel).map(|()| images)
}

/// The shared canvas of the splats, on every channel.
fn shared(
    splats: &[Splat],
    encoding: Encoding,
    size: [u32; 2],
    cancel: &AtomicBool,
    draw: impl FnOnce(&[Splat], &AtomicBool) -> Canvas,
) -> Result<Images> {
    let channels = encoding.channels(splats.len());
    let mut images = Images::new(channels, size, composite::bytes(splats.iter()))?;
    let canvas = draw(splats, cancel);
    (0..channels).for_each(|channel| images.paste(channel, &canvas));
    unless_cancelled(cancel).map(|()| images)
}

/// The splats without missing ones, by depth; at equal depth the lower joint counts as nearer.
fn nearest_first(splats: &[DepthSplat]) -> Vec<Splat> {
    let mut order: Vec<(Splat, f64)> = splats.iter().flatten().copied().collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    order.into_iter().map(|(splat, _)| splat).collect()
}
