"""The plan of a render: facts that specialise the kernels, and the records that they read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import colour
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import EnvironmentKind, Kind, MaterialKind, SpectrumKind
from rptcam_cl.rendering.cameras.kinds import camera_model
from rptcam_cl.rendering.cameras.lamp_aim import Shows, Sights, aimed_at_lamps
from rptcam_cl.rendering.cameras.model import CameraModel, camera_trajectory, exposed, filter_table, turned
from rptcam_cl.rendering.cameras.setting import on_film
from rptcam_cl.rendering.plan import geometry
from rptcam_cl.rendering.plan.caustics import Caustics, pack_caustics, stand_behind_glass, without_caustics
from rptcam_cl.rendering.plan.emitters import (
    Emitters,
    LightGroups,
    hidden_from_camera,
    light_groups,
    met_apart,
    pack_emitters,
)
from rptcam_cl.rendering.plan.environment import Surroundings
from rptcam_cl.rendering.plan.materials import LargestAlbedo, Materials, largest_albedo
from rptcam_cl.rendering.plan.media import Media, about_camera, hidden_from, pack_media
from rptcam_cl.rendering.plan.primitives import PlanParts, Primitives, scene_primitives
from rptcam_cl.rendering.plan.textures import KnownSpectra, Textures
from rptcam_cl.rendering.plan.virtual_lights import VirtualLights, pack_virtual_lights, without_virtual_lights
from rptcam_cl.scene.base import FileReference, file_references
from rptcam_cl.scene.changes import at_opening, exposure_steps
from rptcam_cl.scene.film import Film
from rptcam_cl.scene.scene import Scene

# What the numbers of a path's light are, and which wavelengths paths have.

Array = NDArray[np.float64]

WAVELENGTH_CELLS = 528  # a multiple of 3, for three wavelengths per path
_GREEN_NM = 550.0
_WHITE_ON_AXIS = ("relative", "auto")  # exposures that divide out what the lens leaves of white

_AxialColour = tuple[Array, Array] | None


@dataclass(frozen=True)
class PathSpectrum:
    """The kind of light that paths carry.

    Attributes
    ----------
    kind : SpectrumKind
    table : float32 array
        Wavelengths and what they weigh, as ``kernels/common/wavelength.h`` reads them; a single 0 for RGB.
    facts : dict
        Facts for the compilation.
    metadata : dict
        What the picture's metadata should say.
    """

    kind: SpectrumKind
    table: NDArray[np.float32]
    facts: dict[str, int]
    metadata: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, kind: SpectrumKind, table: NDArray[np.float32], **facts: int) -> PathSpectrum:
        """Return the light of a kind; facts that are not given are 0."""
        absent = {"WAVELENGTH_CELLS": 0, "SPECTRAL_COLOURS": 0, "HAS_SPECTRA": 0, "LENS_SPLITS": 0, "HAS_DISPERSION": 0}
        cells = {"WAVELENGTH_CELLS": WAVELENGTH_CELLS} if kind else {}
        return cls(kind, table, absent | cells | facts | {"SPECTRUM": int(kind)})


def primary_spectra() -> Array:
    """How red, green and blue light is spread over `WAVELENGTHS_NM`, shape (401, 3), each of sum 1.

    White light of D65 as the sRGB primaries' matching functions (CIE 1931) see it, their negative parts left out: none
    of red, green and blue can be less than nothing. Each channel then is light of its own, and white a mixture of all.
    """
    matching = colour.cie_1931() @ colour.srgb_from_xyz().T * colour.daylight_65()[:, None]
    spread = np.maximum(matching, 0.0)
    return np.asarray(spread / spread.sum(axis=0))


def wavelength_table(spectra: Array, density: Array, low_nm: float, high_nm: float) -> NDArray[np.float32]:
    """Return `WAVELENGTH_CELLS` equally likely cells as rows: wavelength where it starts, weights of red, green, blue.

    Parameters
    ----------
    spectra : (401, 3) array
        What light of each wavelength of `WAVELENGTHS_NM` adds to the channels.
    density : (401,) array
        How likely each wavelength is to be chosen; above 0 wherever a spectrum is.
    low_nm, high_nm
        Wavelengths that paths may have [nm]; the spectra are cut there and keep their sums.
    """
    inside = (low_nm < colour.WAVELENGTHS_NM) & (high_nm > colour.WAVELENGTHS_NM)
    grid = np.concatenate([[low_nm], colour.WAVELENGTHS_NM[inside], [high_nm]])
    columns = np.stack([np.interp(grid, colour.WAVELENGTHS_NM, values) for values in (*spectra.T, density)])
    pieces = (columns[:, 1:] + columns[:, :-1]) / 2 * np.diff(grid)
    sums = np.concatenate([np.zeros((4, 1)), np.cumsum(pieces, axis=1)], axis=1)
    sums *= np.append(spectra.sum(axis=0), 1.0)[:, None] / sums[:, -1:]
    starts = np.interp(np.arange(WAVELENGTH_CELLS + 1) / WAVELENGTH_CELLS, sums[3], grid)
    shares = np.array([np.interp(starts, grid, row) for row in sums[:3]])
    weights = np.append(np.diff(shares, axis=1) * WAVELENGTH_CELLS, np.zeros((3, 1)), axis=1)
    return np.concatenate([starts[None], weights]).T.astype(np.float32)


def seen_by(scene: Scene, camera: CameraModel, spectra: KnownSpectra, materials: Materials) -> PathSpectrum:
    """Return the kind of light of the paths that a camera sees: as requested, or as needed.

    A mode that nothing in the scene calls for is not compiled: without dispersion, `dispersive` is RGB.
    """
    settings = scene.spectrum
    lens = camera.bends_colours
    low, high = camera.usable_nm
    if low >= _GREEN_NM or high <= _GREEN_NM:
        raise InputError(
            f"spectrum: the glasses of the lens are not all known for green light ({low:g} to {high:g} nm)"
        )
    axial = camera.axial_colour if scene.exposure.mode in _WHITE_ON_AXIS else None
    glass = materials.facts["HAS_DISPERSION"] > 0
    metadata = {}
    if settings.mode == "spectral" or (settings.mode == "auto" and spectra.colours > 0):
        metadata["observer"], matching = observer(scene)
        spectrum = _spectral(matching, axial, spectra, (low, high), lens=lens)
    elif settings.mode != "rgb" and (lens or glass):
        spectrum = _dispersive(axial, (low, high), lens=lens)
    else:
        spectrum = PathSpectrum.of(SpectrumKind.RGB, np.zeros(1, np.float32))
    metadata |= {"spectrum": spectrum.kind.name.lower(), "spectrum_requested": settings.mode}
    facts = spectrum.facts | {"HAS_DISPERSION": int(glass and spectrum.kind != SpectrumKind.RGB)}
    return replace(spectrum, facts=facts, metadata=metadata)


def _dispersive(axial: _AxialColour, range_nm: tuple[float, float], *, lens: bool) -> PathSpectrum:
    """Return the spectrum of RGB light whose paths have a wavelength each."""
    spectra = primary_spectra()
    table = wavelength_table(spectra, least_noise(spectra), *range_nm)
    table[:, 1:] /= _left_of_white(table, np.ones(WAVELENGTH_CELLS), axial)
    return PathSpectrum.of(SpectrumKind.DISPERSIVE, table.ravel(), LENS_SPLITS=int(lens))


def least_noise(spectra: Array) -> Array:
    """Return the density of wavelengths with which light of these spectra (401, 3) has the least noise in grey.

    The variances of its luminance and of the differences of red and of blue to it count alike; their sum is least where
    the density goes with the root of the sum of their squares.
    """
    bright = spectra @ colour.LUMINANCE
    return np.asarray(np.sqrt(bright**2 + (spectra[:, 0] - bright) ** 2 + (spectra[:, 2] - bright) ** 2))


def observer(scene: Scene) -> tuple[str, Array]:
    """Find who sees, the scene's sensor or the eye, and the weights (401, 3) that make linear sRGB of spectra."""
    if scene.sensor is not None and scene.sensor.response is not None:
        return scene.sensor.response, colour.response_curves(scene.sensor.response)
    return "cie_1931", colour.cie_1931() @ colour.srgb_from_xyz().T


