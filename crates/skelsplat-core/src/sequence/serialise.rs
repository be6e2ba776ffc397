//! A state as a list of numbers, and back: one function per type both writes and reads it.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

use crate::detections::Detections;
use crate::outcome::JointStatus;

/// Numbers that are written, or read again in the same order.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Serialiser {
    numbers: Vec<f64>,
    /// The next number to read; `None` while writing.
    next: Option<usize>,
    /// Whether there was less to read than needed, or something else.
    pub(super) broken: bool,
}

/// A list of any kind.
pub(super) trait List<T> {
    fn resized(&mut self, n: usize, value: T);
    fn items<'a>(&'a mut self) -> impl Iterator<Item = &'a mut T>
    where
        T: 'a;
    fn length(&self) -> usize;
}

macro_rules! list {
    ($type:ident) => {
        impl<T: Clone> List<T> for $type<T> {
            fn resized(&mut self, n: usize, value: T) {
                self.resize(n, value);
            }
            fn items<'a>(&'a mut self) -> impl Iterator<Item = &'a mut T>
            where
                T: 'a,
            {
                self.iter_mut()
            }
            fn length(&self) -> usize {
                self.len()
            }
        }
    };
}
list!(Vec);
list!(VecDeque);

impl Serialiser {
    pub(super) fn empty() -> Self {
        Self { numbers: Vec::new(), next: None, broken: false }
    }

    pub(super) fn of(numbers: Vec<f64>) -> Self {
        Self { numbers, next: Some(0), broken: false }
    }

    pub(super) fn numbers(self) -> Vec<f64> {
        self.numbers
    }

    /// Whether everything has been read, and nothing else.
    pub(super) fn is_read(&self) -> bool {
        !self.broken && self.next == Some(self.numbers.len())
    }

    pub(super) fn number(&mut self, value: &mut f64) {
        match &mut self.next {
            None => self.numbers.push(*value),
            Some(next) => {
                match self.numbers.get(*next) {
                    Some(number) => *value = *number,
                    None => self.broken = true,
                }
                *next += 1;
            }
        }
    }

    pub(super) fn count(&mut self, value: &mut usize) {
        let mut number = *value as f64;
        self.number(&mut number);
        let is_count = number >= 0.0 && number.fract() == 0.0 && number <= f64::from(u32::MAX);
        self.broken |= !is_count;
        *value = if self.broken { 0 } else { number as usize };
    }

    pub(super) fn vector(&mut self, value: &mut Vector3<f64>) {
        value.iter_mut().for_each(|v| self.number(v));
    }

    pub(super) fn matrix(&mut self, value: &mut Matrix3<f64>) {
        value.iter_mut().for_each(|v| self.number(v));
    }

    pub(super) fn status(&mut self, status: &mut JointStatus) {
        let all = JointStatus::ALL;
        let mut code = all.iter().position(|(_, known)| known == status).unwrap_or(0);
        self.count(&mut code);
        self.broken |= code >= all.len();
        *status = all[code.min(all.len() - 1)].1;
    }

    /// A frame's detections; the missing ones as NaN.
    pub(super) fn detections(&mut self, detections: &mut Detections) {
        let (mut m, mut n) = (detections.n_views(), detections.n_joints());
        let all = (0..m * n).map(|k| detections.get(k / n, k % n));
        let (mut pixels, mut scores) = (Vec::new(), Vec::new());
        for (p, c) in all.map(|found| found.map_or(([f64::NAN; 2], 0.0), |(p, c)| ([p.x, p.y], c)))
        {
            pixels.extend(p);
            scores.push(c);
        }
        self.count(&mut m);
        self.count(&mut n);
        self.list(&mut pixels, 0.0, |v, serialiser| serialiser.number(v));
        self.list(&mut scores, 0.0, |v, serialiser| serialiser.number(v));
        match Detections::new(m, n, &pixels, Some(&scores)) {
            Ok(read) => *detections = read,
            Err(_) => self.broken = true,
        }
    }

    /// A list of any length; `value` is what new items start from.
    pub(super) fn list<T>(
        &mut self,
        list: &mut impl List<T>,
        value: T,
        mut visit: impl FnMut(&mut T, &mut Self),
    ) {
        let mut n = list.length();
        self.count(&mut n);
        if self.next.is_some_and(|next| n > self.numbers.len().saturating_sub(next)) {
            self.broken = true;
            return;
        }
        list.resized(n, value);
        list.items().for_each(|item| visit(item, self));
    }

    /// Something or nothing.
    pub(super) fn option<T: Default>(
        &mut self,
        option: &mut Option<T>,
        visit: impl FnOnce(&mut T, &mut Self),
    ) {
        let mut there = usize::from(option.is_some());
        self.count(&mut there);
        if there == 0 {
            *option = None;
        } else {
            visit(option.get_or_insert_default(), self);
        }
    }
}
