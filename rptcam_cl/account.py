"""What a render tells of itself: statistics for programs that measure, and metadata for the files of the picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from rptcam_cl._version import __version__
from rptcam_cl.cameras import camera_geometry
from rptcam_cl.numerics import LensMargin, self_knowledge, summary
from rptcam_cl.plan import Plan
from rptcam_cl.scene import Scene
from rptcam_cl.wavefront import AnyWavefront, Rendering, SharedWavefront
from rptcam_cl.wavefront.film import FilmLayout
from rptcam_cl.wavefront.parts import is_shared

# What the statistics repeat of the metadata, for programs that measure in pictures.
GEOMETRY = (
    "world_from_camera",
    "world_from_camera_at_close",
    "shutter",
    "intrinsics",
    "resolution",
    "window",
    "film_size_mm",
    "near_m",
)


def window(scene: Scene) -> list[int]:
    """Return the part of the film that is rendered: x, y, width and height [pixels]."""
    layout = FilmLayout.of(scene.film)
    return [layout.x, layout.y, layout.width, layout.height]


def statistics(
    plan: Plan, wavefront: AnyWavefront, rendering: Rendering, times: dict[str, float], margin: LensMargin | None
) -> dict[str, Any]:
    """Return what programs that measure read: samples, times, rays, noise and what the picture has lost.

    Parameters
    ----------
    times
        Of the stages of the render [s].
    margin
        What float32 costs in the lens, where it was measured.
    """
    devices = devices_of(wavefront, rendering)
    stats: dict[str, Any] = {
        "samples": int(rendering.samples.sum(dtype=np.uint64)),
        "spp": rendering.spp,
        "seconds": times,
        "msamples_per_second": rendering.new_samples / max(rendering.seconds, 1e-9) / 1e6,
        "device": ", ".join(dict.fromkeys(device["name"] for device in devices)),
        "devices": devices,
        "wave_size": wavefront.capacity,
        "not_finite": wavefront.not_finite(),
        "interrupted": rendering.interrupted,
    }
    if plan.camera.has_lens:
        stats["lens"] = wavefront.outcomes()
    if wavefront.settings.clamp is not None:
        stats["clamp"] = {"limit": wavefront.settings.clamp, "removed_share": wavefront.removed_share()}
    if rendering.noise is not None:
        stats["noise"] = asdict(rendering.noise) | {
            "spp_min": int(rendering.samples.min()),
            "spp_mean": float(rendering.samples.mean()),
        }
    if rendering.resumed_from:
        stats["resumed_from"] = rendering.resumed_from
    stats["numerics"] = self_knowledge(plan, wavefront, rendering, margin)
    return stats


def devices_of(wavefront: AnyWavefront, rendering: Rendering) -> list[dict[str, Any]]:
    """Return what each device has done in this render: id, name, share, samples, seconds and speed."""
    if isinstance(wavefront, SharedWavefront):
        return wavefront.devices()
    info, samples = wavefront.session.info, rendering.new_samples
    speed = samples / max(rendering.seconds, 1e-9) / 1e6
    done = {"samples": samples, "seconds": rendering.seconds, "msamples_per_second": speed}
    return [{"id": info.id, "name": info.name, "share": 1.0, **done}]


def described(
    scene: Scene, plan: Plan, rendering: Rendering, stats: Mapping[str, Any], told: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what a picture's metadata say: of the scene, its camera, and the render that has such statistics.

    ``told`` is what was found before the render: focus, camera model and exposure.
    """
    found = {
        "software": f"rptcam_cl {__version__}",
        "version": __version__,
        "scene_hash": scene.content_hash(),
        "seed": scene.render.seed,
        "spp": rendering.spp,
        "device": stats["device"],
        **({"work": stats["work"]} if is_shared(stats["work"]) else {}),
        "exposure": scene.exposure.mode,
        **{key: value for key, value in plan.camera.metadata.items() if value is not None},
        **plan.spectrum.metadata,
        **camera_geometry(scene),
        "window": window(scene),
        **({"object_names": plan.owners.objects} if "object_id" in rendering.layers else {}),
        **({"material_names": plan.owners.materials} if "material_id" in rendering.layers else {}),
        **told,
        "numerics": summary(stats["numerics"]),
    }
    if "clamp" in stats:
        limit, share = stats["clamp"].values()
        found["clamp"] = f"biased: samples above {limit:g} scaled down, {share:.2%} of the light removed"
    return found