def _spectral(
    matching: Array, axial: _AxialColour, spectra: KnownSpectra, range_nm: tuple[float, float], *, lens: bool
) -> PathSpectrum:
    """Return the spectrum of light at three wavelengths per path, which ``matching`` (401, 3) makes linear sRGB of.

    The weights of cells are corrected, by about one part in a thousand, so that the primaries that colours are made of
    come out exactly.
    """
    table = wavelength_table(matching, _density(matching, spectra.lights), *range_nm)
    edges = table[:, 0].astype(np.float64)
    colours = np.concatenate([colour.rgb_basis().T, colour.daylight_65()[None]])
    colours = _cell_means(colours, edges)
    seen = table[:-1, 1:].T.astype(np.float64) @ (colours[:3] * colours[3]).T / WAVELENGTH_CELLS
    table[:, 1:] = table[:, 1:] @ np.linalg.inv(seen).T
    table[:, 1:] /= _left_of_white(table, colours[3], axial)
    known = _cell_means(np.array(spectra.samples), edges) if spectra.samples else np.zeros((0, WAVELENGTH_CELLS))
    parts = np.concatenate([part.ravel() for part in (table, colours.T, known)]).astype(np.float32)
    return PathSpectrum.of(
        SpectrumKind.SPECTRAL, parts, SPECTRAL_COLOURS=1, HAS_SPECTRA=int(len(known) > 0), LENS_SPLITS=int(lens)
    )


