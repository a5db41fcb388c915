"""Lights without a surface as emitters: record and power of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.luminaire import Luminaire, read_luminaire
from rptcam_cl.colour import LUMINANCE, luminance
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.kinds import EmitterKind, TexelFormat
from rptcam_cl.core.records import EMITTER
from rptcam_cl.plan.environment import DistantSun
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.plan.pictures import Colours
from rptcam_cl.plan.primitives import turn_to, world_from_scene
from rptcam_cl.plan.sky import SUN_RADIUS_DEGREES
from rptcam_cl.plan.textures import TextureTable
from rptcam_cl.scene import Colour, DirectionalLight, Light, PointLight, ProfileLight, Scene, SpotLight, SunLight

PROFILE_CELLS = (360, 720)  # directions of a luminaire, along and about its axis: half a degree


def light_emitter(
    light: Light, scene: Scene, textures: TextureTable, spectra: KnownSpectra, reach: float
) -> tuple[np.void, float]:
    """Return record and power [W, luminance] of a light; ``reach`` is the radius of the scene [m]."""
    record: np.void = EMITTER.zeros(1)[0]
    record["primitive"], record["triangle"], record["texture"] = -1, -1, -1
    match light:
        case PointLight():
            record["kind"], record["radiance"][:3] = EmitterKind.POINT, light.intensity
            power = 4 * np.pi * luminance(light.intensity)
        case SpotLight():
            power = _spot(record, light)
        case ProfileLight():
            power = _profile(record, light, scene, textures)
        case DirectionalLight():
            record["kind"], record["radiance"][:3] = EmitterKind.DIRECTIONAL, light.irradiance
            power = np.pi * reach**2 * luminance(light.irradiance)
        case SunLight():
            power = fill_sun(record, light.irradiance, light.diameter_degrees / 2) * np.pi * reach**2
    record["radiance"][3] = _number(light, record, spectra)
    if isinstance(light, DirectionalLight | SunLight):
        record["normal"][:3] = -_unit(light.direction)
    else:
        record["a"][:3] = (world_from_scene(scene) @ (*light.position, 1.0))[:3]
    return record, power


def _number(light: Light, record: np.void, spectra: KnownSpectra) -> int:
    """Return the number of a light's spectrum, scaled as the record has its colour."""
    match light:
        case PointLight() | SpotLight():
            colour: Colour = light.intensity
        case DirectionalLight() | SunLight():
            colour = light.irradiance
        case ProfileLight():
            colour = light.color
    largest = int(np.argmax(colour))
    gain = float(record["radiance"][largest]) / colour[largest] if colour[largest] > 0 else 0.0
    return spectra.number(colour, light=True, gain=gain)


def fill_sun(record: np.void, irradiance: tuple[float, float, float], radius_degrees: float) -> float:
    """Fill in a disk at infinity that gives an irradiance where it is faced; return that as luminance [W/m²]."""
    sin2 = np.sin(np.deg2rad(radius_degrees)) ** 2
    record["kind"] = EmitterKind.SUN
    record["a"][3] = sin2
    record["radiance"][:3] = np.asarray(irradiance) / (np.pi * sin2)
    return float(luminance(irradiance))


def sun_emitter(sun: DistantSun, reach: float) -> tuple[np.void, float]:
    """Return record and power [W, luminance] of the sun of a sky; ``reach`` is the radius of the scene [m]."""
    record: np.void = EMITTER.zeros(1)[0]
    record["primitive"], record["triangle"], record["texture"] = -1, -1, -1
    record["normal"][:3] = sun.towards
    red, green, blue = sun.irradiance.tolist()
    return record, fill_sun(record, (red, green, blue), SUN_RADIUS_DEGREES) * np.pi * reach**2


def _unit(direction: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(direction, dtype=np.float64) / np.linalg.norm(direction)


def _spot(record: np.void, light: SpotLight) -> float:
    """Fill in a cone; return its power: a step that is smooth in the cosine is half full on average."""
    outer, inner = (2 * np.sin(np.deg2rad(angle) / 2) ** 2 for angle in (light.outer_degrees, light.inner))
    record["kind"], record["radiance"][:3] = EmitterKind.SPOT, light.intensity
    record["normal"][:3] = _unit(light.direction)
    record["u"][3], record["v"][3] = outer, 1 / (outer - inner)
    return float(np.pi * (outer + inner) * luminance(light.intensity))


def _profile(record: np.void, light: ProfileLight, scene: Scene, textures: TextureTable) -> float:
    """Fill in a measured luminaire; return its power."""
    try:
        luminaire = read_luminaire(scene.content_of(light))
    except InputError as problem:
        raise InputError(f"{light.place}{problem}") from None
    intensity, mean = _directions(luminaire)
    texels = np.repeat(intensity.astype(np.float32)[::-1, :, None], 3, axis=2)
    record["texture"] = textures.add_sphere(Colours.of(texels, TexelFormat.HALF, f"luminaire {scene.digest_of(light)}"))
    record["kind"] = EmitterKind.PROFILE
    colour = np.array(light.color) * (light.gain / max(float(luminance(light.color)), 1e-30))
    record["radiance"][:3] = colour
    turn = turn_to(-_unit(light.direction))
    angle = np.deg2rad(light.rotation_degrees)
    record["u"][:3] = np.cos(angle) * turn[:, 0] + np.sin(angle) * turn[:, 1]
    record["v"][:3] = np.cos(angle) * turn[:, 1] - np.sin(angle) * turn[:, 0]
    record["normal"][:3] = _unit(light.direction)
    return float(4 * np.pi * mean * LUMINANCE @ colour)


def _directions(luminaire: Luminaire) -> tuple[NDArray[np.float64], float]:
    """Return the intensity [W/sr] at the middles of cells of vertical and horizontal angle, and its mean."""
    rows, columns = PROFILE_CELLS
    vertical = (np.arange(rows) + 0.5) * 180 / rows
    horizontal = (np.arange(columns) + 0.5) * 360 / columns
    intensity = luminaire.intensity(vertical, horizontal)
    weights = np.sin(np.deg2rad(vertical))
    return intensity, float(weights @ intensity.mean(axis=1) / weights.sum())
