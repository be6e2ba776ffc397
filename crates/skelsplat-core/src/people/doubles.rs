//! Two bodies that are one person, found twice by different views.
//!
//! At a median distance of d kernels between their joints, the odds that two bodies are one are
//!
//! ```text
//! ln O = ln(4/3 π r³ / (2π)^{3/2}) − d²/2 + n ln 1/h
//! ```
//!
//! The second place of one person scatters by a kernel around the first; another person is anywhere
//! within r kernels. Of two people who are as near, a view misses the hidden one with a probability
//! of h = ½, as in simulated crowds: n views have a figure of one of the two. A view with figures
//! of both says nothing, as detectors often see one person twice. Frames of a fraction of a second
//! tell the same.

use std::f64::consts::{LN_2, PI};

use super::associate::Associator;
use super::body::{Body, Claims, apart};
use super::known::BodyModel;
use super::tracks::Track;
use crate::sequence::times::INDEPENDENT;
use crate::statistics::STRONG;

/// Distance from which nobody is taken for one with another, in kernels: half a metre.
const REACH: f64 = 5.5;

/// Log-odds that two bodies with these figures, so many kernels apart, are one.
fn one_person(far: f64, a: &Claims, b: &Claims) -> f64 {
    let room = (4.0 / 3.0 * PI * REACH.powi(3) / (2.0 * PI).powf(1.5)).ln();
    let alone = a.iter().zip(b).filter(|(p, q)| p[0].is_some() != q[0].is_some()).count();
    room - 0.5 * far * far + LN_2 * alone as f64
}

/// Whether a body that is new is one that is known, with these figures.
pub(super) fn is_known(
    known: &BodyModel,
    body: &Body,
    claims: &Claims,
    pose: &[nalgebra::Vector3<f64>],
    own: &Claims,
) -> bool {
    one_person(apart(&body.pose, pose) / known.sigma, claims, own) > STRONG.ln()
}

impl Associator {
    /// Of two bodies that are one for long enough the older one lives.
    pub(super) fn merge_doubles(&mut self, claims: &mut Vec<Claims>) {
        let mut pairs = Vec::new();
        for (a, first) in self.bodies.iter().enumerate() {
            for (b, second) in self.bodies.iter().enumerate().skip(a + 1) {
                let far = apart(&first.pose, &second.pose) / self.known.sigma;
                if far < REACH {
                    let ids = [first.id.min(second.id), first.id.max(second.id)];
                    let before = self.doubles.iter().find(|(pair, _)| *pair == ids);
                    let now =
                        one_person(far, &claims[a], &claims[b]) * (self.dt / INDEPENDENT).min(1.0);
                    let odds = before.map_or(0.0, |(_, odds)| *odds) + now;
                    pairs.push((ids, odds.max(-STRONG.ln())));
                }
            }
        }
        let gone: Vec<usize> =
            pairs.iter().filter(|(_, odds)| *odds > STRONG.ln()).map(|(ids, _)| ids[1]).collect();
        self.doubles = pairs;
        let mut claims_of = std::mem::take(claims).into_iter();
        self.bodies.retain(|body| {
            let (kept, own) = (!gone.contains(&body.id), claims_of.next());
            claims.extend(own.filter(|_| kept));
            kept
        });
    }
}

/// Of two tracks that are one person, the one with fewer figures goes.
pub(super) fn drop_doubles(tracks: &mut Vec<Track>, known: &BodyModel, fps: f64) {
    let is_double = |a: &Track, b: &Track| {
        let odds = |t: usize| {
            let far = apart(a.pose(t)?, b.pose(t)?) / known.sigma;
            Some(one_person(far, a.claim(t)?, b.claim(t)?).max(-STRONG.ln()))
        };
        let common: Vec<f64> =
            (a.first.max(b.first)..a.end().min(b.end())).filter_map(odds).collect();
        let looks = (common.len() as f64 / (fps * INDEPENDENT)).max(1.0);
        looks * common.iter().sum::<f64>() / common.len() as f64 > STRONG.ln()
    };
    let mut kept = vec![true; tracks.len()];
    for a in 0..tracks.len() {
        for b in a + 1..tracks.len() {
            if kept[a] && kept[b] && is_double(&tracks[a], &tracks[b]) {
                kept[if tracks[a].figures() < tracks[b].figures() { a } else { b }] = false;
            }
        }
    }
    let mut keep = kept.into_iter();
    tracks.retain(|_| keep.next().unwrap_or(true));
}