def _density(matching: Array, lights: list[Array]) -> Array:
    """How likely wavelengths are: as daylight is seen, and half of them as the lights of known spectra are."""
    sees = np.abs(matching).mean(axis=1)
    shares = sees * colour.daylight_65()
    density = shares / shares.sum()
    shining = [light for light in lights if (light * sees).sum() > 0]
    if shining:
        density = (density + np.mean([light * sees / (light * sees).sum() for light in shining], axis=0)) / 2
    return np.asarray(density)


def _cell_means(spectra: Array, edges_nm: Array) -> Array:
    """Return means (n, cells) of spectra (n, 401), linear between `WAVELENGTHS_NM`, over cells of wavelength."""
    grid = np.union1d(colour.WAVELENGTHS_NM, edges_nm)
    values = np.array([np.interp(grid, colour.WAVELENGTHS_NM, row) for row in spectra])
    pieces = (values[:, 1:] + values[:, :-1]) / 2 * np.diff(grid)
    sums = np.concatenate([np.zeros((len(values), 1)), np.cumsum(pieces, axis=1)], axis=1)
    places = np.searchsorted(grid, edges_nm)
    widths = np.diff(edges_nm)
    return np.asarray(np.diff(sums[:, places], axis=1) / np.where(widths > 0, widths, 1.0))


def _left_of_white(table: NDArray[np.float32], white: Array, axial: _AxialColour) -> Array:
    """What a lens leaves of white on its axis, as a factor on each channel; 1s where the exposure shows it."""
    if axial is None:
        return np.ones(3)
    middles = (table[:-1, 0] + table[1:, 0]) / 2
    seen = np.interp(middles, *axial)
    weights = table[:-1, 1:].astype(np.float64) * white[:, None]
    return np.asarray((weights * seen[:, None]).mean(axis=0) / weights.mean(axis=0))


# What a plan says of a scene but for its camera: primitives, materials, lamps and surroundings.

# What wants the frame of u and v.
FRAMED = ("HAS_ANISOTROPY_TURN", "HAS_ANISOTROPY_MAP", "HAS_NORMAL_MAP", "HAS_COAT_NORMAL", "HAS_BUMP")
FEW = 16  # primitives, as many as lanes that a processor permutes at once


