"""Full-image rendering, with gradients: splats, encodings, pseudo ground truth, masked L2 (DESIGN §2)."""

import numpy as np

from reference.arrays import Array, Projected

CUT = 1 / 255
"""A splat is zero where exp(−½q) is below this."""
ALPHA_MAX = 0.99
"""A splat never exceeds this."""
ENCODINGS = ("one_hot", "rgb", "single")


def offsets(centre: Array, size: tuple[int, int]) -> Array:
    """P − centre (H,W,2) in px, for every pixel p = (u, v) of an image of `size` (width, height)."""
    v, u = np.mgrid[: size[1], : size[0]]
    return np.stack([u - centre[0], v - centre[1]], axis=-1)


def bell(centre: Array, covariance2d: Array, size: tuple[int, int]) -> Array:
    """exp(−½ (p−c)ᵀ Σ⁻¹ (p−c)) (H,W), uncut."""
    d = offsets(centre, size)
    q = np.sum((d @ np.linalg.inv(covariance2d)) * d, axis=-1)
    return np.asarray(np.exp(-0.5 * q))


def heat_map(centre: Array, covariance2d: Array, size: tuple[int, int]) -> Array:
    """Return a joint's heat map (H,W): peak 1, zero below the cut."""
    values = bell(centre, covariance2d, size)
    return np.where(values >= CUT, values, 0.0)


def splat(centre: Array, covariance2d: Array, size: tuple[int, int]) -> Array:
    """a_j(p) (H,W) = min(0.99, exp(−½q)), zero below the cut (opacity 1)."""
    return np.minimum(ALPHA_MAX, heat_map(centre, covariance2d, size))


def splat_gradient(d_splat: Array, centre: Array, covariance2d: Array) -> tuple[Array, Array]:
    """Carry ∂L/∂a (H,W) back to the centre (2,) and Σ² (2,2).

    With A = (Σ²)⁻¹ and d = p − m: ∂a/∂m = a A d and ∂a/∂Σ² = ½ a A d dᵀ A; both vanish where a is cut
    or clamped.
    """
    height, width = d_splat.shape
    values = bell(centre, covariance2d, (width, height))
    weight = np.where((values >= CUT) & (values < ALPHA_MAX), d_splat * values, 0.0)
    Ad = offsets(centre, (width, height)) @ np.linalg.inv(covariance2d)
    weighted = (weight[..., None] * Ad).reshape(-1, 2)
    return weighted.sum(axis=0), 0.5 * weighted.T @ Ad.reshape(-1, 2)


def splats(projected: Projected, size: tuple[int, int]) -> Array:
    """a_j of every joint (N,H,W); zero for joints that are not seen."""
    images = np.zeros((len(projected.seen), size[1], size[0]))
    for j in np.flatnonzero(projected.seen):
        images[j] = splat(projected.means2d[j], projected.covariances2d[j], size)
    return images


def front_to_back(projected: Projected) -> list[int]:
    """Order the seen joints by depth, nearest first."""
    return [int(j) for j in np.argsort(projected.depths, kind="stable") if projected.seen[j]]


def composite(images: Array, order: list[int]) -> Array:
    """C (H,W) = Σ_j a_j ∏_{l nearer} (1 − a_l), every joint white."""
    total = np.zeros(images.shape[1:])
    transmittance = np.ones(images.shape[1:])
    for j in order:
        total += images[j] * transmittance
        transmittance = transmittance * (1 - images[j])
    return total


def composite_gradient(d_total: Array, images: Array, order: list[int]) -> Array:
    """Carry ∂L/∂C (H,W) back to the splats (N,H,W).

    ∂C/∂a_j = T_j − (Σ_{k farther} a_k T_k) / (1 − a_j), T_j the light that reaches joint j.
    """
    d_images = np.zeros_like(images)
    transmittance = np.ones(images.shape[1:])
    behind = composite(images, order)
    for j in order:
        behind = behind - images[j] * transmittance
        d_images[j] = d_total * (transmittance - behind / (1 - images[j]))
        transmittance = transmittance * (1 - images[j])
    return d_images


def encode(images: Array, order: list[int], encoding: str) -> Array:
    """Make the channels (C,H,W): N for "one_hot", three equal ones for "rgb", one for "single"."""
    if encoding == "one_hot":
        return images
    return np.stack([composite(images, order)] * (3 if encoding == "rgb" else 1))


def encode_gradient(d_channels: Array, images: Array, order: list[int], encoding: str) -> Array:
    """Carry ∂L/∂channels (C,H,W) back to the splats (N,H,W)."""
    if encoding == "one_hot":
        return d_channels
    return composite_gradient(d_channels.sum(axis=0), images, order)


def render(projected: Projected, size: tuple[int, int], encoding: str = "one_hot") -> Array:
    """Render a projected skeleton: (C,H,W)."""
    return encode(splats(projected, size), front_to_back(projected), encoding)


def pseudo_ground_truth(
    detections: Array, projected: Projected, size: tuple[int, int], encoding: str = "one_hot"
) -> Array:
    """Make the target (C,H,W): heat maps at the sub-pixel detections (N,2), shaped as the initial Gaussians.

    The composited encodings use the sum of the joints' heat maps, scaled to peak 1 over the image's pixels.
    """
    images = np.zeros((len(detections), size[1], size[0]))
    for j in np.flatnonzero(projected.seen):
        images[j] = heat_map(detections[j], projected.covariances2d[j], size)
    if encoding == "one_hot":
        return images
    total = images.sum(axis=0)
    peak = total.max()
    return np.stack([total / peak if peak > 0 else total] * (3 if encoding == "rgb" else 1))


def masked_l2(rendered: Array, target: Array) -> tuple[float, Array] | None:
    """Mean squared difference over the pixels where either image is non-zero, and its gradient (C,H,W).

    All channels share one mean, and the mask is a constant for the gradient (DESIGN §2 "Masked L2").
    None if the mask is empty.
    """
    mask = (rendered > 0) | (target > 0)
    count = int(mask.sum())
    if count == 0:
        return None
    difference = np.where(mask, rendered - target, 0.0)
    return float(np.sum(difference**2)) / count, 2 * difference / count
