"""Several renders of one scene: focus stacks, views through parts of the opening, sweeps with their contact sheets."""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.job import SeriesRenderer, render, resolve
from rptcam_cl.api.options import RenderOptions
from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError, StateError
from rptcam_cl.core.files import check_writable, listed, make_folder, name_errors, replacing, resolve_links
from rptcam_cl.core.remember import OneMaker, made_by
from rptcam_cl.device.session import Session, Wanted, open_session, open_sessions
from rptcam_cl.imaging import development
from rptcam_cl.imaging.image import Image, read_film, with_picture_settings
from rptcam_cl.rendering.account import window
from rptcam_cl.rendering.cameras.lens_records import stop_shape
from rptcam_cl.scene.changes import at_rest, change_scene, set_keys
from rptcam_cl.scene.load import SceneSource, read_scene
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import Drive, WholeLens, focus_drive
from rptcam_cl.studies.focus.probe import Zone, circle_of_confusion

if TYPE_CHECKING:
    from PIL.Image import Image as Picture


Plane = NDArray[np.float64]

# Focus stacking: pictures of one scene focused at many distances become one that is sharp throughout, and a depth map.
#
# The method is shape from focus: the modified Laplacian of each picture, and a Gaussian through its greatest value and
# the neighbours (S. Nayar, Y. Nakagawa, Shape from focus, IEEE PAMI 16, 824 (1994)). It needs texture: where there is
# none, the depth is that of what lies around. Each picture consists of two with independent noise, whose Laplacians are
# multiplied, so that noise adds nothing on the average; how far they are apart says what it adds by chance.

_MOST_PICTURES = 200
CENTRE = Zone(0.49, 0.51, 0.49, 0.51)
WINDOW = 4  # pixels to either side over which contrast is summed
CLEAR = 2.0  # times the mean over all pictures, by which the greatest contrast says where a pixel is sharp
CERTAIN = 4.0  # standard errors of it by noise
INDEPENDENT = 0.2  # of the pixels of a window: their Laplacians overlap
_SPREADS = (2, 4, 8, 16, 32, 64, 128, 256, 512)  # pixels to either side from which depth is taken where there is none
LEAST_SHARE = 0.02  # of those pixels that must have one
_FRAME_NODES = 1025  # of the table from the focus of a film that was read to its state


def focus_stack(
    source: SceneSource,
    near_m: float,
    far_m: float,
    *,
    steps: int | None = None,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    device: str | Session | None = None,
    on_picture: Callable[[int, int, float], object] | None = None,
    on_image: Callable[[int, float, Image], object] | None = None,
) -> Image:
    """Return one picture that is sharp from a near to a far distance, with its depth map as the layer `depth`.

    All pictures are drawn as large as the one with the nearest focus, whose picture is the largest.

    Parameters
    ----------
    near_m, far_m
        Distances of focus, as of autofocus: to the film, of a thin lens to the lens [m].
    steps
        Pictures to take; by default so many that the blur goes by a circle of confusion or a pixel, what is more.
    spp, size, seed, device
        As for `render`.
    on_picture
        Called before each picture with its number, their count and its distance [m].
    on_image
        Called with each picture: its number, its distance [m] and the picture itself.

    Raises
    ------
    InputError
        When the camera cannot focus there, or a film that is tilted, has no single distance of focus.
    """
    if not 0 < near_m < far_m:
        raise InputError(f"near_m, far_m: need 0 < near < far (got {near_m:g} and {far_m:g})")
    scene = at_rest(RenderOptions(spp=spp, size=size, seed=seed).apply_to(read_scene(source)))
    if scene.camera.film_movements.turns:
        raise InputError("camera.movements: a tilted film has no single distance of focus (allowed: without a turn)")
    drive = focus_drive(scene)
    states, needed = _states_between(scene, drive, near_m, far_m, steps)
    distances = [drive.object_distance(state) for state in states]

    def say(number: int) -> None:
        if on_picture is not None:
            on_picture(number + 1, len(states), distances[number] or np.inf)

    def taken() -> Iterator[tuple[Image, Image]]:
        for number, pair in enumerate(_take_pairs(scene, drive, states, device, say)):
            if on_image is not None:
                mean = np.asarray((pair[0].pixels + pair[1].pixels) / 2, np.float32)
                on_image(number + 1, distances[number] or np.inf, replace(pair[0], pixels=mean))
            yield pair

    about = {"pictures": len(states), "near_m": near_m, "far_m": far_m, "needed": needed}
    return _stack(taken(), drive, states, about)


