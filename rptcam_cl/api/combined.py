"""Pictures that several renders of one scene are combined into: focus stacks, and what parts of the opening see."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.job import RenderOptions, SceneSource, SeriesRenderer, read_scene, resolve
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import listed
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.imaging.image import Image, read_film
from rptcam_cl.rendering.cameras.ideal import stop_shape
from rptcam_cl.scene.load import at_rest, change_scene, set_keys
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import Drive, WholeLens, focus_drive
from rptcam_cl.studies.focus.probe import Zone, circle_of_confusion

Plane = NDArray[np.float64]

# Focus stacking: pictures of one scene focused at many distances become one that is sharp throughout, and a depth map.
#
# The method is shape from focus: the modified Laplacian of each picture, and a Gaussian through its greatest value and
# the neighbours (S. Nayar, Y. Nakagawa, Shape from focus, IEEE PAMI 16, 824 (1994)). It needs texture: where there is
# none, the depth is that of what lies around. Each picture consists of two with independent noise, whose Laplacians are
# multiplied, so that noise adds nothing on the average; how far they are apart says what it adds by chance.

MOST_PICTURES = 200
CENTRE = Zone(0.49, 0.51, 0.49, 0.51)
WINDOW = 4  # pixels to either side over which contrast is summed
CLEAR = 2.0  # times the mean over all pictures, by which the greatest contrast says where a pixel is sharp
CERTAIN = 4.0  # standard errors of it by noise
INDEPENDENT = 0.2  # of the pixels of a window: their Laplacians overlap
SPREADS = (2, 4, 8, 16, 32, 64, 128, 256, 512)  # pixels to either side from which depth is taken where there is none
LEAST_SHARE = 0.02  # of those pixels that must have one
FRAME_NODES = 1025  # of the table from the focus of a film that was read to its state


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
    if not 3 <= count <= MOST_PICTURES:
        allowed = f"3 to {MOST_PICTURES}; {needed} leave nothing unsharp between"
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
    places = np.linspace(low, high, FRAME_NODES)
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
    place = _filled(place, known)
    low = np.minimum(place.astype(int), count - 2)
    share = (place - low)[..., None]
    chosen = [np.take_along_axis(pictures, (low + side)[None, ..., None], 0)[0] for side in (0, 1)]
    return image, (1 - share) * chosen[0] + share * chosen[1], place, known


def _filled(place: Plane, known: NDArray[np.bool_]) -> Plane:
    """Return places with those that are not known taken from the mean of those around that are."""
    filled, there = np.where(known, place, 0.0), known.copy()
    for reach in SPREADS:
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