def _world(scene: Scene, parts: PlanParts) -> dict[str, Any]:
    """The fields of a `Plan` that no camera decides: as before, where what they are made of is the same."""
    far, named = (scene.lights, scene.environment), (tuple(scene.materials), tuple(scene.materials.values()))
    shown = scene.objects, named, far, scene.medium
    references = parts.part("references", shown, lambda: _references(scene, far))
    files = tuple(map(scene.digest_of, references))
    light = (
        scene.medium,
        getattr(scene.camera, "ghosts", "off"),
        scene.render.multiple_scattering,
        "lights" in scene.render.layers,
    )
    render, given = scene.render, scene.render.model_fields_set
    ways: tuple[Any, ...] = (render.caustics, render.virtual_lights, render.max_depth, render.clamp is None)
    ways += "caustics" in given, "virtual_lights" in given
    about = scene.camera.eye, scene.metres_per_unit, scene.shutter, ways, scene.film.transparent, light
    held = () if parts.held is None else tuple(parts.held.items())
    of = scene.objects, named, far, files, about, held
    return parts.part("held world" if held else "world", of, lambda: _pack_world(scene, parts, files))


def _references(scene: Scene, far: tuple[Any, ...]) -> tuple[FileReference, ...]:
    """Return every part of a scene that is shown and names a file."""
    tables = tuple(item.instances for item in scene.objects if item.instances is not None)
    named = scene.shown_materials(), far, tables, scene.medium
    return tuple(reference for _, reference in file_references(named))


# Whose facets reflect and pass nothing on: their lobe says which lamps of a light tree matter.
_LOBED = (MaterialKind.CONDUCTOR, MaterialKind.METAL, MaterialKind.ROUGH_PLASTIC, MaterialKind.PRINCIPLED)


def _pack_world(scene: Scene, parts: PlanParts, files: tuple[str, ...]) -> dict[str, Any]:
    tables = [item.instances.matrices(scene.folders) for item in scene.objects if item.instances is not None]
    primitives, meshes = geometry.with_meshes(scene_primitives(scene, parts), scene, parts)
    materials = {id(each.material): each.material for each in primitives.prototypes}.values()
    seen = parts.appearance(scene, materials, files)
    table, spectra, surroundings = seen.table, seen.spectra, seen.surroundings
    media, shown = pack_media(scene, primitives, seen.shown, spectra)
    first_triangles = meshes.first_triangles if meshes else np.zeros(0, np.int32)
    groups = light_groups(scene, primitives, has_glow=media.has_glow)
    emitters = pack_emitters(scene, primitives, first_triangles, table, spectra, surroundings, groups, parts.held)
    eye_m = np.array(scene.camera.eye) * scene.metres_per_unit
    textures = parts.textures(seen).seen_from(scene.camera.eye)
    records, kind_end = geometry.pack_primitives(primitives, shown.index, emitters.of_primitive, meshes)
    movements = geometry.pack_movements(scene, primitives)
    apart = met_apart(primitives, emitters)
    is_held_off = parts.held is not None and not parts.held["LAMPS_BEHIND_GLASS"]
    ways_alone = media.active or any(apart.values()) or is_held_off
    follows_glass = not ways_alone and stand_behind_glass(primitives, emitters, eye_m)
    if parts.held is None or parts.held["CAUSTICS"]:
        caustics = pack_caustics(
            scene, primitives, first_triangles, emitters, eye_m, has_media=media.active, follows_glass=follows_glass
        )
    else:
        caustics = without_caustics("photons take other kernels")
    hidden = primitives.of_each(hidden_from)
    del tables  # until now they are read once
    facts = shown.facts | media.facts | caustics.facts | textures.facts | emitters.facts | movements.facts
    facts |= _facts_of_shapes(primitives, meshes, shown.facts) | apart
    facts |= {
        "ENVIRONMENT": int(surroundings.kind),
        "HAS_HIDDEN": int(hidden.any()),
        "FACET_ENERGY": shown.facts["FACET_ENERGY"] * scene.render.multiple_scattering,
        "FACET_SHARES": shown.facts["FACET_SHARES"]
        * (scene.render.multiple_scattering or shown.facts["HAS_BRUSHED_BASE"]),
        "HIDDEN_SKY": int(scene.environment is not None and hidden_from_camera(scene.environment, scene) > 0),
        "LAMPS_BEHIND_GLASS": int(follows_glass),
        "LIGHT_GROUPS": len(groups.names),
        "LIGHT_LOBES": int(facts["LIGHT_TREE"] and any(facts[f"HAS_{kind.name}"] for kind in _LOBED)),
    }
    if parts.held is None or parts.held["VIRTUAL_LIGHTS"]:
        lights = pack_virtual_lights(scene, primitives, first_triangles, emitters, facts, eye_m)
    else:
        lights = without_virtual_lights(scene, "kernels that are held")
    return {
        "facts": facts | lights.facts,
        "primitives": records,
        "primitive_count": len(primitives),
        "kind_end": kind_end,
        "hidden": hidden,
        "movements": movements,
        "materials": shown.records,
        "colours": (spectra, shown),
        "textures": textures,
        "emitters": emitters,
        "light_groups": groups,
        "surroundings": surroundings,
        "caustics": caustics,
        "virtual_lights": lights,
        "media": media,
        "meshes": meshes,
        "owners": geometry.owners_of(scene, primitives, parts),
        "eye_m": eye_m,
        "albedo": "media scatter light on and on" if media.active else largest_albedo(materials),
    }


