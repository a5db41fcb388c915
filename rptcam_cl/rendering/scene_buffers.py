"""The scene on the device: the arrays of a plan, and the trees over them that kernels walk, kept on disk."""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.files import cache_dir
from rptcam_cl.core.remember import Disk
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import culling, tree_build
from rptcam_cl.rendering.cameras.model import CameraModel
from rptcam_cl.rendering.photon_map import PhotonBuffers
from rptcam_cl.rendering.plan import geometry
from rptcam_cl.rendering.plan.materials import facet_shares
from rptcam_cl.rendering.plan.plan import Plan
from rptcam_cl.rendering.plan.primitives import BLOCK, corners_of_box
from rptcam_cl.rendering.virtual_lights import VirtualLightBuffers

# Trees kept on disk between runs, under the hash of what they were built from; one that is not sound is built anew.

ARRAYS = ("bounds", "children", "blocks")
_DISK = Disk(
    "trees",
    pack=lambda tree: ({name: getattr(tree, name) for name in ARRAYS}, {}),
    unpack=lambda arrays, _: tree_build.Bvh(**arrays),
    most_bytes=2 << 30,
)


def load_or_build(
    key: str, build: Callable[[], tree_build.Bvh], fits: Callable[[tree_build.Bvh], bool] = lambda tree: True
) -> tree_build.Bvh:
    """Return the tree kept under a key, else the one that ``build`` returns, which is kept.

    Parameters
    ----------
    key
        Names all that the tree depends on, but for this package's code: hash of the boxes, width, leaf size, device.
    build
        Called at most once.
    fits
        Says whether a sound tree is one over what it is wanted for.
    """
    name = tree_build.builder_identity(), key
    kept: tree_build.Bvh | None = _DISK.find(name)
    if kept is not None and tree_build.is_sound(kept) and fits(kept):
        return kept
    tree = build()
    _DISK.add(name, tree)
    return tree


def cache_folder() -> Path:
    """Return the folder of the trees."""
    return cache_dir("trees")


Array = NDArray[np.float64]

# The trees of a scene's meshes as kernels walk them: nodes and leaf blocks of every group, and one over instances.

# Children of a node and triangles of a block. Measured on a CPU with AVX-512, and on it compiled for AVX2: diffuse
# bounces on 300k triangles go 1.2 times as fast at 16 as at 8, and 1.5 times as fast at 8 as at 4. A GPU's thread takes
# one box after the other, so that small nodes suit it; that is not measured.
WIDTH = {"cpu": 16, "gpu": 4}
_BLOCK_ROWS = 10
_MOST_LEVELS = 32  # of nodes on the way of a ray that keeps its place in registers, `geometry/short_stack.h`
_MESH_ROUNDING = (
    1e-6  # of an instance's box, relative to its farthest coordinate: what a ray taken to the mesh may be off
)


@dataclass(frozen=True, eq=False)
class MeshTrees:
    """The trees of a scene's meshes in the frames of these, wherever the eye is.

    Attributes
    ----------
    meshes : PackedMeshes
    groups : tuple of Bvh
        Over the triangles of each group.
    instances : Bvh or None
        Over the instances, None where rays need none; its boxes are not those that rays meet.
    is_rough : bool
        Whether something stood elsewhere when they were built.
    resting : callable
        Makes the leaf blocks in the frames of the groups on the device, given the triangles there, and the boxes (b, 6)
        of the blocks: once, for all trees of the same triangles in the same places.
    spare : list
        Memory for leaf blocks that nobody needs, for `Session.allocate`; shared with all trees after these.
    """

    meshes: geometry.PackedMeshes
    groups: tuple[tree_build.Bvh, ...]
    instances: tree_build.Bvh | None
    is_rough: bool
    resting: Callable[[Any], tuple[Any, NDArray[np.float32]]]
    spare: list[NDArray[np.uint8]]

    def has_blocks_of(self, other: MeshTrees) -> bool:
        """Whether the leaf blocks are those of other trees, but for the places of the triangles in them."""
        same = self.meshes.triangles is other.meshes.triangles and len(self.groups) == len(other.groups)
        return same and all(one.blocks is two.blocks for one, two in zip(self.groups, other.groups, strict=True))


