"""The plan of a render: facts that specialise the kernels, and the records that they read."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import (
    CameraModel,
    FilterTable,
    SeenLamp,
    Shows,
    Sights,
    aimed_at_lamps,
    camera_model,
    camera_trajectory,
    filter_table,
    turned,
)
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.plan.albedo import LargestAlbedo
from rptcam_cl.plan.caustics import Caustics
from rptcam_cl.plan.emitters import Emitters
from rptcam_cl.plan.environment import Surroundings
from rptcam_cl.plan.materials import Materials
from rptcam_cl.plan.motion import Movements
from rptcam_cl.plan.optical_constants import KnownSpectra
from rptcam_cl.plan.packed_meshes import PackedMeshes
from rptcam_cl.plan.parts import PlanParts
from rptcam_cl.plan.primitives import Owners
from rptcam_cl.plan.spectrum import Spectrum, seen_by
from rptcam_cl.plan.textures import Textures
from rptcam_cl.plan.world import world_of
from rptcam_cl.scene import Film, Scene, at_opening, exposure_steps


@dataclass(frozen=True)
class Plan:
    """Everything that the kernels of one render read, and the facts that they are compiled for."""

    facts: dict[str, int]
    camera: CameraModel
    spectrum: Spectrum
    camera_filter: FilterTable
    trajectory: NDArray[np.float32]
    primitives: NDArray[np.void]
    movements: Movements
    kind_end: NDArray[np.int32]
    materials: NDArray[np.void]
    textures: Textures
    emitters: Emitters
    surroundings: Surroundings
    caustics: Caustics
    primitive_count: int
    meshes: PackedMeshes | None
    owners: Owners
    eye_m: NDArray[np.float64]
    albedo: LargestAlbedo
    colours: tuple[KnownSpectra, Materials]  # of the scene, for a camera in place of this one
    lamps: tuple[SeenLamp, ...]  # that the eye sees
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
    parts = parts or PlanParts()
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
    world = world_of(scene, parts)
    trajectory, segments = camera_trajectory(scene)
    camera = camera or parts.camera(scene, coarse=coarse)
    spectrum = seen_by(scene, camera, world.spectra, world.materials)
    facts = (
        world.facts
        | spectrum.facts
        | {
            "CAMERA_SEGMENTS": min(segments, 2),
            "MOVES": int(segments > 0 or world.movements.facts["HAS_MOTION"] > 0),
            "SAMPLER_LATTICE": int(scene.render.sampler == "lattice"),
            "CLAMP": 0 if scene.render.clamp is None else int(np.float32(scene.render.clamp).view(np.int32)),
        }
    )
    return Plan(
        facts=facts,
        camera=camera,
        spectrum=spectrum,
        camera_filter=filter_table(scene.film.filter),
        trajectory=trajectory,
        primitives=world.primitives,
        movements=world.movements,
        kind_end=world.kind_end,
        materials=world.materials.records,
        textures=world.textures,
        emitters=world.emitters,
        surroundings=world.surroundings,
        caustics=world.caustics,
        primitive_count=world.primitive_count,
        meshes=world.meshes,
        owners=world.owners,
        eye_m=world.eye_m,
        albedo=world.albedo,
        colours=(world.spectra, world.materials),
        lamps=world.lamps,
    )


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


def with_lens(plan: Plan, scene: Scene, *, coarse: bool = False) -> Plan:
    """Return the plan of a scene that differs in its camera or exposure alone; the camera is in the same place.

    It holds what `make_plan` returns, in a part of the time. Where a camera moves or stands elsewhere, or its light is
    of another kind, `make_plan` makes it.
    """
    eye_m = np.array(scene.camera.eye) * scene.metres_per_unit
    if plan.facts["MOVES"] or scene.camera.motion or scene.shutter.keys or not np.array_equal(eye_m, plan.eye_m):
        return make_plan(scene, coarse=coarse)
    camera = camera_model(scene, scene.spectrum.lens_colour, coarse=coarse)
    spectrum = seen_by(scene, camera, *plan.colours)
    if spectrum.facts.keys() != plan.spectrum.facts.keys():
        return make_plan(scene, coarse=coarse)
    trajectory, _ = camera_trajectory(scene)
    return replace(plan, facts=plan.facts | spectrum.facts, camera=camera, spectrum=spectrum, trajectory=trajectory)


FIRST_RAY = {"object_id", "material_id", "uv", "pupil"}  # layers of a pixel's first ray, which must aim at nothing


def may_aim(plan: Plan, layers: Iterable[str] = ()) -> bool:
    """Return whether camera rays may aim at lamps, if there are any out of focus.

    Parameters
    ----------
    layers
        That the picture is to have: those of a pixel's first ray need one that aims at nothing.
    """
    return bool(plan.lamps) and not (plan.steps or plan.facts["CAMERA_SEGMENTS"] or FIRST_RAY & set(layers))


def aimed(plan: Plan, shows: Shows, sights: str | None = None, *, on_disk: bool = True) -> Plan:
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

    lamps = [replace(lamp, centre=turn @ lamp.centre, axes=lamp.axes @ turn.T) for lamp in plan.lamps]
    camera = aimed_at_lamps(plan.camera, lamps, shows_in_world, sights, on_disk=on_disk)
    return plan if camera is plan.camera else replace(plan, camera=camera)
