"""Veiling glare: light that an even, bright surrounding sends to a black spot in the middle of the film.

Light may be followed either way. A diffuse point of the film shines backwards through the lens: what leaves towards the
scene straight is what would form the image there, what leaves after two reflections is the veil; what comes back to the
film, and what rims behind the stop catch, is light that a film or a barrel that is not black would add.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.ghost_path import check_lens
from rptcam_cl.optics.ghost_tree import Lit, Tree
from rptcam_cl.optics.glass import Medium
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.spot import Beam
from rptcam_cl.optics.surface import Surface
from rptcam_cl.optics.transmission import COATED, LensTransmission

RAYS = 12_000  # over the rear surface
SKY_MM = 1e5  # from the front to a plane that all light towards the scene meets


@dataclass(frozen=True)
class Glare:
    """Veiling glare in the middle of the film, in parts of the irradiance of a white film.

    Attributes
    ----------
    surfaces : float
        By two reflections between surfaces of the lens.
    film, barrel : float
        By light that the film scatters to the lens and back, and that rims behind the stop scatter.
    """

    surfaces: float
    film: float
    barrel: float

    @property
    def index(self) -> float:
        """Veiling glare index of ISO 9358: irradiance of the black spot over that of the white around it."""
        veil = self.surfaces + self.film + self.barrel
        return veil / (1.0 + veil)


def veiling_glare(
    lens: Lens,
    film_distance_mm: float,
    wavelength_nm: float = 550.0,
    transmission: LensTransmission = COATED,
    *,
    film_reflectance: float = 0.0,
    barrel_reflectance: float = 0.0,
) -> Glare:
    """Return the veiling glare of a lens under a hemisphere of even light.

    Parameters
    ----------
    lens : Lens
    film_distance_mm : float
        Last vertex to film.
    wavelength_nm : float
    transmission : LensTransmission
    film_reflectance : float
        Share of the light that the film scatters evenly. The whole plane of the film counts as lit.
    barrel_reflectance : float
        Share that rims behind the stop scatter evenly. They count as lit like the film.

    Raises
    ------
    InputError
        For a lens that has mirrors, is not round, or whose last surface has no rim; and for shares outside of 0 to 1.
    """
    for name, share in (("film", film_reflectance), ("barrel", barrel_reflectance)):
        if not 0 <= share < 1:
            raise InputError(f"the {name} reflects a share from 0 to below 1 (got {share:g})")
    check_lens(lens)
    point = Beam(0.0, film_distance_mm, is_diffuse=True)
    tree = Tree(Lit(reversed_lens(lens), SKY_MM, point, wavelength_nm, (np.inf, np.inf), transmission), 2, RAYS)
    account, image = tree.account, tree.account.image
    if not image > 0:
        raise InputError(f"{lens.name}: no light reaches the middle of the film")
    stop = lens.stop_index if lens.stop_index is not None else 0
    behind = len(lens.surfaces) - 1 - stop
    caught = sum(light for k, light in tree.blocked.items() if k < behind)
    return Glare(account.ghosts / image, film_reflectance * account.out / np.pi, barrel_reflectance * caught / np.pi)


def reversed_lens(lens: Lens) -> Lens:
    """Return a lens that light passes from its film side.

    Raises
    ------
    InputError
        When a surface is a mirror, not round, or of a kind that is not known turned round.
    """
    if any(s.is_mirror or s.form is not None or not s.is_rotational for s in lens.surfaces):
        raise InputError(f"{lens.name}: glare is known of lenses with round surfaces of powers of r, without mirrors")
    media = lens.media
    surfaces = [
        _turned(surface, media[k], lens.surfaces[k - 1].thickness if k else 0.0)
        for k, surface in reversed(list(enumerate(lens.surfaces)))
    ]
    stop = None if lens.stop_index is None else len(surfaces) - 1 - lens.stop_index
    return replace(
        lens,
        surfaces=tuple(surfaces),
        object_medium=media[-1],
        stop_index=stop,
        configurations=(),
        focusing=None,
        floating=(),
    )


def _turned(surface: Surface, medium: Medium, thickness: float) -> Surface:
    odd = tuple((power, -value) for power, value in surface.aspheric)
    return replace(surface, curvature=-surface.curvature, aspheric=odd, glass=medium, thickness=thickness)
