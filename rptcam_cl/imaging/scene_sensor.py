"""The sensor that a scene describes, behind the film that a render made."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from rptcam_cl.colour import electrons_per_joule
from rptcam_cl.imaging.mosaic import check_size
from rptcam_cl.imaging.sensor import SensorModel, electrons_of_white, system_gain, white_electrons_at_iso
from rptcam_cl.scene import Scene

WELL_E_PER_UM2 = 2000.0  # a usual density; of the presets, from 720 (kac-12040) to 3400 (imx477)


def sensor_of(scene: Scene, metadata: Mapping[str, Any]) -> SensorModel | None:
    """Return the scene's sensor, ready for the film of a render; None when the scene has none.

    With ``exposure: relative`` the film's 1 of white just saturates the sensor. Otherwise the film is an irradiance in
    the scale that the metadata give, over the time of the exposure.

    Parameters
    ----------
    scene : Scene
        With its exposure resolved.
    metadata : mapping
        Of the rendered image: its window, and what the exposure came to.
    """
    settings = scene.sensor
    if settings is None:
        return None
    per_joule = electrons_per_joule(settings.response, settings.quantum_efficiency)
    white_per_joule = float(electrons_of_white(per_joule, settings.bayer).max())
    area = _pixel_area_m2(scene)
    well = settings.full_well_e or max(1.0, WELL_E_PER_UM2 * area * 1e12)
    saturation = well
    if (iso := metadata.get("iso")) is not None:
        saturation = min(well, white_electrons_at_iso(white_per_joule, area, float(iso)))
    top, black = 2**settings.bit_depth - 1, settings.black_dn
    gain = settings.system_gain_dn_per_e or system_gain(top, black, saturation)
    if scene.exposure.mode == "relative":
        if settings.system_gain_dn_per_e is not None:
            saturation = min(well, (top - black) / gain)
        electrons = per_joule * (saturation / white_per_joule)
    else:
        electrons = per_joule * _joules_per_value(scene, metadata, area)
    x, y, _, _ = metadata["window"]
    return SensorModel(
        electrons=np.asarray(electrons),
        full_well_e=well,
        read_noise_e=settings.read_noise_e,
        system_gain_dn_per_e=gain,
        black_level_dn=black,
        bit_depth=settings.bit_depth,
        bayer=settings.bayer,
        dark_e=settings.dark_current() * scene.shutter.time_s,
        prnu=settings.prnu,
        dsnu_e=settings.dsnu_e,
        demosaic=settings.demosaic,
        seed=_seed_at(scene.shutter.open_s, scene.render.seed if settings.seed is None else settings.seed),
        pattern_seed=settings.pattern_seed,
        origin=(int(x), int(y)),
    )


def _seed_at(open_s: float, seed: int) -> int:
    """Return the seed of an exposure that begins at a moment [s]: frames of a sequence do not share their noise."""
    if open_s == 0.0:
        return seed
    words = struct.unpack("<2I", struct.pack("<d", open_s))
    return int(np.random.SeedSequence([seed, *words]).generate_state(1, np.uint64)[0])


def _joules_per_value(scene: Scene, metadata: Mapping[str, Any], area_m2: float) -> float:
    """Return the energy [J] that a film of value 1 brings to a pixel during the exposure."""
    filtered = 2.0**-scene.exposure.neutral_density_stops
    joules: float = area_m2 * scene.shutter.time_s * filtered / float(metadata["values_per_irradiance"])
    return joules


def check_sensor(scene: Scene, width: int, height: int) -> None:
    """Raise an error, before anything is rendered, when a picture of so many pixels is too small for the sensor.

    Raises
    ------
    InputError
        It says what would be large enough.
    """
    if scene.sensor is not None:
        check_size(scene.sensor.bayer, width, height)


def _pixel_area_m2(scene: Scene) -> float:
    """Return the area on which a pixel gathers light [m²]."""
    if scene.sensor is not None and scene.sensor.pixel_pitch_um is not None:
        return float(scene.sensor.pixel_pitch_um * 1e-6) ** 2
    (width, height), (columns, rows) = scene.film.size_m(), scene.film.resolution
    return width / columns * height / rows
