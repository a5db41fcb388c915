"""The configurations that are compared: the most accurate one of a scene, and others with one thing changed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.scene import RealisticCamera, Scene, ThinLensCamera, change_scene, with_camera
from rptcam_cl.tradeoff.tiers.decide import Decision, choose_camera
from rptcam_cl.tradeoff.tiers.tiers import TIERS, Tier, equivalent

PARTS = ("film", "camera", "exposure", "shutter", "spectrum", "render")
NOT_SAID = ("spp", "layers")  # keys of `render` that do not change the configuration


def settings(scene: Scene, wanted: Scene) -> tuple[str, ...]:
    """Return the arguments of ``rptcam render --set`` that turn one scene into another; only such keys may differ."""
    return tuple(text for part in PARTS for text in _of_part(part, getattr(scene, part), getattr(wanted, part)))


def _of_part(part: str, own: Any, wanted: Any) -> list[str]:
    values = wanted.model_dump(mode="json", exclude_none=True)
    if type(own) is type(wanted):
        apart = [name for name in type(own).model_fields if getattr(own, name) != getattr(wanted, name)]
        return [_said(f"{part}.{name}", values.get(name)) for name in apart if name not in NOT_SAID]
    given = {name: values[name] for name in values if name in wanted.model_fields_set | {"kind"}}
    gone = [f"{part}.{name}=null" for name in own.model_fields_set if name not in given]
    apart = [name for name in given if getattr(own, name, None) != getattr(wanted, name)]
    by_key = [*gone, *(_said(f"{part}.{name}", given[name]) for name in apart)]
    return min(by_key, [_said(part, given)], key=lambda texts: len(" ".join(texts)))


def _said(path: str, value: Any) -> str:
    return f"{path}={value if isinstance(value, str) else json.dumps(value)}"


REFERENCE = "full"
AS_IT_IS = "as the scene says"
PUPILS = ("rear", "thick", "bounds")  # beside the outline of the pupil itself, which the reference has
SHORT_DEPTHS = (2, 4)  # edges: direct light alone, and two bounces more


@dataclass(frozen=True)
class Variant:
    """One configuration in which a scene is rendered.

    Attributes
    ----------
    name : str
    knob : str
        What differs from the most accurate one; empty for that one itself.
    scene : Scene
    tier : str
        Camera model, one of `tiers.TIERS`; empty for a camera without a lens of surfaces.
    unbiased : bool
        Whether the change affects only the noise, not the mean of the picture.
    settings : tuple of str
        Arguments of ``rptcam render --set`` that give this configuration.
    same_as : tuple of str
        Names of other configurations that give the same picture.
    """

    name: str
    knob: str
    scene: Scene
    tier: str = ""
    unbiased: bool = False
    settings: tuple[str, ...] = ()
    same_as: tuple[str, ...] = ()

    def also(self, other: Variant) -> Variant:
        """Return it with the name of an equal configuration added, and the shorter settings of the two."""
        shorter = min(self.settings, other.settings, key=lambda texts: len(" ".join(texts)))
        return replace(self, settings=shorter, same_as=(*self.same_as, other.name))


@dataclass(frozen=True)
class Ladder:
    """Configurations, the most accurate first.

    Attributes
    ----------
    configurations : tuple of Configuration
    skipped : dict
        Why a configuration is missing, by its name.
    decision : Decision or None
        What `camera.accuracy: auto` would choose; None for a camera without a lens of surfaces.
    """

    configurations: tuple[Variant, ...]
    skipped: dict[str, str]
    decision: Decision | None


def ladder(scene: Scene) -> Ladder:
    """Return the configurations of a scene; their plans may show that some are equal."""
    full = most_accurate(scene)
    is_lens = isinstance(full.scene.camera, RealisticCamera)
    decision = choose_camera(change_scene(full.scene, camera={"accuracy": "auto"})) if is_lens else None
    found, skipped = [replace(full, settings=settings(scene, full.scene))], {}
    for change in _changes(scene, full.scene, decision):
        try:
            requested = change.make()
            made = choose_camera(requested).scene
        except InputError as problem:
            skipped[change.name] = str(problem)
            continue
        tier, texts = change.tier or full.tier, settings(scene, requested)
        found.append(Variant(change.name, change.knob, made, tier, change.unbiased, texts))
    return Ladder(tuple(found), skipped, decision)


def name_of(tier: Tier) -> str:
    """Return what a camera model is called."""
    return "fitted rays" if tier == "fitted" else tier.replace("_", " ")


def most_accurate(scene: Scene) -> Variant:
    """Return the most accurate configuration of a scene.

    Every ray goes through every surface and aims at the pupil's outline. The lens refracts each wavelength separately
    unless the spectrum is RGB. Nothing is clamped. The lens is traced in float32, because float64 has shown no
    difference in the mean.
    """
    plain = change_scene(scene, render={"clamp": None, "noise": None, "layers": (), "sampler": "lattice"})
    if not isinstance(scene.camera, RealisticCamera):
        return Variant(REFERENCE, "", plain)
    plain = change_scene(plain, camera={"accuracy": None, "pupil": "auto", "rays": "traced", "precision": "single"})
    if plain.spectrum.mode != "rgb":
        plain = change_scene(plain, spectrum={"lens": "on"})
    return Variant(REFERENCE, "", plain, "realistic")


@dataclass(frozen=True)
class _Change:
    """A configuration before its scene is made."""

    name: str
    knob: str
    make: Callable[[], Scene]  # as requested, before `camera.accuracy` chooses a camera model
    unbiased: bool = False
    tier: str = ""


def _changes(scene: Scene, full: Scene, decision: Decision | None) -> Iterator[_Change]:
    """Yield every other configuration."""
    yield _Change(AS_IT_IS, "scene", partial(_as_it_is, scene))
    if decision is not None:
        for tier in reversed(TIERS[:-1]):
            yield _Change(name_of(tier), "camera", partial(equivalent, full, tier), tier=tier)
        yield _Change("lens: float64", "precision", partial(change_scene, full, camera={"precision": "double"}))
        for pupil in PUPILS:
            make = partial(change_scene, full, camera={"pupil": pupil})
            yield _Change(f"pupil: {pupil}", "pupil", make, unbiased=True)
    if isinstance(full.camera, ThinLensCamera) and full.camera.fov_degrees is not None:
        yield _Change("pinhole", "camera", partial(_without_lens, full))
    for mode in ("dispersive", "rgb"):
        yield _Change(f"spectrum: {mode}", "spectrum", partial(_with_mode, full, mode))
    for depth in SHORT_DEPTHS:
        if depth < full.render.max_depth:
            yield _Change(f"depth {depth}", "depth", partial(change_scene, full, render={"max_depth": depth}))
    make = partial(change_scene, full, render={"sampler": "independent"})
    yield _Change("independent samples", "sampler", make, unbiased=True)
    if decision is not None:
        cheap = change_scene(scene, camera={"accuracy": "auto"})
        yield _Change("accuracy: auto", "combination", partial(_as_it_is, cheap), tier=decision.tier)


def _as_it_is(scene: Scene) -> Scene:
    return change_scene(scene, render={"noise": None, "layers": ()})


def _without_lens(scene: Scene) -> Scene:
    """Return a scene with a pinhole in place of its thin lens."""
    names = ("eye", "target", "up", "flip", "motion", "fov_degrees", "fov_axis")
    return with_camera(scene, {name: getattr(scene.camera, name) for name in names} | {"kind": "pinhole"})


def _with_mode(scene: Scene, mode: str) -> Scene:
    if mode == "dispersive" and scene.spectrum.mode != "spectral":
        return scene
    return change_scene(scene, spectrum={"mode": mode, "lens": "off" if mode == "rgb" else "on"})
