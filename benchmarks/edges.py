"""Rendered edges with diffraction against the full wave transfer: ``python -m benchmarks.edges``.

An edge a kilometre away is rendered on and off the axis, across the field and along it, and its modulation is taken by
the slanted-edge method. The truth is the transfer of the pupil function, as ``rptcam lens mtf --diffraction`` has it,
over the wavelengths that make green.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from numpy.typing import NDArray

import rptcam_cl
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.beams import Beam
from rptcam_cl.optics.lens import Lens
from rptcam_cl.optics.waves import pupil_function, transfer
from rptcam_cl.rendering.cameras.chief_rays import seen_places
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.point_spread import WAVES_NM, shares_of_white

Array = NDArray[np.float64]

AWAY_M, PIXEL_MM, WINDOW_PX, SPP = 1000.0, 0.0015, 96, 256
FILM_MM = (36.0, 24.0)
PER_MM = np.array([10.0, 20.0, 40.0, 60.0, 80.0])
SLANT = math.radians(5.0)


def scene_of(lens: str, f_number: float, degrees: float, along: bool, diffraction: str) -> dict[str, object]:
    """A scene of an edge at a field angle, upright or, with ``along``, level."""
    middle = AWAY_M * np.array([0.0, math.tan(math.radians(degrees)), -1.0])
    turn = SLANT + (math.pi / 2 if along else 0.0)
    side = 20.0 * np.array([math.cos(turn), math.sin(turn), 0.0])
    rise = 20.0 * np.array([-math.sin(turn), math.cos(turn), 0.0])
    lamp = {"shape": "rectangle", "corner": (middle - rise / 2).tolist(), "edge_u": side.tolist(),
            "edge_v": rise.tolist(), "material": {"kind": "emissive", "radiance": 1.0}}  # fmt: skip
    camera = {"kind": "realistic", "lens": lens, "f_number": f_number, "focus": {"distance_m": AWAY_M},
              "diffraction": diffraction, "eye": [0, 0, 0], "target": [0, 0, -1], "up": [0, 1, 0]}  # fmt: skip
    pixels = [round(side / PIXEL_MM) for side in FILM_MM]
    film = {"width_mm": FILM_MM[0], "resolution": pixels}
    data: dict[str, object] = {
        "camera": camera, "film": film, "objects": [lamp], "spectrum": {"mode": "dispersive", "lens": "on"},
        "render": {"spp": SPP, "max_depth": 1}, "exposure": {"mode": "irradiance"},
    }  # fmt: skip
    chief = camera_of(rptcam_cl.load_scene(data)).chief_rays()
    place = seen_places(chief, np.append(middle, 1.0)[None])[0]
    low = np.floor(place - WINDOW_PX / 2)
    crop = [low[0] / pixels[0], (low[0] + WINDOW_PX) / pixels[0], low[1] / pixels[1], (low[1] + WINDOW_PX) / pixels[1]]
    return data | {"film": film | {"crop": [float(each) for each in crop]}}


def modulation(film: Array, along: bool) -> Array:
    """The modulation at `PER_MM` of an edge in a square picture, by the derivative of its profile (ISO 12233)."""
    film = film.T if along else film
    rows, columns = np.mgrid[: len(film), : len(film)] - (len(film) - 1) / 2
    steps = np.abs(np.diff(film, axis=1))
    at = (steps * (columns[:, :-1] + 0.5)).sum(axis=1) / steps.sum(axis=1)
    slope, start = np.polyfit(rows[:, 0], at, 1)
    across = (columns - start - slope * rows) / math.hypot(1.0, slope)
    inside = np.abs(across) < WINDOW_PX * 0.42
    bins = np.floor((across[inside] + WINDOW_PX * 0.42) * 2).astype(int)
    profile = np.bincount(bins, film[inside]) / np.bincount(bins)
    line, step = np.diff(profile), PIXEL_MM / 2
    turned = np.exp(-2j * np.pi * np.outer(PER_MM, np.arange(len(line)) * step))
    blurred = np.sinc(PER_MM * PIXEL_MM) * np.sinc(PER_MM * step) ** 2
    return np.asarray(np.abs(turned @ line) / abs(line.sum()) / blurred)


def by_waves(lens: Lens, back: float, degrees: float, along: bool) -> Array:
    """The modulation of the full wave optics, over the wavelengths of green; all in one place of the film."""
    beam, shares = Beam(degrees, AWAY_M * 1e3), shares_of_white(WAVES_NM)[::2, 1]
    pupils = [pupil_function(lens, back, beam, nm) for nm in WAVES_NM[::2]]
    values = [transfer(pupil, PER_MM)[0 if along else 1] for pupil in pupils]
    return np.asarray(np.abs(np.tensordot(shares / shares.sum(), values, 1)))


def errors(lens: str, f_number: float, degrees: float, along: bool, diffraction: str = "on") -> tuple[Array, Array]:
    """The modulation of a rendered edge, and of the waves."""
    scene = rptcam_cl.load_scene(scene_of(lens, f_number, degrees, along, diffraction))
    found, setting = rptcam_cl.render(scene).pixels[..., 1], camera_of(scene).setting
    assert setting is not None
    exact = by_waves(setting.lens, setting.film_distance_mm, degrees, along)
    return modulation(found.astype(np.float64), along), exact


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lenses", default="dgauss-50mm,wide-22mm,tessar-100mm")
    parser.add_argument("--f-numbers", default="5.6,8,11,16")
    parser.add_argument("--degrees", default="0,8,12")
    parser.add_argument("--off", action="store_true")
    given = parser.parse_args()
    for lens in given.lenses.split(","):
        for f_number in map(float, given.f_numbers.split(",")):
            for degrees in map(float, given.degrees.split(",")):
                for along in (False, True):
                    try:
                        found, exact = errors(lens, f_number, degrees, along, "off" if given.off else "on")
                    except InputError as problem:  # that field lies beside the film
                        print(lens, f_number, degrees, along, problem, flush=True)
                        continue
                    print(lens, f_number, degrees, along, np.round(exact, 3), np.round(found - exact, 3), flush=True)


if __name__ == "__main__":
    main()
