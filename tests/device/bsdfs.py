"""The formulas of docs/materials.md in float64: value times cosine for wi and wo (n, 3)."""

import numpy as np

from rptcam_cl.rendering.plan.materials import internal_reflectance, rough_albedo, smooth_mean


def dielectric(cosine, eta):
    """Return Fresnel's reflectance; 1 beyond the critical angle."""
    inside = np.sqrt(np.maximum(1 - (1 - cosine**2) / eta**2, 0))
    s, p = (cosine - eta * inside) / (cosine + eta * inside), (eta * cosine - inside) / (eta * cosine + inside)
    return np.where((1 - cosine**2) / eta**2 >= 1, 1.0, (s**2 + p**2) / 2)


def lambda_of(w, alpha):
    """Return Smith's Lambda."""
    tan2 = (w[:, 0] ** 2 * alpha[0] ** 2 + w[:, 1] ** 2 * alpha[1] ** 2) / w[:, 2] ** 2
    return (np.sqrt(1 + tan2) - 1) / 2


def density(h, alpha):
    """Return GGX's D."""
    k = (h[:, 0] / alpha[0]) ** 2 + (h[:, 1] / alpha[1]) ** 2 + h[:, 2] ** 2
    return 1 / (np.pi * alpha[0] * alpha[1] * k**2)


def facet_reflection(wi, wo, alpha):
    """Return D G / (4 cos cos) times the cosine of wo, and the cosine at the facet."""
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    masking = 1 / (1 + lambda_of(wi, alpha) + lambda_of(wo, alpha))
    value = density(h, alpha) * masking / (4 * wi[:, 2])
    up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    return np.where(up, value, 0), np.sum(wi * h, axis=1)


def conductor(wi, wo, alpha, fresnel):
    """Return a conductor's value; ``fresnel`` maps a cosine to channels."""
    value, cosine = facet_reflection(wi, wo, alpha)
    return value[:, None] * fresnel(cosine[:, None])


def rough_dielectric(wi, wo, alpha, eta):
    """Return a rough dielectric's value for ``eta``, the index beyond over that before."""
    reflected, cosine = facet_reflection(wi, wo, alpha)
    reflected = reflected * dielectric(cosine, eta)
    h = -(wi + eta * wo)
    h *= np.sign(h[:, 2:]) / np.linalg.norm(h, axis=1, keepdims=True)
    ci, co = np.sum(wi * h, axis=1), np.sum(wo * h, axis=1)
    masking = 1 / ((1 + lambda_of(wi, alpha)) * (1 + lambda_of(wo, alpha)))
    # Walter 2007, eq. 21, the light coming from wo
    value = np.abs(ci * co) / np.abs(wi[:, 2]) * masking * density(h, alpha) / (eta * co + ci) ** 2
    passed = np.where((ci > 0) & (co < 0) & (wo[:, 2] < 0), value * (1 - dielectric(np.abs(ci), eta)), 0)
    return np.where(wo[:, 2] > 0, reflected, passed)[:, None] * np.ones(3)


def plastic_base(wi, wo, color, index, share, mean):
    """Return the light from under a cover that reflects ``share(cosine)`` and ``mean`` of even light."""
    inside = internal_reflectance(mean, index)
    rho = np.asarray(color) / (1 - np.asarray(color) * inside) / index**2
    up = np.maximum(wo[:, 2], 0)
    both = (1 - share(wi[:, 2])) * (1 - share(up)) * up / np.pi
    return both[:, None] * rho


def smooth_plastic(wi, wo, color, index):
    """Return the diffuse light of a plastic with a smooth cover."""
    return plastic_base(wi, wo, color, index, lambda cosine: dielectric(cosine, index), smooth_mean(index))


def rough_plastic(wi, wo, color, index, alpha):
    """Return the light of a rough plastic, with the quadrature of its cover."""
    cosines = np.linspace(0.02, 1, 50)
    shares = np.array([rough_albedo(cosine, alpha, index) for cosine in cosines])
    mean = np.trapezoid(2 * cosines * shares, cosines)
    base = plastic_base(wi, wo, color, index, lambda cosine: np.interp(cosine, cosines, shares), mean)
    value, cosine = facet_reflection(wi, wo, alpha)
    return base + (value * dielectric(cosine, index))[:, None]


def sheen_lambda(cosine, alpha):
    """Return Smith's Lambda as Estevez and Kulla 2017 fit it (eq. 3, table 1)."""
    rough = 1 - (1 - alpha) ** 2
    soft, hard = (25.3245, 3.32435, 0.16801, -1.27393, -4.85967), (21.5473, 3.82987, 0.19823, -1.97760, -4.32054)
    a, b, c, d, e = ((1 - rough) * p + rough * q for p, q in zip(soft, hard, strict=True))

    def exponent(x):
        return a / (1 + b * x**c) + d * x + e

    return np.exp(np.where(cosine < 0.5, exponent(cosine), 2 * exponent(0.5) - exponent(1 - cosine)))


def sheen_density(sine, alpha):
    """Return Estevez and Kulla's D of the sine of the normal's angle."""
    return (2 + 1 / alpha) * sine ** (1 / alpha) / (2 * np.pi)


def sheen(wi, wo, alpha):
    """Return the value of a white sheen."""
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    d = sheen_density(np.hypot(h[:, 0], h[:, 1]), alpha)
    masking = 1 / (1 + sheen_lambda(wi[:, 2], alpha) + sheen_lambda(wo[:, 2], alpha))
    return (d * masking / (4 * wi[:, 2]))[:, None]