def _states_between(
    scene: Scene, drive: Drive, near_m: float, far_m: float, steps: int | None
) -> tuple[list[float], int]:
    """The states of a drive from far to near, as many as requested or needed; and how many leave no blur between."""
    ends = [drive.coordinate(drive.state_for(distance, CENTRE)) for distance in (far_m, near_m)]
    coarse = max(scene.film.size_m()[0] * 1e3 / scene.film.resolution[0] / circle_of_confusion(scene), 1.0)
    needed = int(np.ceil(abs(ends[1] - ends[0]) / (drive.depth_of_focus * coarse))) + 1
    count = max(needed, 3) if steps is None else steps
    if not 3 <= count <= _MOST_PICTURES:
        allowed = f"3 to {_MOST_PICTURES}; {needed} leave nothing unsharp between"
        raise InputError(f"steps: is out of range (got {count}; allowed: {allowed})")
    return [drive.state_at(float(place)) for place in np.linspace(ends[0], ends[1], count)], needed


def stack_frames(source: SceneSource, files: Sequence[str | Path]) -> Image:
    """Return the same as `focus_stack` of films that were rendered before, by their focus in the files.

    Two or more with the same focus and other seeds tell their noise; that of a single one is taken for texture.

    Parameters
    ----------
    source
        Their scene, whose focus and film's resolution do not matter.
    files
        Films, in any order.

    Raises
    ------
    InputError
        When there are fewer than three focuses, or a film does not say its own or has another size.
    """
    drive, groups = focus_drive(at_rest(read_scene(source))), dict[float, list[Image]]()
    low, high = sorted(map(drive.coordinate, drive.limits))
    places = np.linspace(low, high, _FRAME_NODES)
    vergences = np.array([drive.first_order_vergence(drive.state_at(float(place))) for place in places])
    sense = 1 if vergences[-1] > vergences[0] else -1
    size = None
    for file in files:
        image = read_film(Path(file))
        state, distance = image.metadata.get("film_distance_mm"), image.metadata.get("focus_distance_m")
        if not isinstance(drive, WholeLens) or state is None:
            if distance is None:
                raise InputError(f"{file}: does not say where it is focused (allowed: films that render wrote)")
            state = drive.state_at(float(np.interp(1 / distance, vergences[::sense], places[::sense])))
        if (size := size or image.pixels.shape) != image.pixels.shape:
            raise InputError(f"{file}: is {image.width} x {image.height} pixels (allowed: as the others)")
        groups.setdefault(round(float(state), 9), []).append(image)
    if len(groups) < 3:
        raise InputError(f"frames: are focused at {len(groups)} distances (allowed: at least 3)")
    states = sorted(groups, key=lambda state: drive.nearer * drive.coordinate(state))
    taken = ((_mean_image(groups[state][::2]), _mean_image(groups[state][1::2] or groups[state])) for state in states)
    return _stack(taken, drive, states, {"pictures": len(states)})


def _mean_image(images: Sequence[Image]) -> Image:
    return replace(images[0], pixels=np.mean([image.pixels for image in images], axis=0, dtype=np.float32))


def _stack(taken: Iterable[tuple[Image, Image]], drive: Drive, states: Sequence[float], about: dict[str, Any]) -> Image:
    """Make the picture and the depth of pairs in states from far to near."""
    image, pixels, place, known = _blend(taken, [drive.image_scale(states[-1], state) for state in states])
    distances = [drive.object_distance(state) for state in states]
    depth = 1 / np.interp(place, np.arange(len(states)), [1 / (distance or np.inf) for distance in distances])
    about = {**about, "known_share": float(known.mean())}
    metadata = {**image.metadata, "focus_stack": about, "layers": ["depth"]}
    return replace(
        image, pixels=pixels.astype(np.float32), metadata=metadata, layers={"depth": depth.astype(np.float32)}
    )