def mesh_trees(
    meshes: geometry.PackedMeshes,
    session: Session,
    before: MeshTrees | None = None,
    triangles: Any = None,
    *,
    rough: bool = False,
) -> MeshTrees:
    """Make the trees of a scene's meshes for a device: taken from those before, from the disk, or built on it.

    Where ``rough`` things have moved, trees stay and only their boxes change; ``triangles`` are those before, on the
    device.
    """
    spare: list[NDArray[np.uint8]] = [] if before is None else before.spare
    if before is not None and before.is_rough and not rough:
        before = None
    if before is not None and before.meshes is meshes:
        return before
    is_rough = before is not None and before.is_rough
    if before is not None and before.meshes.vertices is meshes.vertices:
        groups, resting = before.groups, before.resting
    elif before is not None and rough and before.meshes.triangles is meshes.triangles:
        resting, is_rough = _resting(session, before.groups, meshes, spare), True
        boxes = np.split(resting(triangles)[1], np.cumsum([len(tree.blocks) for tree in before.groups[:-1]]))
        groups = tuple(map(tree_build.refit, before.groups, boxes))
    else:
        width = WIDTH[session.kind]
        groups = tuple(_group_tree(meshes, group, width, width, session) for group in meshes.groups)
        resting = _resting(session, groups, meshes, spare)
    if not meshes.instanced:
        return MeshTrees(meshes, groups, None, is_rough, resting, spare)
    if before is not None and before.instances is not None:
        if meshes.has_places_of(before.meshes) and groups is before.groups:
            return MeshTrees(meshes, groups, before.instances, is_rough, resting, spare)
        if rough and np.array_equal(before.meshes.group_of_instance, meshes.group_of_instance):
            return MeshTrees(meshes, groups, before.instances, True, resting, spare)
    return MeshTrees(meshes, groups, _instance_tree(meshes, session), is_rough, resting, spare)


def _resting(
    session: Session,
    trees: tuple[tree_build.Bvh, ...],
    meshes: geometry.PackedMeshes,
    spare: list[NDArray[np.uint8]],
) -> Callable[[Any], tuple[Any, NDArray[np.float32]]]:
    """Return `MeshTrees.resting` of trees."""

    @lru_cache(maxsize=1)
    def resting(triangles: Any) -> tuple[Any, NDArray[np.float32]]:
        vertices = session.upload(meshes.vertices, in_place=True)
        return _fill_blocks(session, trees, meshes, vertices, triangles, spare)

    return resting


def scene_trees(
    meshes: geometry.PackedMeshes, session: Session, movements: geometry.ObjectMovements | None = None
) -> culling.DeviceTree:
    """Return the trees of a scene's meshes as kernels walk them: `placed_triangles` and `placed_trees`."""
    trees = mesh_trees(meshes, session)
    arrays, facts = placed_trees(trees, session, movements)
    return arrays | placed_triangles(trees), facts


def placed_triangles(trees: MeshTrees) -> dict[str, Any]:
    """Return the triangles of meshes as rays meet them.

    ``vertices`` (v, 8) are shifted to there; ``blocks`` (b, 10, leaf) have rows x, y, z of the three corners, then the
    triangles as integers.
    """
    meshes, vertices = trees.meshes, placed_vertices(trees.meshes)
    pairs = zip(trees.groups, meshes.groups, strict=True)
    blocks = np.concatenate([_blocks(tree, group, meshes.triangles, vertices) for tree, group in pairs])
    return {"blocks": blocks, "vertices": vertices}


def placed_vertices(meshes: geometry.PackedMeshes) -> NDArray[np.float32]:
    """Return the vertices (v, 8) shifted to where rays meet them."""
    vertices = np.empty_like(meshes.vertices)
    for group in meshes.groups:
        part = slice(group.first_vertex, group.first_vertex + group.vertices)
        shift = np.append(group.shift, np.full(geometry.VERTEX_FLOATS - 3, -0.0))  # which leaves each number as it is
        np.add(meshes.vertices[part], shift, out=vertices[part], casting="unsafe")
    return vertices


