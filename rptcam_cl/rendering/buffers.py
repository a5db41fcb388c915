"""The scene on the device: every array of the plan, under the name that kernels have for it."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.cameras import CameraModel
from rptcam_cl.device import Session
from rptcam_cl.plan import Plan
from rptcam_cl.rendering.photons import PhotonBuffers
from rptcam_cl.rendering.trees.primitive_tree import PrimitiveTree, primitive_tree
from rptcam_cl.rendering.trees.scene_trees import SceneTrees, scene_trees

COMPARED_BYTES = 1 << 20  # of an array, up to which comparing it takes less time than a launch


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
        self.scene: dict[str, Any] = {
            "primitives": self._buffer("primitives", plan.primitives),
            "kind_end": self._buffer("kind_end", plan.kind_end),
            "materials": self._buffer("materials", plan.materials),
            "textures": self._buffer("textures", plan.textures.records),
            "texels": self._buffer("texels", plan.textures.texels),
            "emitters": self._buffer("emitters", plan.emitters.records),
            "environment": self._buffer("environment", plan.surroundings.record),
            "distribution": self._buffer(
                "distribution", np.concatenate([plan.emitters.curve, plan.surroundings.distribution])
            ),
            "emitter_count": np.int32(plan.emitters.count),
        }
        if plan.emitters.tree is not None:
            self.scene |= {"light_nodes": self._buffer("light_nodes", plan.emitters.tree.nodes)}
        self.colours = self._buffer("colours", plan.spectrum.table)
        if plan.facts["SPECTRUM"]:
            self.scene |= {"colours": self.colours}
        if plan.facts["HAS_MOTION"]:
            self.scene |= {
                "segments": self._buffer("segments", plan.movements.segments),
                "movement_of": self._buffer("movement_of", plan.movements.of_primitive),
            }
        self.tree_facts: dict[str, int] = {}
        self._add_primitive_tree(earlier)
        self._add_meshes(earlier)
        self.photons = PhotonBuffers(session, plan) if plan.caustics.active else None
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

        other = self._mapped(cut)
        other.camera = {name: arrays[id(buffer)] for name, buffer in self.camera.items()}
        if self.photons is not None:
            other.scene = {name: value for name, value in other.scene.items() if name not in self.photons.arguments}
            other.photons = None
        other._session = other._tree = other._mesh_trees = None  # type: ignore[assignment]
        other._plan, other._uploaded = plan, {}
        return other

    def uploaded_to(self, session: Session) -> SceneBuffers:
        """Return what `on_host` has made, on a device."""
        other = self._mapped(lambda value: session.upload(value) if isinstance(value, np.ndarray) else value)
        if other._plan.caustics.active:
            other.photons = PhotonBuffers(session, other._plan)
            other.scene |= other.photons.arguments
        return other

    @property
    def most_bytes(self) -> int:
        """Of an array."""
        return max(array.nbytes for array, _ in self._uploaded.values())

    def _mapped(self, change: Callable[[Any], Any]) -> SceneBuffers:
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
            tree = primitive_tree(plan.primitives, plan.kind_end, self._session, plan.movements, on_disk=new)
        self._tree: PrimitiveTree | None = tree
        if tree is not None:
            self.tree_facts |= tree.facts
            self.scene |= {
                "primitive_nodes": self._buffer("primitive_nodes", tree.nodes),
                "primitive_leaves": self._buffer("primitive_leaves", tree.leaves),
            }

    def _add_meshes(self, earlier: SceneBuffers | None) -> None:
        plan = self._plan
        self._mesh_trees: SceneTrees | None = None
        if plan.meshes is None:
            return
        if earlier is not None and earlier._plan.meshes is plan.meshes and _moves_alike(earlier._plan, plan):
            self._mesh_trees = earlier._mesh_trees
        trees = self._mesh_trees = self._mesh_trees or scene_trees(plan.meshes, self._session, plan.movements)
        self.tree_facts |= trees.facts
        low, high = trees.bounds
        arrays = {
            "nodes": trees.nodes,
            "blocks": trees.blocks,
            "triangles": plan.meshes.triangles,
            "vertices": trees.vertices,
            "instances": trees.instances,
        }
        self.scene |= {name: self._buffer(name, array, in_place=True) for name, array in arrays.items()}
        self.scene |= {"mesh_root": np.int32(trees.root), "mesh_low": low.tobytes(), "mesh_high": high.tobytes()}


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
    return alike and one.nbytes <= COMPARED_BYTES and one.tobytes() == other.tobytes()


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