def _take_pairs(
    scene: Scene,
    drive: Drive,
    states: Sequence[float],
    device: str | Session | None,
    on_picture: Callable[[int], object],
) -> Iterator[tuple[Image, Image]]:
    """Take two pictures with independent noise in each state, with half of the samples each; the first names all."""
    series = SeriesRenderer(device if isinstance(device, Session) else open_session(device))
    scene = change_scene(scene, render={"spp": max(scene.render.spp // 2, 1)})
    for number, state in enumerate(states):
        on_picture(number)
        there = change_scene(scene, camera=drive.camera_keys(state))
        image = series.render(there)
        if number == 0 and (metered := image.metadata.get("metered_cd_m2")) is not None:
            scene, there = (set_keys(each, {"exposure.lock_cd_m2": metered}) for each in (scene, there))
        other = series.render(change_scene(there, render={"seed": (scene.render.seed + 1) % 2**32}))
        yield replace(image, metadata=image.metadata | {"spp": image.metadata["spp"] + other.metadata["spp"]}), other


def resized(pixels: Plane, scale: float) -> Plane:
    """Return a picture (height, width, 3) drawn larger or smaller about its middle, by Catmull-Rom's cubic.

    Pixels that come from beyond the edge are those of the edge.
    """
    for axis in (0, 1):
        length = pixels.shape[axis]
        at = (np.arange(length) - (length - 1) / 2) / scale + (length - 1) / 2
        first = np.floor(at).astype(int)
        t = at - first
        weights = (
            -t / 2 + t**2 - t**3 / 2, 1 - 5 * t**2 / 2 + 3 * t**3 / 2, t / 2 + 2 * t**2 - 3 * t**3 / 2,
            -(t**2) / 2 + t**3 / 2,
        )  # fmt: skip
        shape = [-1 if side == axis else 1 for side in range(3)]
        taken = (np.take(pixels, np.clip(first + k - 1, 0, length - 1), axis) for k in range(4))
        pixels = sum(weight.reshape(shape) * part for weight, part in zip(weights, taken, strict=True))
    return pixels


def _box_mean(values: Plane, reach: int) -> Plane:
    """Return the mean over a square about each pixel, as far as it lies within the picture."""
    for axis in (0, 1):
        length = values.shape[axis]
        sums = np.concatenate([np.zeros_like(values.take([0], axis)), values.cumsum(axis)], axis)
        high, low = np.minimum(np.arange(length) + reach + 1, length), np.maximum(np.arange(length) - reach, 0)
        shape = [-1 if side == axis else 1 for side in range(values.ndim)]
        values = (sums.take(high, axis) - sums.take(low, axis)) / (high - low).reshape(shape)
    return values


def _contrast(pair: Sequence[Plane]) -> tuple[Plane, Plane]:
    """Return the product of the Laplacians of two pictures over their local brightness, and its standard error.

    Both are means over a window.
    """
    lights = [pixels @ np.array([0.2126, 0.7152, 0.0722]) for pixels in pair]
    level = np.maximum(_box_mean((lights[0] + lights[1]) / 2, 4 * WINDOW), 1e-12)
    padded = [np.pad(light, 1, mode="edge") for light in lights]
    across, down = (
        [2 * light - np.roll(light, 1, axis) - np.roll(light, -1, axis) for light in padded] for axis in (1, 0)
    )
    inner = (slice(1, -1), slice(1, -1))
    product = (across[0] * across[1] + down[0] * down[1])[inner]
    noise = ((across[0] - across[1]) ** 2 + (down[0] - down[1]) ** 2)[inner]  # four times the variance of a Laplacian
    error = _box_mean(noise, WINDOW) / 4 * np.sqrt(2 / (INDEPENDENT * (2 * WINDOW + 1) ** 2))
    return _box_mean(product, WINDOW) / level**2, error / level**2


def _blend(
    taken: Iterable[tuple[Image, Image]], scales: Sequence[float]
) -> tuple[Image, Plane, Plane, NDArray[np.bool_]]:
    """Make one sharp picture of those of a stack by the contrasts of each, drawn so many times larger.

    Returns
    -------
    image, pixels, place, known
        The last image as it was, the picture, the place of each pixel in the stack, and which pixels tell theirs
        themselves.
    """
    whole, measured = [], []
    for (image, other), scale in zip(taken, scales, strict=True):
        pair = [resized(each.pixels.astype(np.float64), scale) for each in (image, other)]
        whole.append(((pair[0] + pair[1]) / 2).astype(np.float32))
        measured.append(np.stack(_contrast(pair)).astype(np.float32))
    pictures, count = np.stack(whole), len(whole)
    contrasts, errors = np.moveaxis(np.stack(measured).astype(np.float64), 1, 0)
    best = np.argmax(contrasts, axis=0)
    middle = np.clip(best, 1, count - 2)
    before, at, after = (
        np.log(np.maximum(np.take_along_axis(contrasts, (middle + side)[None], 0)[0], 1e-12)) for side in (-1, 0, 1)
    )
    bend = before - 2 * at + after
    top = middle + np.where(bend < 0, (before - after) / (2 * np.where(bend < 0, bend, -1.0)), best - middle)
    place = np.clip(np.where(np.abs(top - best) <= 1, top, best), 0, count - 1)
    greatest, error = (np.take_along_axis(each, best[None], 0)[0] for each in (contrasts, errors))
    known = (greatest > CLEAR * np.maximum(contrasts, 0).mean(axis=0)) & (greatest > CERTAIN * error)
    place = _fill_unknown(place, known)
    low = np.minimum(place.astype(int), count - 2)
    share = (place - low)[..., None]
    chosen = [np.take_along_axis(pictures, (low + side)[None, ..., None], 0)[0] for side in (0, 1)]
    return image, (1 - share) * chosen[0] + share * chosen[1], place, known


def _fill_unknown(place: Plane, known: NDArray[np.bool_]) -> Plane:
    """Return places with those that are not known taken from the mean of those around that are."""
    filled, there = np.where(known, place, 0.0), known.copy()
    for reach in _SPREADS:
        if there.all():
            break
        weight = _box_mean(known.astype(np.float64), reach)
        mean = _box_mean(np.where(known, place, 0.0), reach) / np.maximum(weight, 1e-12)
        new = ~there & (weight > LEAST_SHARE)
        filled, there = np.where(new, mean, filled), there | new
    return np.where(there, filled, np.median(place[known]) if known.any() else 0.0)


# Pictures through parts of the opening: what dual pixels, phase-detect pixels and focusing screens see.
#
# A mask in the plane of the stop takes the place of the camera's own opening, so that all that a render has goes
# through it. Pictures are as bright as through the whole opening, but for what a part loses beyond its edge.

CELLS = 512  # of a mask across the opening
_PHASE_ROWS, _PHASE_COLUMNS = 8, 4  # pixels from one phase-detect pixel of a half to the next
_WEDGE_F, _EYE_F = 8.0, 16.0  # the cone of light at whose edge wedges look, and the one that the eye takes in
SPLIT, _COLLAR = 1 / 8, 5 / 24  # of the film's height: diameters of the split image and the microprisms round it
_FACET = 1 / 240  # of it: side of a microprism
_LEAST_FACET_PX = 4
MOST_MORE = 64  # times the samples of the picture that a wedge takes at most
HALVES = {"x": ((-1.0, 0.0), (1.0, 0.0)), "y": ((0.0, -1.0), (0.0, 1.0))}
_WEDGES = ((-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0))


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
    first, middle = _PHASE_ROWS // 2, _PHASE_COLUMNS // 2
    for image, start in ((before, 0), (beyond, middle)):
        pixels[first::_PHASE_ROWS, start::_PHASE_COLUMNS] = image.pixels[first::_PHASE_ROWS, start::_PHASE_COLUMNS] / 2
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
    facet = max(_FACET * height, _LEAST_FACET_PX)
    across, down = (np.mod(place, facet) - facet / 2 for place in (x, y))
    sideways, reach = np.abs(across) > np.abs(down), np.hypot(x, y) * 2 / height
    collar = (reach > SPLIT) & (reach <= _COLLAR)
    places = (
        ((reach <= SPLIT) & (y < 0)) | (collar & sideways & (across < 0)),
        ((reach <= SPLIT) & (y >= 0)) | (collar & sideways & (across >= 0)),
        collar & ~sideways & (down < 0),
        collar & ~sideways & (down >= 0),
    )
    side_px = min(math.ceil(_COLLAR * height / 2), width // 2)
    rows, columns = (slice((side - 1) // 2 - side_px, side // 2 + side_px + 1) for side in (height, width))
    rows, columns = slice(max(rows.start, 0), rows.stop), slice(max(columns.start, 0), min(columns.stop, width))
    crop = columns.start / width, columns.stop / width, rows.start / height, rows.stop / height
    within = pixels[rows, columns]
    for side, place in zip(_WEDGES, places, strict=True):
        towards = side[0] * f_number / _WEDGE_F, side[1] * f_number / _WEDGE_F
        seen, here = openings.disc(towards, f_number / _EYE_F, crop), place[rows, columns]
        within[here] = 0.0 if seen is None else seen.pixels[here]
    return replace(image, pixels=pixels, layers={})


# Contact sheets: developed pictures in a grid, each with its label.

WIDTH_PX = 320  # of a picture at most
GAP_PX, TEXT_PX = 8, 14
PAPER, INK = (24, 24, 24), (230, 230, 230)


def contact_sheet(pictures: Sequence[tuple[str, Image]], columns: int) -> Picture:
    """Return a sheet of pictures with their labels below, row after row.

    Parameters
    ----------
    pictures
        Label, of one or more lines, and image of each.
    columns
        Pictures in a row.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    small = [(label, _small(image)) for label, image in pictures]
    width = max(max(picture.width for _, picture in small), 160)
    height = max(picture.height for _, picture in small)
    font = ImageFont.load_default(TEXT_PX)
    lines = max(len(label.splitlines()) for label, _ in small)
    across, down = width + GAP_PX, height + (lines + 1) * TEXT_PX + GAP_PX
    rows = -(-len(small) // columns)
    sheet = Pillow.new("RGB", (columns * across + GAP_PX, rows * down + GAP_PX), PAPER)
    draw = ImageDraw.Draw(sheet)
    for index, (label, picture) in enumerate(small):
        x, y = GAP_PX + index % columns * across, GAP_PX + index // columns * down
        sheet.paste(picture, (x + (width - picture.width) // 2, y))
        for number, line in enumerate(label.splitlines()):
            while draw.textlength(line, font) > width and len(line) > 1:
                line = f"{line.rstrip('…')[:-1]}…"
            place = (x + width / 2, y + height + TEXT_PX // 4 + number * TEXT_PX)
            draw.text(place, line, INK, font, anchor="ma")
    return sheet


def _small(image: Image) -> Picture:
    from PIL import Image as Pillow

    codes = np.asarray(development.quantise(image.developed(), 8))
    picture = Pillow.fromarray(codes)
    scale = min(WIDTH_PX / image.width, 1.0)
    if scale == 1.0:
        return picture
    return picture.resize((WIDTH_PX, max(round(image.height * scale), 1)), Pillow.Resampling.BOX)


# Sweeps: one picture for each combination of values of some keys of a scene, and a table of measures.

MOST_ENTRIES = 10_000
SHEET, TABLE = "contact_sheet.png", ("table.csv", "table.json")


@dataclass(frozen=True, eq=False)
class SweepEntry:
    """One combination of a sweep.

    Attributes
    ----------
    values : dict
        Of the keys that the sweep varies.
    measures : dict
        ``mean`` luminance of the film; ``noise``, the relative standard error of the picture; ``spp``, the mean of all
        pixels; ``seconds`` of rendering; ``mtf50`` [cycles per pixel] where there is an edge at the point that was
        given.
    image : Image
        The picture; one that was kept from an earlier run has no layers.
    kept : bool
        Whether it was.
    file : Path or None
        Of the film.
    """

    values: dict[str, Any]
    measures: dict[str, Any]
    image: Image
    kept: bool
    file: Path | None

    @property
    def label(self) -> str:
        """The values as people read them."""
        return ", ".join(self._lines)

    @property
    def _lines(self) -> list[str]:
        return [f"{key.rpartition('.')[2]} {_format_value(value)}" for key, value in self.values.items()]


Pictures = Callable[[Mapping[int, Scene]], Iterable[tuple[int, Image]]]
"""Renders scenes by number, in any order."""


@dataclass(frozen=True)
class _Combination:
    """Values of a sweep and their scene; the film is kept under a name that follows from all that decides it."""

    values: dict[str, Any]
    scene: Scene
    key: str
    name: str
    folder: Path | None
    mtf_at: tuple[float, float] | None

    @property
    def file(self) -> Path | None:
        """The film, where one is kept."""
        return None if self.folder is None else self.folder / f"{self.name}.exr"

    def read(self, same: OneMaker) -> SweepEntry | None:
        """The entry of an earlier run; None where there is none that is whole.

        Raises
        ------
        StateError
            It was made by other code than what the sweep has already.
        """
        if self.file is None:
            return None
        try:
            saved = json.loads(self.file.with_suffix(".json").read_text("utf-8"))
            if saved["key"] != self.key:
                return None
            image = read_film(self.file)
            if image.metadata.get("picture_hash") != self.scene.picture_hash():
                return None
            entry = SweepEntry(
                self.values, saved["measures"], with_picture_settings(image, self.scene.picture), True, self.file
            )
        except (OSError, ValueError, KeyError, TypeError, RptcamError):
            return None
        same.add(str(self.file), image.metadata.get("made_by"))
        return entry

    def keep(self, image: Image) -> SweepEntry:
        """Measure a picture, and keep it: the film first, so that measures without a film cannot be."""
        achieved = image.stats.get("numerics", {}).get("noise")  # a worker's picture comes without
        luminance = image.luminance
        measures = {
            "mean": float(luminance.mean(dtype=np.float64)),
            "noise": None if achieved is None else achieved["picture"],
            "spp": image.metadata.get("spp_mean", image.metadata["spp"]),
            "seconds": _seconds(image),
        } | ({} if self.mtf_at is None else {"mtf50": mtf50_at(luminance, *self.mtf_at)})
        if self.file is not None:
            image.save(resolve_links(self.file))
            try:
                with replacing(resolve_links(self.file.with_suffix(".json"))) as temporary:
                    temporary.write_text(json.dumps({"key": self.key, "measures": measures}), encoding="utf-8")
            except StateError:
                self.file.unlink(missing_ok=True)  # as on a full disk
                raise
        return SweepEntry(self.values, measures, image, False, self.file)


def sweep(
    scene: SceneSource,
    over: Mapping[str, Sequence[Any]],
    folder: str | Path | None = None,
    *,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    mtf_at: tuple[float, float] | None = None,
    device: Wanted = None,
    pictures: Pictures | None = None,
    allow_mixed: bool = False,
) -> Iterator[SweepEntry]:
    """Return an iterator over the pictures of all combinations of values, the last key's changing first.

    All scenes are checked before the first is rendered. With a folder, each film and its measures are kept there, and
    rendered again only when something that decides them has changed; at the end follow a table and a contact sheet.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
    over
        Values of each key path: ``{"camera.f_number": [2, 4, 8], "camera.lens": ["dgauss-50mm", "triplet-50mm"]}``.
    folder
        Where to keep the films; made if it is missing.
    spp, size, seed, device
        As for `render`.
    pictures
        Renders those that are missing, in place of this process: takes scenes by number, and returns an iterator over
        numbers and images in any order, as `rptcam_cl.batch.cluster_run.render_scenes_on_cluster` does.
    mtf_at
        Where an edge is to be measured, in fractions of the picture from the left and the top.
    allow_mixed
        Whether pictures of the folder that other code, another numpy or another driver has made are kept beside new
        ones, with a warning.

    Raises
    ------
    InputError
        A key or a value is wrong, with the combination that it belongs to.
    StateError
        The folder cannot be written, or holds pictures that other code has made.
    """
    place = None if folder is None else Path(folder)
    applied = RenderOptions(spp=spp, size=size, seed=seed).apply_to(read_scene(scene))
    planned = _plan(applied, over, place, mtf_at)
    if place is not None:
        check_writable(make_folder(place) / SHEET)
    return _entries(planned, place, device, pictures, OneMaker(allow_mixed))


def _plan(
    scene: Scene, over: Mapping[str, Sequence[Any]], folder: Path | None, mtf_at: tuple[float, float] | None
) -> list[_Combination]:
    """Check every combination with its scene."""
    if not over:
        raise InputError("over: no key to vary (allowed: as camera.f_number=2,4,8)")
    for path, choices in over.items():
        if isinstance(choices, str) or not choices:
            raise InputError(f"over: {path}: has no list of values (got {choices!r}; allowed: as [2, 4, 8])")
    if mtf_at is not None and not all(0 <= share <= 1 for share in mtf_at):
        raise InputError(f"mtf_at: is no point of the picture (got {mtf_at}; allowed: two numbers in 0..1)")
    if (count := math.prod(len(values) for values in over.values())) > MOST_ENTRIES:
        raise InputError(f"over: {count} combinations are too many (allowed: {MOST_ENTRIES})")
    planned: dict[str, _Combination] = {}
    for combination in itertools.product(*over.values()):
        values = dict(zip(over, combination, strict=True))
        title = ", ".join(f"{key}={_format_value(value)}" for key, value in values.items())
        with name_errors(title):
            changed = set_keys(scene, values)
            development.check_sensor(changed, *window(changed)[2:])
            if changed.lens_source() is not None:
                focus_drive(changed)  # whether the lens opens so far
        facts = [__version__, changed.picture_hash(), changed.render.most_spp, list(mtf_at or ())]
        if changed.render.layers:
            facts += [list(changed.render.layers), changed.render.layers_spp]
        key = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]
        slug = re.sub(r"[^A-Za-z0-9.+-]+", "_", title.replace("=", "-"))[:80]
        if key in planned:
            raise InputError(f"{title}: is the same picture as {planned[key].name} (leave one of them out)")
        planned[key] = _Combination(values, changed, key, f"{slug}-{key}", folder, mtf_at)
    return list(planned.values())


def _format_value(value: Any) -> str:
    """Return a value on a label."""
    return f"{value:.6g}" if isinstance(value, float) else value if isinstance(value, str) else json.dumps(value)


def _entries(
    planned: Sequence[_Combination], folder: Path | None, device: Wanted, pictures: Pictures | None, same: OneMaker
) -> Iterator[SweepEntry]:
    """Render what is not there yet; write table and sheet at the end."""
    sessions: list[Any] = []
    series: SeriesRenderer | None = None
    rows, thumbnails = [], []
    made = {} if pictures is None else _render_elsewhere(planned, pictures, same)
    for number, plan in enumerate(planned):
        entry = made.pop(number, None) or plan.read(same)
        if entry is None:
            sessions = sessions or open_sessions(device)[0]
            same.add("this program", made_by(session.info.driver for session in sessions))
            series = series or (SeriesRenderer(sessions[0]) if len(sessions) == 1 else None)
            image = render(plan.scene, device=device) if series is None else series.render(plan.scene)
            entry = plan.keep(image)
        if folder is not None:
            rows.append(entry.values | entry.measures | {"file": entry.file.name if entry.file else None})
            thumbnails.append(("\n".join(entry._lines), entry.image))
        yield entry
    if folder is not None:
        _write_tables(folder, rows)
        columns = len({json.dumps(list(plan.values.values())[-1]) for plan in planned})
        with replacing(resolve_links(folder / SHEET)) as temporary:
            contact_sheet(thumbnails, columns).save(temporary, format="png")


def _render_elsewhere(planned: Sequence[_Combination], pictures: Pictures, same: OneMaker) -> dict[int, SweepEntry]:
    """Render what is not there yet, each kept as it comes; the entries by number."""
    missing = {number: plan.scene for number, plan in enumerate(planned) if plan.read(same) is None}
    made = {}
    for number, image in pictures(missing):
        same.add(planned[number].name, image.metadata["made_by"])
        made[number] = planned[number].keep(image)
    return made


def _seconds(image: Image) -> float:
    """Return how long an image took to render, here or by a worker [s]."""
    if "cluster" in image.stats:
        return float(sum(row["seconds"] for row in image.stats["cluster"]["workers"].values()))
    return float(image.stats["seconds"]["render"])


def _write_tables(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(
            {key: _format_value(value) if isinstance(value, list | dict) else value for key, value in row.items()}
        )
    for name, content in zip(TABLE, (text.getvalue(), json.dumps(rows, indent=2) + "\n"), strict=True):
        with replacing(resolve_links(folder / name)) as temporary:
            temporary.write_text(content, encoding="utf-8")


# Sharpness at an edge in a picture: MTF by the slanted edge.
#
# The method of ISO 12233, without its corrections for chart angles: pixels around the point are sorted by their
# distance from the edge, which gives the edge's profile at a quarter of a pixel; its derivative is the line spread,
# whose Fourier transform is the MTF in the direction across the edge.

_BINS_PER_PIXEL = 4
_REACH_PX = 20  # of the region around the point, on each side
_SPAN_PX = 24  # of the profile, across the edge
_LEAST_SLANT = 0.02  # of the edge against rows and columns, or its profile has gaps
LEAST_CONTRAST = 0.1  # (bright - dark) / (bright + dark) of both sides

_WHOLE_STEP = 0.8  # of the largest step of a row: others the edge leaves at a side


def mtf50_at(luminance: NDArray[np.floating], x: float, y: float) -> float | None:
    """Return the frequency at which the contrast of the edge at a point has fallen to a half [cycles per pixel].

    Parameters
    ----------
    luminance : (height, width) array
        Linear.
    x, y
        The point, in fractions of width and height from the left and the top.

    Returns
    -------
    float or None
        None where there is no single straight edge of some contrast, slanted against rows and columns.
    """
    profile = _profile(np.asarray(luminance, np.float64), x, y)
    if profile is None:
        return None
    spread = np.gradient(profile) * _window(len(profile))
    response = np.abs(np.fft.rfft(spread, 8 * len(spread)))
    if response[0] <= 0:
        return None
    frequency = np.fft.rfftfreq(8 * len(spread), 1 / _BINS_PER_PIXEL)
    # bins average over their width, and the difference of neighbours over twice that
    mtf = response / response[0] / (np.sinc(frequency / _BINS_PER_PIXEL) * np.sinc(2 * frequency / _BINS_PER_PIXEL))
    below = int(np.argmax(mtf < 0.5))
    if below == 0:
        return None
    ahead = (mtf[below - 1] - 0.5) / (mtf[below - 1] - mtf[below])
    return float(frequency[below - 1] + ahead * (frequency[below] - frequency[below - 1]))


def _window(length: int) -> Plane:
    """Return a window that is flat in its inner half and falls by cosines to its ends (Tukey), to keep noise out."""
    across = np.abs(np.linspace(-1, 1, length))
    return np.asarray(np.where(across <= 0.5, 1.0, 0.5 * (1 + np.cos(2 * np.pi * (across - 0.5)))))


def _profile(values: Plane, x: float, y: float) -> Plane | None:
    """Return the mean of the pixels by their distance from the edge; None where there is no edge."""
    height, width = values.shape
    row, column = min(int(y * height), height - 1), min(int(x * width), width - 1)
    rows = slice(max(row - _REACH_PX, 0), row + _REACH_PX + 1)
    columns = slice(max(column - _REACH_PX, 0), column + _REACH_PX + 1)
    region = values[rows, columns]
    if min(region.shape) < _REACH_PX:
        return None
    down, across = (float(np.abs(np.diff(region, axis=axis)).sum()) for axis in (0, 1))
    level = down > across  # the edge is nearer to a row than to a column
    distance = _distance(region.T if level else region)
    if distance is None:
        return None
    distance = distance.T if level else distance
    bins = np.floor((distance + _SPAN_PX / 2) * _BINS_PER_PIXEL).astype(np.int64)
    count = _SPAN_PX * _BINS_PER_PIXEL
    inside = (bins >= 0) & (bins < count)
    number = np.bincount(bins[inside], minlength=count)
    if not number.all():
        return None
    profile = np.bincount(bins[inside], region[inside], minlength=count) / number
    first, last = profile[: count // 8].mean(), profile[-(count // 8) :].mean()
    if abs(last - first) < LEAST_CONTRAST * abs(last + first):
        return None
    return np.asarray(profile)


def _distance(region: Plane) -> Plane | None:
    """Return how far each pixel is from an edge that crosses the rows; None where it is not slanted or there is none.

    The edge is the straight line through the centroids of the rows' derivatives.
    """
    steps = np.diff(region, axis=1)
    rises = steps.sum(axis=1)
    if not np.isfinite(rises).all() or not (largest := np.abs(rises).max()) > 0:
        return None
    crossed = np.abs(rises) > _WHOLE_STEP * largest
    rows = np.flatnonzero(crossed)
    if len(rows) < _REACH_PX / 2:
        return None
    centroids = steps[crossed] @ (np.arange(steps.shape[1]) + 0.5) / rises[crossed]
    slope, start = np.polyfit(rows, centroids, 1)
    if abs(slope) < _LEAST_SLANT:
        return None
    y, x = np.mgrid[: region.shape[0], : region.shape[1]].astype(np.float64)
    return np.asarray((x - start - slope * y) / math.hypot(1.0, slope))
