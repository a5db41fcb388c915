"""Developing films as the picture settings of a scene say: when rendered, or later without rendering anew."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from rptcam_cl.imaging.development import Development
from rptcam_cl.imaging.film_files import read_film
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.white_balance import Adaptation, Gains, Grey, GreyWorld, KnownLight
from rptcam_cl.scene import PictureSettings, WhiteBalance, load_picture

SETTINGS = "picture"  # where metadata keep what a scene says of the picture


def develop(film: Image | str | os.PathLike[str], overrides: Iterable[str] = (), **settings: Any) -> Image:
    """Return an image of the same film that develops with other settings.

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
    return with_picture_settings(
        image, load_picture({**(known if isinstance(known, dict) else {}), **settings}, overrides)
    )


def with_picture_settings(image: Image, picture: PictureSettings) -> Image:
    """Return an image that develops by the picture settings of a scene, which its metadata keep."""
    kept = picture.model_dump(mode="json", exclude_defaults=True)
    others = {key: value for key, value in image.metadata.items() if key != SETTINGS}
    metadata = others | ({SETTINGS: kept} if kept else {})
    return replace(image, metadata=metadata, development=development_of(picture, metadata))


def development_of(picture: PictureSettings, metadata: Mapping[str, Any]) -> Development:
    """Return the numbers of picture settings, for a film with such metadata."""
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
        jpeg_quality=picture.jpeg_quality,
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
