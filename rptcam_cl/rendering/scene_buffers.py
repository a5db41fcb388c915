"""The scene on the device: every array of the plan, under the name that kernels have for it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device.session import Session
from rptcam_cl.rendering import scene_trees
from rptcam_cl.rendering.cameras.model import CameraModel
from rptcam_cl.rendering.caustics import PhotonBuffers
from rptcam_cl.rendering.plan.materials import facet_shares
from rptcam_cl.rendering.plan.plan import Plan

_COMPARED_BYTES = 1 << 20  # of an array, up to which comparing it takes less time than a launch


class SceneBuffers:
    """Uploaded arrays of a plan.

    Parameters
    ----------
    session, plan
        The device, and whose arrays.
    earlier
        Of another plan, perhaps nearly the same: what has not changed stays where it is.

    Attributes
    ----------
    scene : dict
        Arguments for ``SCENE_PARAMETERS`` (``kernels/common/scene.h``), by name.
    tree_facts : dict
        Facts of the trees for the compilation; none where there are none.
    colours : buffer
        Wavelengths of paths; a single 0 where they have none.
    camera : dict
        Arguments of the passes that make camera rays: record, tables, surfaces and stop of the camera.
    trajectory : dict
        And one more if anything moves: when the shutter is open and where the camera is.
    """

    def __init__(self, session: Session, plan: Plan, earlier: SceneBuffers | None = None) -> None:
        self._session, self._plan = session, plan
        self._before = {} if earlier is None else earlier._uploaded
        self._uploaded: dict[str, tuple[NDArray[Any], Any]] = {}
        self.scene: dict[str, Any] = {name: self._buffer(name, array) for name, array in _scene_arrays(plan).items()}
        self.scene["emitter_count"] = np.int32(plan.emitters.count)
        if plan.facts["HAS_MEDIA"]:
            self.scene["media_at_camera"] = np.int32(plan.media.at_camera)
        self.colours = self._buffer("colours", plan.spectrum.table)
        if plan.facts["LIGHT_GROUPS"]:
            self.scene["sky_group"] = np.int32(plan.light_groups.sky)
        if plan.facts["SPECTRUM"]:
            self.scene["colours"] = self.colours
        self.tree_facts: dict[str, int] = {}
        self._add_primitive_tree(earlier)
        self._add_meshes(earlier)
        self.photons = PhotonBuffers(session, plan.caustics) if plan.caustics.active else None
        self.scene |= {} if self.photons is None else self.photons.arguments
        self.trajectory = {"trajectory": self._buffer("trajectory", plan.trajectory)} if plan.facts["MOVES"] else {}
        self.filter = self._buffer("filter", plan.camera_filter.table)
        self.camera = {name: self._buffer(name, array) for name, array in _camera_arrays(plan.camera).items()}
        self._before = {}

    def on_host(self, plan: Plan, most_bytes: int) -> SceneBuffers:
        """Return these with arrays in place of buffers, to be sent to another process; see `uploaded_to`.

        Parameters
        ----------
        plan
            What takes the place of their plan.
        most_bytes
            Of an array of the scene, which is cut there; those of the camera stay whole.
        """
        arrays = {id(buffer): array for array, buffer in self._uploaded.values()}

        def cut(value: Any) -> Any:
            array = arrays.get(id(value))
            return value if array is None else array.reshape(-1)[: most_bytes // array.itemsize + 1]

        other = self._map(cut)
        other.camera = {name: arrays[id(buffer)] for name, buffer in self.camera.items()}
        if self.photons is not None:
            other.scene = {name: value for name, value in other.scene.items() if name not in self.photons.arguments}
            other.photons = None
        other._session = other._tree = other._trees = other._placed = None  # type: ignore[assignment]
        other._plan, other._uploaded = plan, {}
        return other

    def uploaded_to(self, session: Session) -> SceneBuffers:
        """Upload what `on_host` has made to a device."""
        other = self._map(lambda value: session.upload(value) if isinstance(value, np.ndarray) else value)
        if other._plan.caustics.active:
            other.photons = PhotonBuffers(session, other._plan.caustics)
            other.scene |= other.photons.arguments
        return other

    @property
    def most_bytes(self) -> int:
        """Of an array."""
        return max(array.nbytes for array, _ in self._uploaded.values())

    def _map(self, change: Callable[[Any], Any]) -> SceneBuffers:
        other = copy.copy(self)
        for name in ("scene", "camera", "trajectory"):
            setattr(other, name, {key: change(value) for key, value in getattr(self, name).items()})
        other.colours, other.filter = change(self.colours), change(self.filter)
        return other

    def _buffer(self, name: str, array: NDArray[Any], *, in_place: bool = False) -> Any:
        """Return the buffer that holds an array: the earlier one of that name where it holds the same."""
        before = self._before.get(name)
        if before is None or not _is_same(before[0], array):
            before = array, self._session.upload(array, in_place=in_place)
        self._uploaded[name] = before
        return before[1]

    def _add_primitive_tree(self, earlier: SceneBuffers | None) -> None:
        plan = self._plan
        if earlier is not None and _has_same_primitives(earlier._plan, plan):
            tree = earlier._tree
        else:
            new = earlier is None  # the next plan of a series has other primitives
            tree = scene_trees.primitive_tree(
                plan.primitives, plan.kind_end, self._session, plan.movements, on_disk=new
            )
        self._tree: scene_trees.DeviceTree | None = tree
        if tree is not None:
            self.tree_facts |= tree[1]
            self.scene |= {name: self._buffer(name, array) for name, array in tree[0].items()}

    def _add_meshes(self, earlier: SceneBuffers | None) -> None:
        plan = self._plan
        self._trees: scene_trees.MeshTrees | None = None
        self._placed: scene_trees.DeviceTree | None = None
        if plan.meshes is None:
            return
        before, triangles = (None, None) if earlier is None else (earlier._trees, earlier.scene.get("triangles"))
        self._trees = own = scene_trees.mesh_trees(plan.meshes, self._session, before, triangles, rough=plan.is_rough)
        if earlier is not None and before is not None and own.has_blocks_of(before):
            self._take_triangles(earlier, before, own)
        else:
            for name, array in {**scene_trees.placed_triangles(own), "triangles": plan.meshes.triangles}.items():
                self.scene[name] = self._buffer(name, array, in_place=True)
        if earlier is not None and earlier._plan.meshes is plan.meshes and _moves_alike(earlier._plan, plan):
            self._placed = earlier._placed if own is before else None
        arrays, facts = self._placed = self._placed or scene_trees.placed_trees(own, self._session, plan.movements)
        self.tree_facts |= facts
        for name, value in arrays.items():
            self.scene[name] = self._buffer(name, value, in_place=True) if isinstance(value, np.ndarray) else value

    def _take_triangles(self, earlier: SceneBuffers, before: scene_trees.MeshTrees, own: scene_trees.MeshTrees) -> None:
        """Take the triangles of earlier arrays; those that lie elsewhere about the eye are moved on the device."""
        for name in ("vertices", "triangles", "blocks"):
            self._uploaded[name], self.scene[name] = self._before[name], earlier.scene[name]
        groups = zip(before.meshes.groups, own.meshes.groups, strict=True)
        shifted = any(not np.array_equal(one.shift, other.shift) for one, other in groups)
        if before.meshes.vertices is own.meshes.vertices and not shifted:
            return
        self.scene["vertices"] = self._buffer("vertices", scene_trees.placed_vertices(own.meshes), in_place=True)
        given = self.scene["vertices"], self.scene["triangles"]
        self.scene["blocks"] = scene_trees.placed_blocks(self._session, own, *given)
        self._uploaded["blocks"] = self._before["blocks"][0], self.scene["blocks"]


def _scene_arrays(plan: Plan) -> dict[str, NDArray[Any]]:
    arrays = {
        "primitives": plan.primitives,
        "kind_end": plan.kind_end,
        "materials": plan.materials,
        "textures": plan.textures.records,
        "texels": plan.textures.texels,
        "emitters": plan.emitters.records,
        "environment": plan.surroundings.record,
        "distribution": np.concatenate([plan.emitters.curve, plan.surroundings.distribution]),
    }
    if plan.emitters.tree is not None:
        arrays["light_nodes"] = plan.emitters.tree.nodes
    if plan.facts["HAS_MEDIA"]:
        arrays["media"] = plan.media.records
    if plan.facts["HAS_DENSITY"]:
        arrays["densities"] = plan.media.densities
    if plan.facts["FACET_SHARES"]:
        arrays["facet_shares"] = facet_shares(plan.materials)
    if plan.facts["LIGHT_GROUPS"]:
        arrays |= {"primitive_groups": plan.light_groups.of_primitive, "emitter_groups": plan.emitters.groups}
    if plan.facts["HAS_HIDDEN"]:
        arrays["hidden"] = plan.hidden
    if plan.facts["HAS_MOTION"]:
        arrays |= {"segments": plan.movements.segments, "movement_of": plan.movements.of_primitive}
    return arrays


def camera_buffers(session: Session, camera: CameraModel) -> dict[str, Any]:
    """Return arguments of the passes that make camera rays: record, tables, surfaces and stop of a camera, uploaded."""
    return {name: session.upload(array) for name, array in _camera_arrays(camera).items()}


def _camera_arrays(camera: CameraModel) -> dict[str, NDArray[Any]]:
    return {"camera": camera.record, "tables": camera.tables, "surfaces": camera.surfaces, "stop": camera.stop}


def _is_same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    """Return whether two arrays are known to have the same bytes; large ones are not compared."""
    if one is other:
        return True
    alike = one.dtype == other.dtype and one.shape == other.shape
    return alike and one.nbytes <= _COMPARED_BYTES and one.tobytes() == other.tobytes()


def _moves_alike(one: Plan, other: Plan) -> bool:
    """Return whether what moves in two plans is known to move in the same way."""
    return not (one.facts["HAS_MOTION"] or other.facts["HAS_MOTION"]) or one.movements is other.movements


def _has_same_primitives(one: Plan, other: Plan) -> bool:
    """Return whether the trees over the primitives of two plans are the same."""
    return (
        _moves_alike(one, other)
        and _is_same(one.primitives, other.primitives)
        and _is_same(one.kind_end, other.kind_end)
    )
