"""The photographer's facts in a picture's metadata, as EXIF directories and OpenEXR attributes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.imaging import tag_directory as tags

Metadata = Mapping[str, Any]

# Standard attributes of OpenEXR and what they mean: openexr.com/en/latest/StandardAttributes.html
_EXR_NUMBERS = {
    "f_number": "aperture",
    "t_number": "tStop",
    "exposure_time_s": "expTime",
    "iso": "isoSpeed",
    "focal_length_mm": "effectiveFocalLength",
    "focus_distance_m": "focus",
}
_EXR_TEXTS = {"lens": "lensModel", "software": "cameraFirmwareVersion"}
ALL_METADATA = "rptcam_metadata"  # attribute of EXR files with all as JSON, since others do not keep every type

# Tags of EXIF 2.32 (CIPA DC-008)
_EXIF_NUMBERS = {"f_number": 0x829D, "exposure_time_s": 0x829A, "focal_length_mm": 0x920A, "focus_distance_m": 0x9206}
_VERSION, _COLOUR_SPACE, _LENS_MODEL, _FOCAL_LENGTH_35 = 0x9000, 0xA001, 0xA434, 0xA405
_ISO, _SENSITIVITY_TYPE, _ISO_SPEED = 0x8827, 0x8830, 0x8833
_ISO_SPEED_ALONE = 3  # of the types of sensitivity
_SRGB, _UNCALIBRATED = 1, 0xFFFF
_LARGEST_SHORT = 0xFFFF
_DIAGONAL_35_MM = math.hypot(36, 24)
_SOFTWARE, _EXIF = 0x0131, 0x8769


def exr_attributes(metadata: Metadata) -> dict[str, str | float]:
    """Return the standard attributes of OpenEXR for what the metadata hold."""
    numbers = {name: _positive(metadata, key) for key, name in _EXR_NUMBERS.items()}
    texts = {name: str(metadata[key]) for key, name in _EXR_TEXTS.items() if metadata.get(key)}
    return {name: number for name, number in numbers.items() if number is not None} | texts


def world_to_camera(metadata: Metadata) -> dict[str, NDArray[np.float32]]:
    """Return the standard attribute of the camera's pose, in metres; nothing of metadata without one.

    It multiplies rows from the right, as Imath has it. The camera looks along -z, y up, and stands at its entrance
    pupil, from which programs take the perspective; at its eye where the pupil has no place.
    """
    try:
        pose = np.array(metadata["world_from_camera"], np.float64)
        pupil = (metadata.get("entrance_pupil") or {}).get("world_m")
        if pose.shape != (4, 4):
            return {}
        if pupil is not None:
            pose[:3, 3] = pupil
        matrix = np.linalg.inv(pose).T
    except (KeyError, TypeError, ValueError, AttributeError, np.linalg.LinAlgError):
        return {}
    return {"worldToCamera": np.ascontiguousarray(matrix, np.float32)} if np.isfinite(matrix).all() else {}


def from_exr_attributes(attributes: Metadata) -> dict[str, Any]:
    """Return the metadata that standard attributes of OpenEXR hold."""
    return {key: attributes[name] for key, name in (_EXR_NUMBERS | _EXR_TEXTS).items() if name in attributes}


def exif_fields(metadata: Metadata, *, encoded: bool) -> dict[int, tags.TagField]:
    """Return the EXIF directory of the metadata; what they lack is left out.

    Parameters
    ----------
    metadata
        Of the picture.
    encoded
        Whether the picture is encoded as sRGB.
    """
    found = {_VERSION: tags.undefined(b"0232"), _COLOUR_SPACE: tags.short(_SRGB if encoded else _UNCALIBRATED)}
    for key, tag in _EXIF_NUMBERS.items():
        if (number := _positive(metadata, key)) is not None:
            found[tag] = tags.rational(number)
    if (iso := _positive(metadata, "iso")) is not None:
        found[_ISO] = tags.short(min(round(iso), _LARGEST_SHORT))
        found[_SENSITIVITY_TYPE] = tags.short(_ISO_SPEED_ALONE)
        found[_ISO_SPEED] = tags.long([min(round(iso), 2**32 - 1)])
    if metadata.get("lens"):
        found[_LENS_MODEL] = tags.ascii_text(str(metadata["lens"]))
    if (equivalent := _equivalent_focal_length(metadata)) is not None:
        found[_FOCAL_LENGTH_35] = tags.short(equivalent)
    return found


def exif_bytes(metadata: Metadata, *, encoded: bool) -> bytes:
    """Return EXIF data as files of other formats hold them: a TIFF header, and directories."""
    fields: dict[int, tags.TagField | tags.Directory] = {_EXIF: exif_fields(metadata, encoded=encoded)}
    if metadata.get("software"):
        fields[_SOFTWARE] = tags.ascii_text(str(metadata["software"]))
    return tags.HEADER + tags.directory_bytes(fields, len(tags.HEADER))


def _positive(metadata: Metadata, key: str) -> float | None:
    """Return a number of the metadata that is above 0, a distance perhaps infinite; None when there is none."""
    value = metadata.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
        return None
    return None if math.isinf(value) and key != "focus_distance_m" else float(value)


def _equivalent_focal_length(metadata: Metadata) -> int | None:
    """Return the focal length that sees as much across the diagonal of 35 mm film [mm]."""
    focal_length, size = _positive(metadata, "focal_length_mm"), metadata.get("film_size_mm")
    if focal_length is None or not isinstance(size, (list, tuple)):
        return None
    if not all(isinstance(length, (int, float)) and 0 < length < math.inf for length in size) or not size:
        return None
    equivalent = round(min(focal_length * _DIAGONAL_35_MM / math.hypot(*size), 2.0 * _LARGEST_SHORT))
    return equivalent if 0 < equivalent <= _LARGEST_SHORT else None
