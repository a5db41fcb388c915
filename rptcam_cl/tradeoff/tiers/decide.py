"""The cheapest camera model whose error a picture bears."""

from __future__ import annotations

from dataclasses import field, replace
from typing import Any, Literal

from rptcam_cl.cameras import colour_error_px, disperses, lens_setting, lens_tint
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import Accuracy, LensColour, RealisticCamera, Scene, change_scene
from rptcam_cl.tradeoff.tiers.depths import FAR_MM, depth_range_mm
from rptcam_cl.tradeoff.tiers.errors import TierError, fitted_errors, tier_errors
from rptcam_cl.tradeoff.tiers.findings import Findings, described
from rptcam_cl.tradeoff.tiers.tiers import TRAITS, Tier, equivalent, first_order_camera, fitted_to
from rptcam_cl.tradeoff.tiers.truth import Truth

MULTIPLY_ADDS = 25  # of polynomials per surface, up to which they take two thirds of the time (benchmarks/ray_maps.py)
WORTH_FITTING = 1e9  # surfaces that all samples cross: fewer take less time than fitting polynomials
FIRST_ORDER: tuple[Tier, ...] = ("pinhole", "thin_lens", "thick_lens")


@dataclass(frozen=True)
class Decision:
    """The camera model that was chosen, and the numbers behind the choice.

    Attributes
    ----------
    scene : Scene
        With the camera that was chosen, and with `spectrum.lens` set.
    tier : str
    errors : tuple of TierError
        Of every tier that there is for the lens.
    metadata : dict
        What the picture's metadata should say.
    """

    scene: Scene
    tier: Tier
    errors: tuple[TierError, ...] = ()
    metadata: dict[str, Any] = field(default_factory=dict)


def choose_camera(scene: Scene) -> Decision:
    """Return a scene with the cheapest camera whose errors its `camera.accuracy` allows; as it was without that key.

    Whether the lens refracts each wavelength separately follows from the same bounds, where `spectrum` leaves it
    open.
    """
    camera = scene.camera
    if not isinstance(camera, RealisticCamera) or camera.accuracy is None:
        return Decision(scene, "realistic")
    allowed = camera.accuracy
    found = measured(scene)
    lens_colour = _lens_colour(scene, found, allowed)
    tier: Tier | None = next((each.tier for each in found.errors if _within(each, allowed)), None)
    if tier is None:
        found, tier = _polynomials(scene, found, allowed, lens_colour)
    chosen = equivalent(scene, tier)
    if TRAITS[tier].colours:
        chosen = change_scene(chosen, spectrum={"lens": lens_colour})
    found = replace(found, tier=tier, colours=lens_colour if TRAITS[tier].colours else "off")
    return Decision(chosen, tier, found.errors, {"accuracy": described(found, allowed)})


def _lens_colour(scene: Scene, found: Findings, allowed: Accuracy) -> LensColour:
    """Return whether the lens refracts each wavelength separately: as requested, or as the bounds say."""
    if scene.spectrum.lens_colour != "auto":
        return scene.spectrum.lens_colour
    shows = (found.colour_px or 0.0) > allowed.max_error_px or found.tint > allowed.max_illumination_error
    return "on" if shows else "off"


def _polynomials(
    scene: Scene, found: Findings, allowed: Accuracy, lens_colour: LensColour
) -> tuple[Findings, Literal["fitted", "realistic"]]:
    """Return what was found, with the errors of polynomials where requested or worth it, and the choice."""
    camera, (columns, rows) = scene.camera, scene.film.resolution
    requested = isinstance(camera, RealisticCamera) and camera.rays == "fitted"
    surfaces = len(lens_setting(scene).lens.surfaces)
    if not requested and columns * rows * scene.render.spp * surfaces < WORTH_FITTING:
        return found, "realistic"
    try:
        polynomials = fitted_to(scene, colours=lens_colour == "on")
    except InputError:
        return found, "realistic"
    if not requested and polynomials.multiply_adds > MULTIPLY_ADDS * surfaces:
        return found, "realistic"
    errors = fitted_errors(polynomials)
    return replace(found, errors=(*found.errors, errors)), "fitted" if _within(errors, allowed) else "realistic"


def _within(found: TierError, allowed: Accuracy) -> bool:
    return found.worst_px <= allowed.max_error_px and found.worst_illumination <= allowed.max_illumination_error


def measured(scene: Scene) -> Findings:
    """Return what the lens of a scene shows, and the errors of the cheaper models that there are in its place."""
    try:
        first = first_order_camera(scene)
    except InputError as problem:
        return _colour_alone(scene, str(problem))
    truth = Truth.of(scene, first)
    depths = _depths(scene, truth)
    missing = {tier: _missing(scene, tier) for tier in FIRST_ORDER}
    tiers = [tier for tier in FIRST_ORDER if not missing[tier]]
    blur_px, far = max(truth.blur_px(depths)), depths[-1]
    return Findings(
        errors=tuple(tier_errors(truth, depths, tiers)),
        reason="" if tiers else missing["thick_lens"],
        depths_m=(depths[0] * 1e-3, far * 1e-3 if far < FAR_MM else None),
        blur_px=blur_px,
        shape_px=truth.round_stop.apart * blur_px if truth.round_stop.apart else None,
        colour_px=max(truth.colour_px(depths)) if truth.coloured else None,
        tint=truth.tint,
    )


def _missing(scene: Scene, tier: Tier) -> str:
    """Return why the lens of a scene has no equivalent of a tier; nothing where it has."""
    try:
        equivalent(scene, tier)
    except InputError as problem:
        return str(problem)
    return ""


def _colour_alone(scene: Scene, reason: str) -> Findings:
    """Return what is known of a lens that no cheaper model stands for: how far off its colours are in focus."""
    setting = lens_setting(scene)
    if scene.spectrum.lens_colour == "off" or not disperses(setting.lens):
        return Findings(reason=reason)
    nm = setting.camera.wavelength_nm
    colour_px = colour_error_px(setting.lens, setting.film_distance_mm, setting.focus_distance_mm, scene.film, nm)
    return Findings(reason=reason, colour_px=colour_px, tint=lens_tint(scene, setting))


def _depths(scene: Scene, truth: Truth) -> list[float]:
    """Return the distances ahead of the film at which errors are measured [mm]: both ends of what is seen, and the
    plane in focus."""
    setting = truth.first.setting
    ends = depth_range_mm(scene, truth.view)
    focus = setting.focus_distance_mm
    inside = [] if focus is None else [min(focus, FAR_MM)]
    return sorted({max(depth, truth.view.start_mm * 1.01) for depth in (*ends, *inside)})
