"""Pictures through parts of the opening: what dual pixels, phase-detect pixels and focusing screens see.

A mask in the plane of the stop takes the place of the camera's own opening, so that all that a render has goes through
it. Pictures are as bright as through the whole opening, but for what a part loses beyond its edge.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.job import RenderOptions, SceneSource, SeriesRenderer, read_scene, resolve
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import listed
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.imaging.image import Image
from rptcam_cl.rendering.cameras.ideal import stop_shape
from rptcam_cl.scene.load import at_rest, change_scene, set_keys
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.studies.focus.probe import circle_of_confusion

CELLS = 512  # of a mask across the opening
PHASE_ROWS, PHASE_COLUMNS = 8, 4  # pixels from one phase-detect pixel of a half to the next
WEDGE_F, EYE_F = 8.0, 16.0  # the cone of light at whose edge wedges look, and the one that the eye behind them takes in
SPLIT, COLLAR = 1 / 8, 5 / 24  # of the film's height: diameters of the split image and the microprisms round it
FACET = 1 / 240  # of it: side of a microprism
LEAST_FACET_PX = 4
MOST_MORE = 64  # times the samples of the picture that a wedge takes at most
HALVES = {"x": ((-1.0, 0.0), (1.0, 0.0)), "y": ((0.0, -1.0), (0.0, 1.0))}
WEDGES = ((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0))


class _Openings:
    """A scene seen through parts of the opening of its camera."""

    def __init__(self, source: SceneSource, options: RenderOptions, device: str | Session | None) -> None:
        session = device if isinstance(device, Session) else open_session(device)
        given = at_rest(options.apply_to(read_scene(source)))
        if given.camera.fixed_outline is not None:
            raise InputError(f"camera: {given.camera.fixed_outline} (allowed: kind realistic or thin_lens)")
        found, self._series = resolve(given, session), SeriesRenderer(session)
        self.scene = given if found.focus is None else change_scene(given, camera=found.focus["camera"])
        if found.metered_cd_m2 is not None:
            self.scene = set_keys(self.scene, {"exposure.lock_cd_m2": found.metered_cd_m2})
        places = (np.arange(CELLS) + 0.5) * 2 / CELLS - 1
        self._x, self._y = np.meshgrid(places, -places)
        shape = stop_shape(self.scene, self.scene.camera.outline)
        self._open = np.hypot(self._x, self._y) <= 1 if shape is None else shape.holds(self._x, self._y)

    def whole(self) -> Image:
        """Take the picture through the whole opening."""
        return self._series.render(self.scene)

    def half(self, side: tuple[float, float]) -> Image:
        """Take the picture through the half of the opening on a side."""
        part = self._open & (side[0] * self._x + side[1] * self._y > 0)
        return self._through(part, float(part.sum()))

    def disc(self, middle: tuple[float, float], radius: float, crop: tuple[float, float, float, float]) -> Image | None:
        """Take a part of the picture through a disc, in units of the opening's radius; None where it lies beside it.

        It takes more samples, as few rays of a traced lens meet a small disc.
        """
        part = self._open & (np.hypot(self._x - middle[0], self._y - middle[1]) <= radius)
        if not part.any():
            return None
        more = min(math.ceil(self._open.sum() / part.sum()), MOST_MORE)
        return self._through(part, np.pi * (radius * CELLS / 2) ** 2, crop, more)

    def _through(
        self,
        part: NDArray[np.bool_],
        cells: float,
        crop: tuple[float, float, float, float] | None = None,
        more: int = 1,
    ) -> Image:
        mask = {"shape": "image", "file": part.astype(np.uint8)}
        scene = change_scene(self.scene, camera={"aperture": mask}, render={"spp": more * self.scene.render.spp})
        image = self._series.render(scene if crop is None else change_scene(scene, film={"crop": crop}))
        # modes of exposure that count light find less behind a smaller part
        counts = self.scene.exposure.mode in ("irradiance", "physical")
        full = np.count_nonzero(self._open if counts else part)
        return replace(image, pixels=image.pixels * np.float32(full / cells), layers={})


def dual_pixels(
    source: SceneSource,
    split: str = "x",
    *,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    device: str | Session | None = None,
) -> tuple[Image, Image]:
    """Return the pictures that the two halves of dual pixels take: through the left and the right half of the stop.

    Each is as bright as the whole picture, which is their mean. What lies nearer than the plane of focus stands farther
    to the right in the left one.

    Parameters
    ----------
    split
        ``x``, or ``y`` for the lower and the upper half.
    spp, size, seed, device
        As for `render`.

    Raises
    ------
    InputError
        When the camera has no opening that a mask fits into.
    """
    if split not in HALVES:
        raise InputError(f"split: is no way to halve an opening (got {split}; allowed: {listed(HALVES)})")
    openings = _Openings(source, RenderOptions(spp=spp, size=size, seed=seed), device)
    before, beyond = (openings.half(side) for side in HALVES[split])
    return before, beyond


def with_phase_pixels(before: Image, beyond: Image) -> Image:
    """Return the picture of a sensor some of whose pixels are masked for phase detection, from a dual-pixel pair.

    In every 8th row every 4th pixel sees one half of the pupil, and the one two beside it the other, with half of the
    light; nothing is filled in.
    """
    pixels = np.array((before.pixels + beyond.pixels) / 2, np.float32)
    first, middle = PHASE_ROWS // 2, PHASE_COLUMNS // 2
    for image, start in ((before, 0), (beyond, middle)):
        pixels[first::PHASE_ROWS, start::PHASE_COLUMNS] = image.pixels[first::PHASE_ROWS, start::PHASE_COLUMNS] / 2
    return replace(before, pixels=pixels)


def focusing_screen(
    source: SceneSource,
    *,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    device: str | Session | None = None,
) -> Image:
    """Return the picture on a focusing screen with a split image in its middle and a collar of microprisms round it.

    The wedges of the upper half look through the left edge of an f/8 cone of light, those of the lower half through the
    right one; each facet of a microprism through an edge of its own. What is out of focus is parted, or shimmers. From
    f/5.6 on wedges go dark, at f/16 they are black.

    Parameters
    ----------
    spp, size, seed, device
        As for `render`.

    Raises
    ------
    InputError
        When the camera has no opening that a mask fits into.
    """
    openings = _Openings(source, RenderOptions(spp=spp, size=size, seed=seed), device)
    if openings.scene.film.crop is not None:
        raise InputError("film.crop: a focusing screen is of the whole picture (allowed: none)")
    image = openings.whole()
    drive = focus_drive(openings.scene)
    f_number = drive.sharp_mm / (2 * circle_of_confusion(openings.scene))
    pixels = image.pixels.copy()
    height, width = pixels.shape[:2]
    y, x = np.mgrid[:height, :width] + 0.5 - np.array([height, width]).reshape(2, 1, 1) / 2
    facet = max(FACET * height, LEAST_FACET_PX)
    across, down = (np.mod(place, facet) - facet / 2 for place in (x, y))
    sideways, reach = np.abs(across) > np.abs(down), np.hypot(x, y) * 2 / height
    collar = (reach > SPLIT) & (reach <= COLLAR)
    places = (
        ((reach <= SPLIT) & (y < 0)) | (collar & sideways & (across < 0)),
        ((reach <= SPLIT) & (y >= 0)) | (collar & sideways & (across >= 0)),
        collar & ~sideways & (down < 0),
        collar & ~sideways & (down >= 0),
    )
    side_px = min(math.ceil(COLLAR * height / 2), width // 2)
    rows, columns = (slice((side - 1) // 2 - side_px, side // 2 + side_px + 1) for side in (height, width))
    rows, columns = slice(max(rows.start, 0), rows.stop), slice(max(columns.start, 0), min(columns.stop, width))
    crop = columns.start / width, columns.stop / width, rows.start / height, rows.stop / height
    within = pixels[rows, columns]
    for side, place in zip(WEDGES, places, strict=True):
        towards = side[0] * f_number / WEDGE_F, side[1] * f_number / WEDGE_F
        seen, here = openings.disc(towards, f_number / EYE_F, crop), place[rows, columns]
        within[here] = 0.0 if seen is None else seen.pixels[here]
    return replace(image, pixels=pixels, layers={})