def placed_blocks(session: Session, trees: MeshTrees, vertices: Any, triangles: Any) -> Any:
    """Return a buffer of the leaf blocks as rays meet them, made on the device.

    Parameters
    ----------
    session, trees
        The device, and of which meshes.
    vertices, triangles
        Of the scene on the device, ``vertices`` as rays meet them.
    """
    if not session.info.fp64:
        return _fill_blocks(session, trees.groups, trees.meshes, vertices, triangles, trees.spare)[0]
    blocks = _allocate_blocks(session, trees.groups, trees.spare)
    given = {"before": trees.resting(triangles)[0], "blocks": blocks}
    each = [dict(zip(("shift_x", "shift_y", "shift_z"), group.shift, strict=True)) for group in trees.meshes.groups]
    _run_on_blocks(session, "shift_blocks", trees.groups, given, each)
    return blocks


def _fill_blocks(
    session: Session,
    trees: tuple[tree_build.Bvh, ...],
    meshes: geometry.PackedMeshes,
    vertices: Any,
    triangles: Any,
    spare: list[NDArray[np.uint8]],
) -> tuple[Any, NDArray[np.float32]]:
    """Return a buffer of leaf blocks made of vertices on the device, and the boxes (b, 6) of the blocks."""
    total = sum(len(tree.blocks) for tree in trees)
    blocks, boxes = _allocate_blocks(session, trees, spare), session.allocate(4 * 8 * total)
    given = {"vertices": vertices, "triangles": triangles, "blocks": blocks, "boxes": boxes}
    each = [
        {"primitives": session.upload(tree.blocks, in_place=True), "first_triangle": np.int32(group.first_triangle)}
        for tree, group in zip(trees, meshes.groups, strict=True)
    ]
    _run_on_blocks(session, "fill_blocks", trees, given, each)
    return blocks, session.read(boxes, np.float32, 8 * total).reshape(-1, 2, 4)[:, :, :3].reshape(-1, 6)


def _allocate_blocks(session: Session, trees: tuple[tree_build.Bvh, ...], spare: list[NDArray[np.uint8]]) -> Any:
    rows = sum(tree.blocks.size for tree in trees)
    return session.allocate(4 * _BLOCK_ROWS * rows, spare=spare)


