//! The assignment of joints to channels (paper §3 "Joint encoding and rendering", Tab. "encoding").

use crate::names::named;
use crate::settings::{Kind, Parameter, Value};

/// Joint encoding c_j.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Encoding {
    /// `c_j[k] = [k = j]`: one channel per joint; joints do not occlude each other. The paper's
    /// method.
    #[default]
    OneHot,
    /// Ablation: three shared channels, composited front to back. Every joint is white, so the
    /// three channels are equal.
    Rgb,
    /// Ablation: one shared channel, composited front to back.
    Single,
}

named!(setting "encoding" Encoding { OneHot: "one_hot", Rgb: "rgb", Single: "single" });

impl Encoding {
    /// Number of channels for `n_joints` joints.
    pub fn channels(self, n_joints: usize) -> usize {
        match self {
            Self::OneHot => n_joints,
            Self::Rgb => 3,
            Self::Single => 1,
        }
    }
}
