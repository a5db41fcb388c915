"""Looks through the two halves of the pupil, with the renderer as a focus probe."""

from __future__ import annotations

import math

import numpy as np

from rptcam_cl.autofocus.drives import LensDrive, stopped
from rptcam_cl.autofocus.half_view import HalfView, places_round
from rptcam_cl.autofocus.phase_match import Halves
from rptcam_cl.autofocus.probe import Zone, ZoneImage
from rptcam_cl.autofocus.renderer import ProbeRenderer
from rptcam_cl.cameras.half_pupil import Split, halved
from rptcam_cl.cameras.lens_setting import LensSetting
from rptcam_cl.cameras.pupil_rays import PupilRays, lens_rays, thin_lens_rays
from rptcam_cl.scene import ThinLensCamera

Margin = tuple[int, int, int, int]
"""Pixels beyond a zone: left, right, above, below."""


class HalfLooks:
    """A probe that can look at a zone through the halves of the pupil."""

    def __init__(self, probe: ProbeRenderer, zone: Zone) -> None:
        self.probe, self.zone = probe, zone

    def rays(self, state: float, stop: float, places: np.ndarray) -> PupilRays:
        """Return the rays of places of the picture in a state."""
        scene, drive = self.probe._seen, self.probe.drive
        if isinstance(drive, LensDrive):
            lens, back_mm = drive.lens_at(state)
            return lens_rays(scene, LensSetting(stopped(lens, stop), back_mm, None, drive._camera), places)
        camera = drive.at(state, stop)
        return thin_lens_rays(scene, camera, places)

    def view(self, state, split, stop=1.0) -> HalfView:
        self.probe.look_at([self.zone])
        x0, x1, y0, y1 = self.probe._pixels_of(self.zone)
        return HalfView.of(self.rays(state, stop, places_round(((x0 + x1) / 2, (y0 + y1) / 2))), split)

    def look(self, state, view, margin: Margin, samples, seed, stop=1.0):
        p = self.probe
        p.look_at([self.zone])
        seen = p._seen
        x0, x1, y0, y1 = p._pixels_of(self.zone)
        W, H = seen.film.resolution
        l, r, t, b = margin
        l, r, t, b = min(l, x0), min(r, W - x1), min(t, y0), min(b, H - y1)
        e = 1e-6
        z = Zone((x0 - l + e) / W, (x1 + r - e) / W, (y0 - t + e) / H, (y1 + b - e) / H)
        p._zones = (z,)
        p.__dict__.pop("_layout", None)
        p._wavefronts.clear()
        camera = p.drive.camera(seen, state, stop, [z])
        images = [p.render(halved(camera, view.line, beyond=be), samples, 2 * seed + be)[0] for be in (False, True)]
        p._zones = ()
        pictures = np.stack([im.luminance.mean(axis=0) for im in images])
        means = pictures.mean(axis=(1, 2))
        noise = np.array([im.variance.mean() for im in images])
        return Halves(pictures / means[:, None, None], noise / means**2, (l, r, t, b))
