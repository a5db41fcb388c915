"""Focus stacking: pictures of one scene focused at many distances become one that is sharp throughout, and a depth map.

The method is shape from focus: the modified Laplacian of each picture, and a Gaussian through its greatest value and
the neighbours (S. Nayar, Y. Nakagawa, Shape from focus, IEEE PAMI 16, 824 (1994)). It needs texture: where there is
none, the depth is that of what lies around. Each picture consists of two with independent noise, whose Laplacians are
multiplied, so that noise adds nothing on the average; how far they are apart says what it adds by chance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.job import RenderOptions, SceneSource, SeriesRenderer, read_scene
from rptcam_cl.core.errors import InputError
from rptcam_cl.device.session import Session, open_session
from rptcam_cl.imaging.image import Image, read_film
from rptcam_cl.scene.load import at_rest, change_scene, set_keys
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import Drive, WholeLens, focus_drive
from rptcam_cl.studies.focus.probe import Zone, circle_of_confusion

Plane = NDArray[np.float64]

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
    ends = [drive.coordinate(drive.state_for(distance, CENTRE)) for distance in (far_m, near_m)]
    coarse = max(scene.film.size_m()[0] * 1e3 / scene.film.resolution[0] / circle_of_confusion(scene), 1.0)
    needed = int(np.ceil(abs(ends[1] - ends[0]) / (drive.depth_of_focus * coarse))) + 1
    count = max(needed, 3) if steps is None else steps
    if not 3 <= count <= MOST_PICTURES:
        allowed = f"3 to {MOST_PICTURES}; {needed} leave nothing unsharp between"
        raise InputError(f"steps: is out of range (got {count}; allowed: {allowed})")
    states = [drive.state_at(float(place)) for place in np.linspace(ends[0], ends[1], count)]
    distances = [drive.object_distance(state) for state in states]

    def say(number: int) -> None:
        if on_picture is not None:
            on_picture(number + 1, count, distances[number] or np.inf)

    def taken() -> Iterator[tuple[Image, Image]]:
        for number, pair in enumerate(_take_pairs(scene, drive, states, device, say)):
            if on_image is not None:
                mean = np.asarray((pair[0].pixels + pair[1].pixels) / 2, np.float32)
                on_image(number + 1, distances[number] or np.inf, replace(pair[0], pixels=mean))
            yield pair

    about = {"pictures": count, "near_m": near_m, "far_m": far_m, "needed": needed}
    return _stack(taken(), drive, states, about)


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
