//! `adjust_cameras` and `calibrate_cameras`.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use skelsplat_core::{
    Adjustable, CalibratedCamera, CameraAdjustment, Filmed, Progress, Unknown,
    adjust_cameras as core_adjust, calibrate_cameras as core_calibrate,
};

use crate::args::{Confidence, Out};
use crate::camera::{Camera, Cameras};
use crate::config::RefineConfig;
use crate::detections::Frames;
use crate::errors::Result;
use crate::layout::Layout;
use crate::watch;

/// Return adjusted cameras and the fields of every ``skelsplat.CameraAdjustment``; radians.
#[pyfunction]
#[pyo3(signature = (
    detections, cameras, *, times=None, confidence=None, free=None, focal=false, clock=false,
    config=None
))]
#[allow(clippy::too_many_arguments, reason = "all but two by keyword")]
pub(crate) fn adjust_cameras<'py>(
    py: Python<'py>,
    detections: Frames,
    cameras: Cameras,
    times: Option<Vec<usize>>,
    confidence: Option<Confidence>,
    free: Option<Vec<usize>>,
    focal: bool,
    clock: bool,
    config: Option<RefineConfig>,
) -> Result<(Vec<Camera>, Bound<'py, PyDict>)> {
    let mut frames = detections.with(confidence)?.recording()?;
    frames.expect_views(cameras.cameras.len())?;
    let (seen, what) = (frames.take()?, Adjustable { free, focal, clock });
    let config = config.map_or_else(Default::default, |config| config.0);
    let times = times.unwrap_or_else(|| (0..seen.len()).collect());
    let done = watch::watched(py, 0, None, move |progress: &Progress| {
        let filmed = Filmed { frames: &seen, times: &times };
        core_adjust(&cameras.cameras, cameras.unit, filmed, &what, &config, progress)
    })?;
    let m = done.report.len();
    let each =
        |get: fn(&CameraAdjustment) -> f64| Out(done.report.iter().map(get).collect(), vec![m]);
    let vectors = |get: fn(&CameraAdjustment) -> nalgebra::Vector3<f64>| {
        Out::points(&done.report.iter().map(get).collect::<Vec<_>>(), vec![m, 3])
    };
    let out = PyDict::new(py);
    let status: Vec<_> = done.report.iter().map(|camera| camera.status.name()).collect();
    out.set_item("status", status)?;
    out.set_item("since", done.report.iter().map(|camera| camera.since).collect::<Vec<_>>())?;
    out.set_item("turn", vectors(|camera| camera.change.turn))?;
    out.set_item("shift", vectors(|camera| camera.change.shift))?;
    out.set_item("zoom", each(|camera| camera.change.zoom))?;
    out.set_item("clock", each(|camera| camera.change.clock))?;
    out.set_item("turn_sigma", each(|camera| camera.bars.turn))?;
    out.set_item("shift_sigma", each(|camera| camera.bars.shift))?;
    out.set_item("zoom_sigma", each(|camera| camera.bars.zoom))?;
    out.set_item("clock_sigma", each(|camera| camera.bars.clock))?;
    out.set_item("before", each(|camera| camera.before))?;
    out.set_item("after", each(|camera| camera.after))?;
    out.set_item("frames", done.frames)?;
    Ok((done.cameras.into_iter().map(Camera).collect(), out))
}

type Number = (&'static str, fn(&CalibratedCamera) -> f64);

/// Return placed cameras in any scale, the fields of every ``skelsplat.CalibratedCamera``, radians,
/// and in this scale the person's stature and how far joints are off because of the cameras.
#[pyfunction]
#[pyo3(signature = (
    detections, cameras, clocks, layout, times, *, focal=false, same_focal=false, clock=false,
    config=None
))]
#[allow(clippy::too_many_arguments, reason = "all but five by keyword")]
pub(crate) fn calibrate_cameras<'py>(
    py: Python<'py>,
    detections: Frames,
    cameras: Cameras,
    clocks: Vec<Option<f64>>,
    layout: Layout,
    times: Vec<usize>,
    focal: bool,
    same_focal: bool,
    clock: bool,
    config: Option<RefineConfig>,
) -> Result<(Vec<Camera>, Bound<'py, PyDict>)> {
    let mut frames = detections.with(None)?.recording()?;
    frames.expect_views(cameras.cameras.len())?;
    let seen = frames.take()?;
    let unknown = Unknown { focal, same_focal, clock };
    let config = config.map_or_else(Default::default, |config| config.0);
    let done = watch::watched(py, 0, None, move |progress: &Progress| {
        let filmed = Filmed { frames: &seen, times: &times };
        core_calibrate(&cameras.cameras, &clocks, filmed, &layout.0, unknown, &config, progress)
    })?;
    let cameras = done.cameras;
    let m = cameras.len();
    let out = PyDict::new(py);
    out.set_item("used", cameras.iter().map(|camera| camera.used).collect::<Vec<_>>())?;
    let places: Vec<f64> =
        cameras.iter().flat_map(|camera| camera.bars.place.data.0).flatten().collect();
    out.set_item("shift_covariance", Out(places, vec![m, 3, 3]))?;
    let numbers: [Number; 7] = [
        ("clock", |camera| camera.placed.clock),
        ("turn_sigma", |camera| camera.bars.turn),
        ("zoom_sigma", |camera| camera.bars.zoom),
        ("clock_sigma", |camera| camera.bars.clock),
        ("distance", |camera| camera.distance),
        ("explained", |camera| camera.explained),
        ("zoom", |camera| camera.zoom),
    ];
    for (name, get) in numbers {
        out.set_item(name, Out(cameras.iter().map(get).collect(), vec![m]))?;
    }
    out.set_item("stature", done.stature)?;
    out.set_item("joint_sigma", done.joint_sigma)?;
    out.set_item("moved", done.moved)?;
    Ok((cameras.into_iter().map(|camera| Camera(camera.placed.camera)).collect(), out))
}
