"""A sensor during an exposure: its amounts by EMVA 1288, its speed by ISO 12232, how its channels see colours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.colour import LUMENS_PER_WATT, srgb_from_xyz
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG", "none", "monochrome")
DEMOSAICS = ("malvar", "bilinear")
_AMOUNTS = ("full_well_e", "read_noise_e", "system_gain_dn_per_e", "black_level_dn", "dark_e", "prnu", "dsnu_e")

# ISO 12232, saturation-based speed: S = 78 / H, where H [lx s] is the exposure that just saturates.
SATURATION_LUX_SECONDS = 78.0


@dataclass(frozen=True, eq=False)
class SensorModel:
    """A sensor during one exposure.

    Attributes
    ----------
    electrons : (3, 3) array
        Mean electrons in each channel of the sensor (columns) for a value 1 in each channel of the film (rows).
    full_well_e : float
        Most electrons that a pixel holds.
    read_noise_e : float
        Standard deviation of the noise of reading [electrons].
    dark_e : float
        Mean electrons that come without light during the exposure.
    system_gain_dn_per_e : float
    black_level_dn : float
    bit_depth : int
    prnu : float
        Standard deviation of the sensitivity from pixel to pixel, as a share.
    dsnu_e : float
        Standard deviation of the dark signal from pixel to pixel [electrons].
    bayer : str
        Colours of the upper left 2 x 2 pixels of the whole film by rows, ``none`` or ``monochrome``.
    demosaic : str
        ``malvar`` or ``bilinear``.
    seed, pattern_seed : int
        Seeds of the noise and of the fixed pattern.
    origin : pair of int
        Column and row of the upper left pixel in the whole film.
    """

    electrons: NDArray[np.float64]
    full_well_e: float
    read_noise_e: float
    system_gain_dn_per_e: float
    black_level_dn: float
    bit_depth: int
    bayer: str
    dark_e: float = 0.0
    prnu: float = 0.0
    dsnu_e: float = 0.0
    demosaic: str = "malvar"
    seed: int = 0
    pattern_seed: int = 0
    origin: tuple[int, int] = (0, 0)

    @property
    def pattern(self) -> str:
        """Colours of the picture's own upper left 2 x 2 pixels, ``none`` or ``monochrome``."""
        if len(self.bayer) != 4 or self.bayer == "none":
            return self.bayer
        x, y = self.origin
        return "".join(self.bayer[2 * ((row + y) % 2) + (column + x) % 2] for row in (0, 1) for column in (0, 1))

    @property
    def top_dn(self) -> int:
        """Highest number of the converter."""
        return int(2**self.bit_depth - 1)

    @property
    def dark_level_dn(self) -> float:
        """Mean number without light, dark current included."""
        return self.black_level_dn + self.system_gain_dn_per_e * min(self.dark_e, self.full_well_e)

    @property
    def white_level_dn(self) -> float:
        """Number at which a channel saturates: of a full well, or the converter's highest."""
        return min(self.black_level_dn + self.system_gain_dn_per_e * self.full_well_e, float(self.top_dn))

    @property
    def white_electrons(self) -> NDArray[np.float64]:
        """Electrons for a film of white 1: (3,) per channel, (1,) of a monochrome sensor."""
        return electrons_of_white(self.electrons, self.bayer)

    def described(self) -> dict[str, Any]:
        """Return the sensor as a mapping for JSON, from which `from_description` makes it again."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in values.items()}

    def _check(self) -> None:
        """Raise ValueError where a value is not of its kind, or none that a sensor has."""
        whole = {"bit_depth": (1, 16), "seed": (0, 2**64 - 1), "pattern_seed": (0, 2**64 - 1)}
        for name, (least, most) in whole.items():
            value = getattr(self, name)
            if type(value) is not int or not least <= value <= most:
                raise ValueError(f"{name} is {value!r}")
        for name in _AMOUNTS:
            value = getattr(self, name)
            if type(value) not in (int, float) or not 0 <= value < 1e30:
                raise ValueError(f"{name} is {value!r}")
        if not (self.full_well_e and self.system_gain_dn_per_e and np.isfinite(self.electrons).all()):
            raise ValueError("a sensor without a well, gain or response")
        if self.bayer not in PATTERNS or self.demosaic not in DEMOSAICS or min(self.origin) < 0:
            raise ValueError(f"bayer is {self.bayer!r}, demosaic {self.demosaic!r}, origin {self.origin!r}")

    @classmethod
    def from_description(cls, description: Mapping[str, Any]) -> SensorModel:
        """Return the sensor of a mapping that `described` made, maybe in another version or edited since.

        Raises
        ------
        InputError
            When it does not describe a sensor.
        """
        try:
            values: dict[str, Any] = dict(description)
            values["electrons"] = np.array(values["electrons"], np.float64).reshape(3, 3)
            values["origin"] = (int(values["origin"][0]), int(values["origin"][1]))
            sensor = cls(**values)
            sensor._check()
            return sensor
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
            raise InputError(f"the metadata describe no sensor ({error!r}; render the scene anew)") from None


def electrons_of_white(electrons: NDArray[np.float64], bayer: str) -> NDArray[np.float64]:
    """Return what white gives a pixel: (3,) by the channels of the sensor, (1,) of a monochrome one, which sees all.

    Parameters
    ----------
    electrons : (film, sensor) array
        Electrons in each channel of the sensor for light in each channel of the film.
    bayer : str
        Mosaic, ``none`` or ``monochrome``.
    """
    total = electrons.sum(axis=0)
    return np.asarray(total.sum(keepdims=True) if bayer == "monochrome" else total)


def white_electrons_at_iso(white_per_joule: float, pixel_area_m2: float, iso: float) -> float:
    """Return the electrons that white light of the saturating exposure of an ISO speed gives the fullest channel.

    Parameters
    ----------
    white_per_joule : float
        Electrons [1/J] in that channel for white light.
    pixel_area_m2 : float
        Area on which a pixel gathers light [m²].
    iso : float
    """
    joules_per_m2 = SATURATION_LUX_SECONDS / iso / LUMENS_PER_WATT
    return white_per_joule * pixel_area_m2 * joules_per_m2


def system_gain(top_dn: float, black_level_dn: float, saturation_e: float) -> float:
    """Return the gain [DN/electron] with which a number of electrons just reaches the converter's highest number."""
    return (top_dn - black_level_dn) / saturation_e


def rgb_from_balanced(sensor: SensorModel) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from white-balanced raw channels to linear sRGB; white stays white.

    It undoes how the sensor's channels see the colours of the film: exact for light of RGB colours.
    """
    return np.linalg.inv((sensor.electrons / sensor.electrons.sum(axis=0)).T)


def camera_from_xyz(sensor: SensorModel) -> NDArray[np.float64]:
    """Return the matrix (3, 3) from CIE XYZ under D65 to raw channels, whose highest is 1 for white of Y = 1."""
    return np.asarray(sensor.electrons.T @ srgb_from_xyz() / sensor.white_electrons.max())
