"""Focus stacking: pictures of one scene focused at many distances become one that is sharp throughout, and a depth map.

The method is shape from focus: the sum-modified Laplacian of each picture, and a Gaussian through its greatest value
and the neighbours (S. Nayar, Y. Nakagawa, Shape from focus, IEEE PAMI 16, 824 (1994)). It needs texture: where there is
none, the depth is that of what lies around.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.job import RenderOptions, SceneSource, SeriesRenderer, read_scene
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.imaging.image import Image
from rptcam_cl.scene.load import at_rest, change_scene, set_keys
from rptcam_cl.studies.focus.drives import focus_drive
from rptcam_cl.studies.focus.probe import Zone, circle_of_confusion

Array = NDArray[np.float64]

MOST_PICTURES = 200
CENTRE = Zone(0.49, 0.51, 0.49, 0.51)
WINDOW = 4  # pixels to either side over which contrast is summed
CLEAR = 1.5  # times the mean over all pictures, by which the greatest contrast says where a pixel is sharp
SPREADS = (2, 4, 8, 16, 32, 64, 128, 256, 512)  # pixels to either side from which depth is taken where there is none
LEAST_SHARE = 0.02  # of those pixels that must have one


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
    ends = [drive.coordinate(drive.state_for(distance, CENTRE)) for distance in (far_m, near_m)]
    coarse = max(scene.film.size_m()[0] * 1e3 / scene.film.resolution[0] / circle_of_confusion(scene), 1.0)
    needed = int(np.ceil(abs(ends[1] - ends[0]) / (drive.depth_of_focus * coarse))) + 1
    count = max(needed, 3) if steps is None else steps
    if not 3 <= count <= MOST_PICTURES:
        allowed = f"3 to {MOST_PICTURES}; {needed} leave nothing unsharp between"
        raise InputError(f"steps: is out of range (got {count}; allowed: {allowed})")
    states = [drive.state_at(float(place)) for place in np.linspace(ends[0], ends[1], count)]
    series = SeriesRenderer(device if isinstance(device, Session) else open_session(device))
    distances = [drive.object_distance(state) for state in states]
    stack = _Stack(count)
    image: Image | None = None
    for number, state in enumerate(states):
        if on_picture is not None:
            on_picture(number + 1, count, distances[number] or np.inf)
        focused = change_scene(scene, camera=drive.camera_keys(state))
        image = series.render(focused)
        if number == 0 and (metered := image.metadata.get("metered_cd_m2")) is not None:
            scene = set_keys(scene, {"exposure.lock_cd_m2": metered})
        stack.add(resized(image.pixels.astype(np.float64), drive.image_scale(states[-1], state)))
    assert image is not None
    pixels, place, known = stack.result()
    depth = 1 / np.interp(place, np.arange(count), [1 / (distance or np.inf) for distance in distances])
    about = {"pictures": count, "near_m": near_m, "far_m": far_m, "needed": needed, "known_share": float(known.mean())}
    metadata = {**image.metadata, "focus_stack": about, "layers": ["depth"]}
    return replace(
        image, pixels=pixels.astype(np.float32), metadata=metadata, layers={"depth": depth.astype(np.float32)}
    )


def resized(pixels: Array, scale: float) -> Array:
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


def _summed(values: Array, reach: int) -> Array:
    """Return the mean over a square about each pixel, as far as it lies within the picture."""
    for axis in (0, 1):
        length = values.shape[axis]
        sums = np.concatenate([np.zeros_like(values.take([0], axis)), values.cumsum(axis)], axis)
        high, low = np.minimum(np.arange(length) + reach + 1, length), np.maximum(np.arange(length) - reach, 0)
        shape = [-1 if side == axis else 1 for side in range(values.ndim)]
        values = (sums.take(high, axis) - sums.take(low, axis)) / (high - low).reshape(shape)
    return values


def contrast(pixels: Array) -> Array:
    """Return the sum-modified Laplacian of a picture over its local brightness, summed over a window."""
    light = pixels @ np.array([0.2126, 0.7152, 0.0722])
    padded = np.pad(light, 1, mode="edge")
    middle = padded[1:-1, 1:-1]
    across = np.abs(2 * middle - padded[1:-1, :-2] - padded[1:-1, 2:])
    down = np.abs(2 * middle - padded[:-2, 1:-1] - padded[2:, 1:-1])
    return _summed(across + down, WINDOW) / np.maximum(_summed(light, 4 * WINDOW), 1e-12)


class _Stack:
    """The pictures of a stack, and the contrast of each."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._pictures: list[NDArray[np.float32]] = []
        self._contrasts: list[NDArray[np.float32]] = []

    def add(self, pixels: Array) -> None:
        self._pictures.append(pixels.astype(np.float32))
        self._contrasts.append(contrast(pixels).astype(np.float32))

    def result(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return the sharp picture, the place of each pixel in the stack, and which pixels tell theirs themselves."""
        curves = np.stack(self._contrasts).astype(np.float64)
        best = np.argmax(curves, axis=0)
        middle = np.clip(best, 1, self._count - 2)
        before, at, after = (
            np.log(np.maximum(np.take_along_axis(curves, (middle + side)[None], 0)[0], 1e-12)) for side in (-1, 0, 1)
        )
        bend = before - 2 * at + after
        top = middle + np.where(bend < 0, (before - after) / (2 * np.where(bend < 0, bend, -1.0)), best - middle)
        place = np.clip(np.where(np.abs(top - best) <= 1, top, best), 0, self._count - 1)
        known = curves.max(axis=0) > CLEAR * curves.mean(axis=0)
        place = _filled(place, known)
        low = np.minimum(place.astype(int), self._count - 2)
        share = (place - low)[..., None]
        pictures = np.stack(self._pictures)
        chosen = [np.take_along_axis(pictures, (low + side)[None, ..., None], 0)[0] for side in (0, 1)]
        return (1 - share) * chosen[0] + share * chosen[1], place, known


def _filled(place: Array, known: NDArray[np.bool_]) -> Array:
    """Return places with those that are not known taken from the mean of those around that are."""
    filled, there = np.where(known, place, 0.0), known.copy()
    for reach in SPREADS:
        if there.all():
            break
        weight = _summed(known.astype(np.float64), reach)
        mean = _summed(np.where(known, place, 0.0), reach) / np.maximum(weight, 1e-12)
        new = ~there & (weight > LEAST_SHARE)
        filled, there = np.where(new, mean, filled), there | new
    return np.where(there, filled, np.median(place[known]) if known.any() else 0.0)
