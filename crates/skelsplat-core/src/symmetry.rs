//! Limb-symmetry loss, value and gradient (paper §3 "Optimization", L_sym).
//!
//! L_sym = Σ (‖l₁−l₂‖ − ‖r₁−r₂‖)² over pairs of symmetric limbs, mm².

use nalgebra::Vector3;

/// A left limb and the corresponding right one, each as two joint indices.
pub type LimbPair = ([usize; 2], [usize; 2]);

/// L_sym of `means` over `pairs`; passes each joint's part of the gradient to `add`.
///
/// With d = ‖l₁−l₂‖ − ‖r₁−r₂‖ and the unit vector e along each limb, ∂d²/∂l₁ = 2 d e_l = −∂d²/∂l₂
/// and ∂d²/∂r₁ = −2 d e_r = −∂d²/∂r₂. A limb of length zero has no direction and gets no gradient.
pub fn symmetry(
    means: impl Fn(usize) -> Vector3<f64>,
    pairs: &[LimbPair],
    mut add: impl FnMut(usize, Vector3<f64>),
) -> f64 {
    let mut loss = 0.0;
    for ([l1, l2], [r1, r2]) in pairs {
        let (left, right) = (means(*l1) - means(*l2), means(*r1) - means(*r2));
        let (ll, lr) = (left.norm(), right.norm());
        let difference = ll - lr;
        loss += difference * difference;
        if ll > 0.0 {
            let g = left * (2.0 * difference / ll);
            add(*l1, g);
            add(*l2, -g);
        }
        if lr > 0.0 {
            let g = right * (-2.0 * difference / lr);
            add(*r1, g);
            add(*r2, -g);
        }
    }
    loss
}