def _facts_of_shapes(
    primitives: Primitives, meshes: geometry.PackedMeshes | None, materials: Mapping[str, int]
) -> dict[str, int]:
    """Find which kinds of primitives there are, and what their surfaces require beside positions and normals."""
    kinds = {each.kind for each in primitives.prototypes}
    is_smooth = any(each.mesh is not None and each.mesh.normals is not None for each in primitives.prototypes)
    bumpy = materials["HAS_NORMAL_MAP"] or materials["HAS_COAT_NORMAL"] or materials["HAS_BUMP"]
    return {f"HAS_{kind.name}": int(kind in kinds) for kind in Kind} | {
        "HAS_TANGENT": int(any(materials[name] for name in ("HAS_ANISOTROPY", "HAS_HAIR", *FRAMED))),
        "HAS_BITANGENT": int(any(materials[name] for name in FRAMED)),
        "HAS_SHADING_NORMAL": int(bumpy or is_smooth),
        "HAS_AFFINE": int(bool(kinds - {Kind.SPHERE, Kind.CURVE, Kind.MESH})),
        "HAS_INSTANCES": int(meshes is not None and meshes.instanced),
        "FEW_PRIMITIVES": int(len(primitives) <= FEW),
        "HUGE_SPHERES": int(geometry.has_huge_sphere(primitives)),
    }


# The plan of a render: facts that specialise the kernels, and the records that they read.


@dataclass(frozen=True)
class Plan:
    """Everything that the kernels of one render read, and the facts that they are compiled for."""

    facts: dict[str, int]
    camera: CameraModel
    spectrum: PathSpectrum
    camera_filter: NDArray[np.float32]
    trajectory: NDArray[np.float32]
    primitives: NDArray[np.void]
    movements: geometry.ObjectMovements
    kind_end: NDArray[np.int32]
    hidden: NDArray[np.int32]
    materials: NDArray[np.void]
    textures: Textures
    emitters: Emitters
    light_groups: LightGroups
    surroundings: Surroundings
    caustics: Caustics
    virtual_lights: VirtualLights
    media: Media
    primitive_count: int
    meshes: geometry.PackedMeshes | None
    owners: geometry.Owners
    eye_m: NDArray[np.float64]
    albedo: LargestAlbedo
    colours: tuple[KnownSpectra, Materials]  # of the scene, for a camera in place of this one
    is_rough: bool = False  # for glances: trees may be some made for other places of meshes, what is learned is noisier
    steps: tuple[Plan, ...] = ()  # of an exposure in which keys move, in place of this plan for its rays


def make_plan(
    scene: Scene, camera: CameraModel | None = None, *, coarse: bool = False, parts: PlanParts | None = None
) -> Plan:
    """Return the plan of a scene, with its own camera unless another one is given; ``coarse`` as for `camera_model`.

    Where keys move while the shutter is open, it has a plan for each step of the exposure, unless a camera is given.

    Parameters
    ----------
    parts
        What the last plan was made of; it takes what this one is.
    """
    parts, scene = parts or PlanParts(), on_film(scene)
    plan = _still_plan(at_opening(scene), camera, coarse, parts)
    return plan if camera is not None else replace(plan, steps=_steps(plan, scene, coarse, parts))


