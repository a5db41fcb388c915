"""What a render knows about its own errors: what was lost, how far it is cut off, how noisy it is."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rptcam_cl.numerics.lens_margin import LensMargin
from rptcam_cl.plan import Plan
from rptcam_cl.plan.albedo import LargestAlbedo
from rptcam_cl.wavefront import AnyWavefront, Rendering
from rptcam_cl.wavefront.precise_lens import traces_in_float64

OTHER_FATES = 0.01  # share of the rays that float32 may send elsewhere; near a rim a few do
LARGEST_ERROR_PX = 0.1  # that float32 may make in a lens


def self_knowledge(
    plan: Plan, wavefront: AnyWavefront, rendering: Rendering, margin: LensMargin | None
) -> dict[str, Any]:
    """Return the numerical part of a picture's statistics; see docs/numerics.md.

    Parameters
    ----------
    margin
        Of the lens as it is traced, where it was measured.
    """
    return {
        "samples_dropped": wavefront.not_finite(),
        "rays_not_converged": wavefront.outcomes()["no_convergence"] if plan.camera.has_lens else 0,
        "truncation": truncation(plan.albedo, wavefront.settings.max_depth),
        "noise": None if rendering.achieved is None else asdict(rendering.achieved),
        f"{'float64' if traces_in_float64(plan.camera) else 'float32'}_lens": None
        if margin is None
        else asdict(margin),
    }


def truncation(albedo: LargestAlbedo, max_depth: int) -> dict[str, Any]:
    """Return how much light paths longer than ``max_depth`` edges could bring at most.

    Every scattering leaves at most the largest albedo rho of what arrives, so that light scattered D times and more is
    at most rho^D / (1 - rho) of the brightest lamp's radiance.
    """
    rho = albedo.value
    if rho is None or rho >= 1.0:
        reason = albedo.reason or "a surface reflects all light"
        return {"max_depth": max_depth, "largest_albedo": rho, "bound": None, "no_bound_because": reason}
    return {"max_depth": max_depth, "largest_albedo": rho, "bound": rho**max_depth / (1.0 - rho)}


def summary(knowledge: dict[str, Any]) -> dict[str, Any]:
    """Return what the picture's metadata should say: what follows from scene and samples alone, not from waves."""
    name, margin = _margin(knowledge)
    return {
        "samples_dropped": knowledge["samples_dropped"],
        "rays_not_converged": knowledge["rays_not_converged"],
        "truncation_bound": knowledge["truncation"]["bound"],
        **({} if margin is None else {f"{name}_lens_px": margin["pixels"], f"{name}_other_fate": margin["other_fate"]}),
    }


def _margin(knowledge: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    """Return in what the lens is traced, and what that costs where it was measured."""
    name = "float64" if "float64_lens" in knowledge else "float32"
    return name, knowledge[f"{name}_lens"]


def anomalies(knowledge: dict[str, Any]) -> list[str]:
    """Return what a strict render must not have met, each in a few words; nothing where all is well."""
    found = []
    if dropped := knowledge["samples_dropped"]:
        found.append(f"{dropped} samples were not finite and were dropped")
    if lost := knowledge["rays_not_converged"]:
        found.append(f"{lost} rays found no point on a surface of the lens")
    name, margin = _margin(knowledge)
    if margin is not None:
        if margin["other_fate"] > OTHER_FATES * margin["rays"]:
            found.append(
                f"{name} sends {margin['other_fate']} of {margin['rays']} rays through the lens elsewhere than the"
                f" float64 reference (allowed: {OTHER_FATES:.0%})"
            )
        if (margin["pixels"] or 0.0) > LARGEST_ERROR_PX:
            found.append(f"{name} errs by {margin['pixels']:.2g} px in the lens (allowed: {LARGEST_ERROR_PX:g} px)")
    return found
