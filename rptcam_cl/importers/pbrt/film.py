"""Film, sampler and integrator of pbrt as film and render settings of ours."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.importers.pbrt.context import Context
from rptcam_cl.importers.pbrt.parameters import Parameters
from rptcam_cl.importers.pbrt.state import Entity

DEFAULT_DIAGONAL_MM = 35.0
DEFAULT_SAMPLES = 16
DEFAULT_DEPTH = 5
# Film parameters that name or store the picture.
STORAGE = ("filename", "savefp16", "coordinatesystem")
# Sampler parameters that change the pattern of samples, not their number.
PATTERNS = ("jitter", "seed", "randomization", "dimensions", "samplepixelcenter")
LIGHT_CHOICE = ("lightsamplestrategy", "lightsampler", "rrthreshold")


@dataclass(frozen=True)
class Raster:
    """The pixels of a film.

    Attributes
    ----------
    width, height : int
        Of the whole film.
    window : tuple of int
        The pixels to render: first and past-the-last column, first and past-the-last row, from the top left.
    """

    width: int
    height: int
    window: tuple[int, int, int, int]

    def widened(self, across: int, down: int) -> Raster:
        """Return a larger film of which this one is a part, whose middle lies off its own.

        Parameters
        ----------
        across, down
            By how many half pixels the middle of this film lies right of and above that of the larger one.
        """
        left, top = (across + abs(across)) // 2, (abs(down) - down) // 2
        x0, x1, y0, y1 = self.window
        window = (x0 + left, x1 + left, y0 + top, y1 + top)
        return replace(self, width=self.width + abs(across), height=self.height + abs(down), window=window)

    def keys(self) -> dict[str, Any]:
        """Return the keys of a film."""
        found: dict[str, Any] = {"resolution": [self.width, self.height]}
        if self.window != (0, self.width, 0, self.height):
            sides = (self.width, self.width, self.height, self.height)
            found["crop"] = [pixel / side for pixel, side in zip(self.window, sides, strict=True)]
        return found


def raster_of(context: Context, film: Entity | None) -> Raster:
    """Return the pixels of a film; pbrt's default is 1280 x 720."""
    if film is None:
        return Raster(1280, 720, (0, 1280, 0, 720))
    parameters = film.parameters
    width, height = parameters.integer("xresolution", 1280), parameters.integer("yresolution", 720)
    if width < 1 or height < 1:
        raise film.place.error(f"{film.what}: the resolution must be at least 1 x 1 (got {width} x {height})")
    crop = parameters.numbers("cropwindow")
    bounds = parameters.numbers("pixelbounds", "integer", "float")
    if crop is not None and len(crop) == 4:
        sides = np.array([width, width, height, height])
        bounds = np.ceil(np.clip(np.stack([crop[:2], crop[2:]]), 0, 1).reshape(-1) * sides - 1e-9)
    if bounds is None:
        return Raster(width, height, (0, width, 0, height))
    if len(bounds) != 4 or (crop is not None and len(crop) != 4):
        raise film.place.error(f"{film.what}: a window needs 4 numbers, x0 x1 y0 y1")
    x0, x1, y0, y1 = (int(value) for value in np.clip(bounds, 0, [width, width, height, height]))
    if x0 >= x1 or y0 >= y1:
        raise film.place.error(f"{film.what}: the window to render is empty")
    return Raster(width, height, (x0, x1, y0, y1))


def diagonal_mm(film: Entity | None) -> float:
    """Return the diagonal of the film [mm], of use to lens cameras only."""
    return DEFAULT_DIAGONAL_MM if film is None else film.parameters.number("diagonal", DEFAULT_DIAGONAL_MM)


def exposure_ev(context: Context, film: Entity | None, camera: Entity) -> float:
    """Return by how many stops pbrt brightens what its film records.

    pbrt-v3 has a factor ``scale``; the sensor of pbrt-v4 multiplies by exposure time x ISO / 100. Our linear film has
    neither, the tone-mapped picture takes them as ``picture.ev``.
    """
    shutter = camera.parameters.number("shutterclose", 1.0) - camera.parameters.number("shutteropen", 0.0)
    if film is None:
        return 0.0
    parameters = film.parameters
    parameters.skip(*STORAGE)
    factor = parameters.number("scale", 1.0)
    name = "scale"
    if context.scene.version == 4:
        factor, name = parameters.number("iso", 100.0) / 100 * shutter, "sensor (exposure time x ISO / 100)"
        sensor = parameters.text("sensor", "cie1931")
        if sensor != "cie1931":
            context.report.ignored(film.place, f'the sensor "{sensor}": its colours and its imaging ratio')
    if not factor > 0 or factor == 1:
        return 0.0
    context.report.approximated(
        film.place, f"the film's {name} of {factor:g} goes to picture.ev; the linear film is not scaled"
    )
    return math.log2(factor)


def render_keys(context: Context) -> dict[str, Any]:
    """Return samples per pixel and path depth."""
    options = context.scene.options
    keys = {"spp": DEFAULT_SAMPLES, "max_depth": DEFAULT_DEPTH + 1}
    if (sampler := options.get("Sampler")) is not None:
        sampler.parameters.skip(*PATTERNS)
        keys["spp"] = _samples(sampler.kind, sampler.parameters)
        if keys["spp"] < 1:
            raise sampler.place.error(f"{sampler.what}: needs at least 1 sample per pixel (got {keys['spp']})")
    if (integrator := options.get("Integrator")) is not None:
        _note_integrator(context, integrator)
        depth = integrator.parameters.integer("maxdepth", DEFAULT_DEPTH)
        if depth < 0:
            raise integrator.place.error(f"{integrator.what}: maxdepth must not be negative (got {depth})")
        keys["max_depth"] = depth + 1  # pbrt counts bounces, we count edges with the camera's
    return keys


def _samples(kind: str, parameters: Parameters) -> int:
    if kind == "stratified":
        return parameters.integer("xsamples", 4) * parameters.integer("ysamples", 4)
    return parameters.integer("pixelsamples", DEFAULT_SAMPLES)


def _note_integrator(context: Context, integrator: Entity) -> None:
    integrator.parameters.skip(*LIGHT_CHOICE)
    kinds = {
        "path": None,
        "volpath": "paths without media",
        "bdpt": "paths from the camera only",
        "mlt": "paths from the camera only",
        "sppm": "paths from the camera only",
        "lightpath": "paths from the camera only",
        "simplepath": None,
        "simplevolpath": "paths without media",
    }
    if integrator.kind not in kinds:
        context.report.approximated(
            integrator.place, f"{integrator.what} is another picture than paths of light give, which we compute"
        )
    elif (how := kinds[integrator.kind]) is not None:
        context.report.approximated(integrator.place, f"{integrator.what}: {how}")