def _steps(plan: Plan, scene: Scene, coarse: bool, parts: PlanParts) -> tuple[Plan, ...]:
    """Return the plans of the steps of an exposure; those of the camera alone share all else."""
    of_camera = all(name.partition(".")[0] == "camera" for name in scene.shutter.keys)
    return tuple(
        with_lens(plan, step, coarse=coarse) if of_camera else _still_plan(at_opening(step), None, coarse, parts)
        for step in exposure_steps(scene)
    )


def _still_plan(scene: Scene, camera: CameraModel | None, coarse: bool, parts: PlanParts) -> Plan:
    """Return the plan of a scene whose keys hold still."""
    world = dict(_world(scene, parts))
    world["media"] = about_camera(world["media"], scene, focused=camera is None)
    trajectory, segments = camera_trajectory(scene)
    camera = camera or parts.camera(scene, coarse=coarse)
    spectrum = seen_by(scene, camera, *world["colours"])
    plan = Plan(
        **world, camera=camera, spectrum=spectrum, camera_filter=filter_table(scene.film.filter), trajectory=trajectory
    )
    facts = {
        "CAMERA_SEGMENTS": min(segments, 2),
        "MOVES": int(segments > 0 or plan.facts["HAS_MOTION"] > 0),
        "SAMPLER_LATTICE": int(scene.render.sampler == "lattice"),
        "CLAMP": 0 if scene.render.clamp is None else int(np.float32(scene.render.clamp).view(np.int32)),
    }
    facts = plan.facts | spectrum.facts | facts
    if facts["VIRTUAL_LIGHTS"] and facts["SPECTRAL_COLOURS"]:
        none = without_virtual_lights(scene, "spectra")
        plan, facts = replace(plan, virtual_lights=none), facts | none.facts
    return replace(plan, facts=facts, is_rough=parts.rough)


# Facts that are 1 where kernels know of something: those that know of it do for scenes without it, to the bit.
# Not among them is what has arrays of its own, or chooses in which way light is found.
_APART = {"HAS_MESH", "HAS_INSTANCES", "HAS_MOTION", "HAS_MEDIA", "HAS_BOUNDARY", "HAS_DISPERSION", "HAS_SPECTRA"}
_APART |= {"HAS_LAYERED_FOG", "HAS_DENSITY", "HAS_DROPLETS", "HAS_HIDDEN", "HAS_OPACITY", "HAS_CURVE", "HAS_HAIR"}
_KNOWING = ("HAS_", "EMITTER_", "FACET_ENERGY", "ENVIRONMENT_SAMPLED", "TINY_LAMPS")


def serve(plan: Plan, facts: Mapping[str, int]) -> Plan | None:
    """Return a plan with the facts of kernels that are there, which do for it; None where they do not.

    Where `PlanParts.held` is those facts too, that is where the scene has nothing that they do not know of.
    """

    def does(name: str, wanted: int) -> bool:
        there = facts.get(name)
        if there == wanted:
            return True
        if there is None or name in _APART:
            return False
        if name == "ONE_EMITTER":
            return there < wanted
        if name == "ENVIRONMENT":  # a dark picture is one
            is_picture = there == EnvironmentKind.IMAGE and plan.surroundings.distribution.size > 1
            return is_picture and wanted == EnvironmentKind.NONE
        return name.startswith(_KNOWING) and there > wanted

    if plan.steps or plan.facts.keys() != facts.keys() or not all(does(*each) for each in plan.facts.items()):
        return None
    return replace(plan, facts=dict(facts)) if plan.facts["HAS_EMITTERS"] == facts["HAS_EMITTERS"] else None


def with_film(plan: Plan, scene: Scene, film: Film) -> Plan:
    """Return the plan of a scene with a film of the same size in other pixels."""
    if plan.steps:
        return make_plan(scene.model_copy(update={"film": film}), coarse=True)
    (before, rows), (columns, lines) = scene.film.resolution, film.resolution
    record = plan.camera.record.copy()
    record["width"], record["height"] = columns, lines
    record["per_width"] *= before / columns
    record["per_height"] *= rows / lines
    trajectory, _ = camera_trajectory(at_opening(scene).model_copy(update={"film": film}))
    return replace(plan, camera=replace(plan.camera, record=record), trajectory=trajectory)