def _run_on_blocks(
    session: Session,
    kernel: str,
    trees: tuple[tree_build.Bvh, ...],
    given: dict[str, Any],
    each: list[dict[str, Any]],
) -> None:
    """Run a kernel over the leaf blocks of each group, with arguments of all and of each; wait for it.

    Arrays may lie in memory of the host, which the next change lets go of.
    """
    facts = {"LEAF_WIDTH": WIDTH[session.kind], "VERTEX_FLOATS": geometry.VERTEX_FLOATS, "BINS": tree_build.BINS}
    program = session.program([f"build/{kernel}.cl"], facts, "")
    first = 0
    for tree, own in zip(trees, each, strict=True):
        span = {"first": np.int32(first), "count": np.int32(len(tree.blocks))}
        session.bind(program, kernel, **given, **own, **span).enqueue(-(-len(tree.blocks) // 64) * 64, 64)
        first += len(tree.blocks)
    session.finish()


def placed_trees(
    trees: MeshTrees, session: Session, movements: geometry.ObjectMovements | None = None
) -> culling.DeviceTree:
    """Return nodes and instances as kernels walk them.

    ``nodes`` (n, 7, width) have rows min x, y, z, max x, y, z of the children, then the children as integers;
    ``instances`` have their roots. Rays begin at the node ``mesh_root``; ``mesh_low`` and ``mesh_high`` are the corners
    of all meshes, as it has them (``kernels/geometry/bvh.h``).

    The box of an instance that moves holds all of its way.
    """
    meshes = trees.meshes
    nodes, roots, stack, levels = [], [], 0, 0
    first_node = first_block = 0
    for tree, group in zip(trees.groups, meshes.groups, strict=True):
        roots.append(first_node)
        nodes.append(_mesh_nodes(tree, group, first_node, first_block))
        first_node += len(tree.children)
        first_block += len(tree.blocks)
        own = tree_build.longest_way(tree.children)
        levels, stack = max(levels, own[0]), max(stack, own[1])
    instances = meshes.instances()
    instances["root"] = np.array(roots)[meshes.group_of_instance]
    root = roots[0]
    if trees.instances is not None:
        boxes = _instance_boxes(meshes, instances, movements)
        top = tree_build.refit(trees.instances, boxes[trees.instances.blocks[:, 0]].reshape(-1, 6))
        nodes.append(_top_nodes(top, first_node))
        above = tree_build.longest_way(top.children)
        root, levels, stack = first_node, levels + above[0], stack + above[1]
    width = WIDTH[session.kind]
    facts = {"BVH_WIDTH": width, "LEAF_WIDTH": width, "BVH_STACK": tree_build.stack_size(stack)}
    facts["SHORT_STACK"] = int(session.lanes == 1 and width == 4 and levels <= _MOST_LEVELS)
    all_nodes = np.concatenate(nodes)
    low, high = all_nodes[root, :3].min(axis=1), all_nodes[root, 3:6].max(axis=1)
    corners = {
        "mesh_low": np.append(low, np.float32(0)).tobytes(),
        "mesh_high": np.append(high, np.float32(0)).tobytes(),
    }
    return {"nodes": all_nodes, "instances": instances, "mesh_root": np.int32(root), **corners}, facts


def _group_tree(
    meshes: geometry.PackedMeshes, group: geometry.TriangleGroup, width: int, leaf: int, session: Session
) -> tree_build.Bvh:
    def build() -> tree_build.Bvh:
        faces = meshes.triangles[group.first_triangle : group.first_triangle + group.triangles, :3]
        lower = meshes.vertices[faces[:, 0], :3]
        upper = lower.copy()
        for corner in (1, 2):
            points = meshes.vertices[faces[:, corner], :3]
            np.minimum(lower, points, out=lower)
            np.maximum(upper, points, out=upper)
        return tree_build.build_bvh(lower, upper, width=width, leaf_size=leaf, session=session)

    def fits(tree: tree_build.Bvh) -> bool:
        """Return whether a tree has these many triangles and the shape that kernels are compiled for."""
        shape = (tree.children.shape[1], tree.blocks.shape[1], int(np.count_nonzero(tree.blocks >= 0)))
        return shape == (width, leaf, group.triangles) and tree_build.stack_entries(tree) <= tree_build.MAX_STACK

    way = session.kind if session.loop_limit is None else f"{session.kind} in short loops"
    return load_or_build(f"{group.key} {width} {leaf} {way}", build, fits)


def _mesh_nodes(
    tree: tree_build.Bvh, group: geometry.TriangleGroup, first_node: int, first_block: int
) -> NDArray[np.float32]:
    out = np.empty((len(tree.children), 7, tree.children.shape[1]), np.float32)
    corners = tree.bounds.reshape(-1, 2, 3, tree.children.shape[1]).transpose(0, 1, 3, 2)
    out[:, :6] = geometry.shift_points(corners, group.shift).transpose(0, 1, 3, 2).reshape(tree.bounds.shape)
    children = tree.children.copy()
    inner = (children >= 0) & (children != tree_build.EMPTY)
    children[inner] += first_node
    children[children < 0] -= first_block
    out[:, 6] = children.view(np.float32)
    return out


def _blocks(
    tree: tree_build.Bvh, group: geometry.TriangleGroup, triangles: NDArray[np.int32], vertices: NDArray[np.float32]
) -> NDArray[np.float32]:
    out = np.empty((len(tree.blocks), 10, tree.blocks.shape[1]), np.float32)
    axes = np.ascontiguousarray(vertices[:, :3].T)
    corners = np.ascontiguousarray(triangles[:, :3].T)
    step = 1 << 12
    for start in range(0, len(out), step):
        block, part = out[start : start + step], tree.blocks[start : start + step]
        unused = part < 0
        chosen = np.where(unused, 0, part + group.first_triangle)
        for corner in range(3):
            vertex = corners[corner][chosen]
            for axis in range(3):
                block[:, 3 * corner + axis] = axes[axis][vertex]
        block[:, :9].transpose(0, 2, 1)[unused] = 0
        block[:, 9] = np.where(unused, -1, chosen).astype(np.int32).view(np.float32)
    return out


def _instance_tree(meshes: geometry.PackedMeshes, session: Session) -> tree_build.Bvh:
    """Return a tree over the instances as they stand in the scene, about the middle of all of them."""
    lower, upper = np.empty((2, len(meshes.group_of_instance), 3))
    centre = meshes.groups[0].centre
    if centre is not None:
        lower[:1], upper[:1] = _placed_boxes(np.eye(3)[None], centre[None], *meshes.boxes[:1].transpose(1, 0, 2))
    for part, groups, placements, origins in meshes.placed():
        low, high = meshes.boxes[groups].transpose(1, 0, 2)
        offset = placements[:, :3, 3] + origins
        lower[part], upper[part] = _placed_boxes(placements[:, :3, :3], offset, low, high)
    middle = (lower.min(axis=0) + upper.max(axis=0)) / 2
    lower -= middle
    upper -= middle
    return tree_build.build_bvh(
        *tree_build.outwards(lower, upper), width=WIDTH[session.kind], leaf_size=1, session=session
    )


def _instance_boxes(
    meshes: geometry.PackedMeshes, instances: NDArray[np.void], movements: geometry.ObjectMovements | None
) -> NDArray[np.float32]:
    """Return the corners (n, 2, 3) of the boxes of the instances that rays meet, about the eye."""
    shifts = np.array([group.shift for group in meshes.groups])
    of_groups = geometry.shift_points(meshes.boxes, shifts[:, None]).astype(np.float64)
    group_of, found = meshes.group_of_instance, np.empty((len(instances), 2, 3), np.float32)
    for first in range(0, len(instances), BLOCK):
        part = slice(first, first + BLOCK)
        rows = np.stack([instances[f"world_{axis}"][part] for axis in "xyz"], axis=1).astype(np.float64)
        linear, offset = rows[:, :, :3], rows[:, :, 3]
        low, high = of_groups[group_of[part]].transpose(1, 0, 2)
        lowest, highest = _placed_boxes(linear, offset, low, high)
        if movements is not None:
            primitives = instances["first_primitive"][part]
            for index in np.flatnonzero(movements.of_primitive[primitives, 1]).tolist():
                places = movements.places(int(primitives[index]))
                turns, ways = places.matrices[:, :3, :3], places.matrices[:, :3, 3]
                way = _placed_boxes(turns @ linear[index], turns @ offset[index] + ways, low[index], high[index])
                lowest[index], highest[index] = places.box(*way, (lowest[index], highest[index]))
        found[part, 0], found[part, 1] = tree_build.outwards(lowest, highest)
    return found


def _placed_boxes(linear: Array, offset: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the corners (n, 3) of boxes round boxes that are placed (n, 3, 3) and (n, 3), grown by rounding."""
    middle = (linear @ ((low + high) / 2)[..., None])[..., 0] + offset
    half = (np.abs(linear) @ ((high - low) / 2)[..., None])[..., 0]
    half += _MESH_ROUNDING * (np.abs(middle) + half).max(axis=1, keepdims=True)
    return middle - half, middle + half


def _top_nodes(tree: tree_build.Bvh, first_node: int) -> NDArray[np.float32]:
    out = np.empty((len(tree.children), 7, tree.children.shape[1]), np.float32)
    out[:, :6] = tree.bounds
    children = tree.children.copy()
    leaves = children < 0
    inner = ~leaves & (children != tree_build.EMPTY)
    children[leaves] = ~tree.blocks[~children[leaves], 0]
    children[inner] += first_node
    out[:, 6] = children.view(np.float32)
    return out


# Every array of a plan on the device, under the name that kernels have for it.

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
        self.scene["primitives"] = self._buffer("primitives", culling.with_outer_planes(plan, self._mesh_corners()))
        self.photons = PhotonBuffers(session, plan.caustics) if plan.caustics.active else None
        self.scene |= {} if self.photons is None else self.photons.arguments
        self.virtual_lights = self._virtual_lights(earlier) if plan.virtual_lights.active else None
        self.scene |= {} if self.virtual_lights is None else self.virtual_lights.arguments
        self.trajectory = {"trajectory": self._buffer("trajectory", plan.trajectory)} if plan.facts["MOVES"] else {}
        self.filter = self._buffer("filter", plan.camera_filter)
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
        if self.virtual_lights is not None:
            taken = self.virtual_lights.arguments
            other.scene = {name: value for name, value in other.scene.items() if name not in taken}
            other.virtual_lights = None
        other._session = other._tree = other._trees = other._placed = None  # type: ignore[assignment]
        other._plan, other._uploaded = plan, {}
        return other

    def uploaded_to(self, session: Session) -> SceneBuffers:
        """Upload what `on_host` has made to a device."""
        other = self._map(lambda value: session.upload(value) if isinstance(value, np.ndarray) else value)
        if other._plan.caustics.active:
            other.photons = PhotonBuffers(session, other._plan.caustics)
            other.scene |= other.photons.arguments
        if other._plan.virtual_lights.active:
            other.virtual_lights = VirtualLightBuffers(session)
            other.scene |= other.virtual_lights.arguments
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
            given = plan.primitives, plan.kind_end, self._session, plan.movements
            tree = culling.primitive_tree(*given, on_disk=new) or culling.aligned(plan)
        self._tree: culling.DeviceTree = tree
        self.tree_facts |= tree[1]
        self.scene |= {name: self._buffer(name, array) for name, array in tree[0].items()}

    def _add_meshes(self, earlier: SceneBuffers | None) -> None:
        plan = self._plan
        self._trees: MeshTrees | None = None
        self._placed: culling.DeviceTree | None = None
        if plan.meshes is None:
            return
        before, triangles = (None, None) if earlier is None else (earlier._trees, earlier.scene.get("triangles"))
        self._trees = own = mesh_trees(plan.meshes, self._session, before, triangles, rough=plan.is_rough)
        if earlier is not None and before is not None and own.has_blocks_of(before):
            self._take_triangles(earlier, before, own)
        else:
            for name, array in {**placed_triangles(own), "triangles": plan.meshes.triangles}.items():
                self.scene[name] = self._buffer(name, array, in_place=True)
        if earlier is not None and earlier._plan.meshes is plan.meshes and _moves_alike(earlier._plan, plan):
            self._placed = earlier._placed if own is before else None
        arrays, facts = self._placed = self._placed or placed_trees(own, self._session, plan.movements)
        self.tree_facts |= facts
        for name, value in arrays.items():
            self.scene[name] = self._buffer(name, value, in_place=True) if isinstance(value, np.ndarray) else value

    def _virtual_lights(self, earlier: SceneBuffers | None) -> VirtualLightBuffers:
        """Return the earlier ones, with what is learned, where all that it follows from is the same."""
        before = None if earlier is None else earlier.virtual_lights
        if earlier is None or before is None:
            return VirtualLightBuffers(self._session)
        given = self._plan.virtual_lights is earlier._plan.virtual_lights and self._plan.facts == earlier._plan.facts
        others = {name: value for name, value in earlier.scene.items() if name not in before.arguments}
        alike = given and self.tree_facts == earlier.tree_facts and self.scene == others
        return before if alike else VirtualLightBuffers(self._session)

    def _mesh_corners(self) -> Array:
        if self._plan.meshes is None:
            return np.zeros((0, 3))
        low, high = (np.frombuffer(self.scene[f"mesh_{end}"], np.float32)[:3] for end in ("low", "high"))
        return corners_of_box(low.astype(np.float64), high.astype(np.float64), np.eye(4))

    def _take_triangles(self, earlier: SceneBuffers, before: MeshTrees, own: MeshTrees) -> None:
        """Take the triangles of earlier arrays; those that lie elsewhere about the eye are moved on the device."""
        for name in ("vertices", "triangles", "blocks"):
            self._uploaded[name], self.scene[name] = self._before[name], earlier.scene[name]
        groups = zip(before.meshes.groups, own.meshes.groups, strict=True)
        shifted = any(not np.array_equal(one.shift, other.shift) for one, other in groups)
        if before.meshes.vertices is own.meshes.vertices and not shifted:
            return
        self.scene["vertices"] = self._buffer("vertices", placed_vertices(own.meshes), in_place=True)
        given = self.scene["vertices"], self.scene["triangles"]
        self.scene["blocks"] = placed_blocks(self._session, own, *given)
        # Not the array that was uploaded, in whose shape later ones would be taken for it.
        self._uploaded["blocks"] = self._before["blocks"][0].reshape(1, -1), self.scene["blocks"]


def _scene_arrays(plan: Plan) -> dict[str, NDArray[Any]]:
    arrays = {
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
