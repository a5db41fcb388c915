"""The formulas of docs/materials.md in float64: value times cosine for wi and wo (n, 3)."""

from functools import partial

import numpy as np
from scipy.integrate import trapezoid

from rptcam_cl.rendering.plan.materials import fresnel, internal_reflectance, rough_albedo, smooth_mean


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
    shares = np.array([rough_albedo(cosine, alpha, partial(fresnel, index=index)) for cosine in cosines])
    mean = trapezoid(2 * cosines * shares, cosines)
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


def hair(wi, wo, color, *, across, index=1.55, roughness=0.3, around=0.3, tilt_degrees=2.0):
    """Return the value of hair along x at a place of its width (Chiang et al. 2016), the fibre's frame about wi."""
    x = np.array([1.0, 0, 0])
    y = np.cross(x, -wi)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    z = np.cross(x, y)
    depth = np.polynomial.Polynomial([5.969, -0.215, 2.532, -10.73, 5.574, 0.245])(around)
    absorption = (np.log(color) / depth) ** 2
    variance = (0.726 * roughness + 0.812 * roughness**2 + 3.7 * roughness**20) ** 2 * np.array([1, 0.25, 4, 4])
    scale = np.sqrt(np.pi / 8) * (0.265 * around + 1.194 * around**2 + 5.372 * around**22)
    # in turn for each pair of directions: theta, phi
    theta_o, theta_i = np.arcsin(wi[:, 0]), np.arcsin(np.clip(wo[:, 0], -1, 1))
    phi_o, phi_i = (np.arctan2((w * z).sum(1), (w * y).sum(1)) for w in (wi, wo))
    gamma_o = np.arcsin(across)
    modified = np.sqrt(index**2 - np.sin(theta_o) ** 2) / np.cos(theta_o)
    gamma_t = np.arcsin(across / modified)
    theta_t = np.arcsin(np.sin(theta_o) / index)
    passed = np.exp(-absorption * (2 * np.cos(gamma_t) / np.cos(theta_t))[:, None])
    f = dielectric(np.cos(theta_o) * np.cos(gamma_o), index)[:, None]
    shares = [f + 0 * passed, (1 - f) ** 2 * passed, (1 - f) ** 2 * passed**2 * f]
    shares.append(shares[2] * f * passed / (1 - f * passed))
    value = 0.0
    for p, (share, v) in enumerate(zip(shares, variance, strict=True)):
        tilt = np.radians(tilt_degrees) * (-2, 1, 4, 0)[p]
        theta = theta_o + tilt
        a, b = np.cos(theta_i) * np.abs(np.cos(theta)) / v, np.sin(theta_i) * np.sin(theta) / v
        along = np.exp(-b) * np.i0(a) / (2 * v * np.sinh(1 / v))
        if p < 3:
            turn = phi_i - phi_o - (2 * p * gamma_t - 2 * gamma_o + p * np.pi)
            turn = (turn + np.pi) % (2 * np.pi) - np.pi
            e = np.exp(-np.abs(turn) / scale)
            around_it = e / (scale * (1 + e) ** 2) / np.tanh(np.pi / (2 * scale))
        else:
            around_it = np.full(len(wi), 1 / (2 * np.pi))
        value = value + share * (along * around_it)[:, None]
    return value
