//! Early stopping on window minima (paper §3 "Optimization").

/// Stops when the minimum loss of one window of steps differs by less than `tolerance` from that of
/// the previous window.
#[derive(Debug, Clone)]
pub struct WindowMinimum {
    window: usize,
    tolerance: f64,
    count: usize,
    current: f64,
    previous: Option<f64>,
}

impl WindowMinimum {
    /// Windows of `window` ≥ 1 steps.
    pub fn new(window: usize, tolerance: f64) -> Self {
        Self { window: window.max(1), tolerance, count: 0, current: f64::INFINITY, previous: None }
    }

    /// Records the loss of one step; returns whether the optimisation has converged.
    pub fn settled(&mut self, loss: f64) -> bool {
        self.current = self.current.min(loss);
        self.count += 1;
        if self.count < self.window {
            return false;
        }
        let settled = self.previous.is_some_and(|p| (p - self.current).abs() < self.tolerance);
        self.previous = Some(self.current);
        (self.count, self.current) = (0, f64::INFINITY);
        settled
    }
}
