"""Developing films as the picture settings of a scene say: when rendered, or later without rendering anew."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from rptcam_cl.imaging.developing import Development
from rptcam_cl.imaging.film_files import read_film
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.white_balance import Adaptation, Gains, Grey, GreyWorld, KnownLight
from rptcam_cl.scene import PictureSettings, WhiteBalance, load_picture

SETTINGS = "picture"  # where metadata keep what a scene says of the picture


def develop(film: Image | str | os.PathLike[str], overrides: Iterable[str] = (), **settings: Any) -> Image:
    """Return the same film to be developed otherwise.

    Parameters
    ----------
    film
        A rendered image, or a file of one (``.exr``, ``.npy``, ``.npz``).
    overrides
        Settings as text, ``picture.tone=agx``.
    **settings
        Keys of ``picture`` in scene files: ``tone="agx"``, ``white_balance={"temperature_k": 3200}``, ``ev=1``. Those
        not given stay as they are in the film's metadata.

    Raises
    ------
    InputError
        A setting is wrong, or the file holds no film.
    StateError
        The file cannot be read.
    """
    image = film if isinstance(film, Image) else read_film(film)
    known = image.metadata.get(SETTINGS)
    return developed_as(image, load_picture({**(known if isinstance(known, dict) else {}), **settings}, overrides))


def developed_as(image: Image, picture: PictureSettings) -> Image:
    """Return an image with the picture settings of a scene, which its metadata tell too."""
    told = picture.model_dump(mode="json", exclude_defaults=True)
    kept = {key: value for key, value in image.metadata.items() if key != SETTINGS}
    metadata = kept | ({SETTINGS: told} if told else {})
    return replace(image, metadata=metadata, picture=development(picture, metadata))


def development(picture: PictureSettings, metadata: Mapping[str, Any]) -> Development:
    """Return what picture settings mean in numbers, for a film of which the metadata tell."""
    wanted = picture.white_balance
    # Light of RGB has multiplied reflectances channel by channel, and dividing so undoes it exactly; light of spectra
    # has not.
    suited: Adaptation = "bradford" if metadata.get("spectrum") == "spectral" else "channels"
    return Development(
        ev=picture.ev,
        white_balance=None if wanted is None else _white_balance(wanted),
        adaptation=suited if wanted is None or wanted.adaptation is None else wanted.adaptation,
        tone=picture.tone.kind,
        tone_white=picture.tone.shown_white,
        gamut=picture.gamut,
        bits=picture.bits,
    )


def _white_balance(wanted: WhiteBalance) -> KnownLight | Gains | Grey | GreyWorld:
    if wanted.gains is not None:
        return Gains(wanted.gains)
    if wanted.grey is not None:
        return Grey(wanted.grey)
    if (colour := wanted.light_colour()) is None:
        return GreyWorld()
    red, green, blue = (float(channel) for channel in colour)
    return KnownLight((red, green, blue))