def with_pose(plan: Plan, scene: Scene, parts: PlanParts | None = None) -> Plan:
    """Return the plan of a scene in which nothing but the pose of the camera is another; nothing moves.

    ``parts`` is as for `make_plan`.
    """
    camera = turned(plan.camera, scene.camera)
    if not np.array_equal(np.array(scene.camera.eye) * scene.metres_per_unit, plan.eye_m):
        return make_plan(scene, camera, parts=parts)
    return replace(plan, camera=camera, trajectory=camera_trajectory(scene)[0])


def with_exposure(plan: Plan, scene: Scene) -> Plan:
    """Return the plan of a scene that differs in the values of its exposure alone, not in its mode; nothing moves."""
    return replace(plan, camera=exposed(plan.camera, scene), trajectory=camera_trajectory(scene)[0])


def with_lens(plan: Plan, scene: Scene, *, coarse: bool = False, colours_stay: bool = False) -> Plan:
    """Return the plan of a scene that differs in its camera or exposure alone; the camera is in the same place.

    It holds what `make_plan` returns, in a part of the time. Where a camera moves or stands elsewhere, or its light is
    of another kind, `make_plan` makes it.

    Parameters
    ----------
    colours_stay
        Whether the camera refracts wavelengths apart as that of the plan does, whatever a picture would show of it.
    """
    eye_m = np.array(scene.camera.eye) * scene.metres_per_unit
    if plan.facts["MOVES"] or scene.camera.motion or scene.shutter.keys or not np.array_equal(eye_m, plan.eye_m):
        return make_plan(scene, coarse=coarse)
    lens_colour = scene.spectrum.lens_colour
    if colours_stay and lens_colour == "auto":
        lens_colour = "on" if plan.camera.bends_colours else "off"
    camera = camera_model(scene, lens_colour, coarse=coarse)
    spectrum = seen_by(scene, camera, *plan.colours)
    if spectrum.facts.keys() != plan.spectrum.facts.keys():
        return make_plan(scene, coarse=coarse)
    trajectory, _ = camera_trajectory(scene)
    media = about_camera(plan.media, scene)
    facts = plan.facts | spectrum.facts
    return replace(plan, facts=facts, camera=camera, spectrum=spectrum, trajectory=trajectory, media=media)


_FIRST_RAY = {"object_id", "material_id", "uv", "pupil"}  # layers of a pixel's first ray, which must aim at nothing


def may_aim(plan: Plan, layers: Iterable[str] = ()) -> bool:
    """Return whether camera rays may aim at lamps, if there are any out of focus.

    Parameters
    ----------
    layers
        That the picture is to have: those of a pixel's first ray need one that aims at nothing.
    """
    return bool(plan.emitters.seen) and not (plan.steps or plan.facts["CAMERA_SEGMENTS"] or _FIRST_RAY & set(layers))


def aim(plan: Plan, shows: Shows, sights: str | None = None, *, on_disk: bool = True) -> Plan:
    """Return a plan that `may_aim` with camera rays that aim at lamps; without one out of focus, the plan as given.

    Parameters
    ----------
    shows
        Returns which lines of sight, in the world about the eye [m], nothing blocks.
    sights
        Names all that this depends on; then what is found is remembered.
    on_disk
        Whether it is kept on disk as well.
    """
    record = plan.camera.record[0]
    turn = np.stack([record[name][:3] for name in ("right", "up", "back")]).astype(np.float64)

    def shows_in_world(sights: Sights) -> NDArray[np.bool_]:
        return shows(replace(sights, origins=sights.origins @ turn, targets=sights.targets @ turn))

    lamps = [replace(lamp, centre=turn @ lamp.centre, axes=lamp.axes @ turn.T) for lamp in plan.emitters.seen]
    irradiance = plan.emitters.irradiance
    camera = aimed_at_lamps(plan.camera, lamps, shows_in_world, sights, irradiance=irradiance, on_disk=on_disk)
    return plan if camera is plan.camera else replace(plan, camera=camera)
