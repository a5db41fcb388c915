"""The trees of a scene's meshes as kernels walk them: nodes and leaf blocks of every group, and one over instances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.device import Session
from rptcam_cl.plan import Movements, PackedMeshes, TriangleGroup, shifted
from rptcam_cl.rendering.trees.build import build_bvh
from rptcam_cl.rendering.trees.cache import load_or_build
from rptcam_cl.rendering.trees.wide_tree import EMPTY, MAX_STACK, Bvh, quality, stack_size

Array = NDArray[np.float64]

# Children of a node and triangles of a block. Measured on a CPU with AVX-512, and on it compiled for AVX2: diffuse
# bounces on 300k triangles go 1.2 times as fast at 16 as at 8, and 1.5 times as fast at 8 as at 4. A GPU's thread takes
# one box after the other, so that small nodes suit it; that is not measured.
WIDTH = {"cpu": 16, "gpu": 4}
ROUNDING = 1e-6  # of an instance's box, relative to its farthest coordinate: what a ray taken to the mesh may be off


@dataclass(frozen=True, eq=False)
class SceneTrees:
    """Arrays of the kernels (``kernels/geometry/bvh.h``).

    Attributes
    ----------
    nodes : (n, 7, width) float32 array
        Rows min x, y, z, max x, y, z of the children, then the children as integers.
    blocks : (b, 10, leaf) float32 array
        Rows x, y, z of the three corners, then the triangles as integers.
    vertices : (v, 8) float32 array
        Shifted to where rays meet them.
    instances : array of ``Instance`` records, with their roots
    root : int
        The node at which rays begin.
    bounds : two (4,) float32 arrays
        Lowest and highest corner of all meshes, as the root has them.
    facts : dict
        Facts that the kernels are compiled for: children of a node, triangles of a block, entries of the stack.
    """

    nodes: NDArray[np.float32]
    blocks: NDArray[np.float32]
    vertices: NDArray[np.float32]
    instances: NDArray[np.void]
    root: int
    bounds: tuple[NDArray[np.float32], NDArray[np.float32]]
    facts: dict[str, int]


def scene_trees(meshes: PackedMeshes, session: Session, movements: Movements | None = None) -> SceneTrees:
    """Return the trees of a scene's meshes for a device, taken from the disk or built on it.

    The box of an instance that moves holds all of its way.
    """
    width = leaf = WIDTH[session.kind]
    vertices = meshes.vertices.copy()
    for group in meshes.groups:
        part = slice(group.first_vertex, group.first_vertex + group.vertices)
        vertices[part, :3] = shifted(meshes.vertices[part, :3], group.shift)
    nodes, blocks, roots, stack = [], [], [], 0
    first_node = first_block = 0
    for group in meshes.groups:
        tree = _group_tree(meshes, group, width, leaf, session)
        roots.append(first_node)
        nodes.append(_nodes(tree, group, first_node, first_block))
        blocks.append(_blocks(tree, group, meshes.triangles, vertices))
        first_node += len(tree.children)
        first_block += len(tree.blocks)
        stack = max(stack, quality(tree).stack)
    instances = meshes.instances.copy()
    instances["root"] = np.array(roots)[meshes.group_of_instance]
    root = roots[0]
    if meshes.instanced:
        top = _instance_tree(meshes, instances, vertices, width, session, movements)
        nodes.append(_top_nodes(top, first_node))
        root, stack = first_node, stack + quality(top).stack
    facts = {"BVH_WIDTH": width, "LEAF_WIDTH": leaf, "BVH_STACK": stack_size(stack)}
    all_nodes = np.concatenate(nodes)
    return SceneTrees(all_nodes, np.concatenate(blocks), vertices, instances, root, _bounds(all_nodes[root]), facts)


def _bounds(node: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the corners (4,) of the box round a node (7, width)."""
    return np.append(node[:3].min(axis=1), np.float32(0)), np.append(node[3:6].max(axis=1), np.float32(0))


def _group_tree(meshes: PackedMeshes, group: TriangleGroup, width: int, leaf: int, session: Session) -> Bvh:
    def build() -> Bvh:
        faces = meshes.triangles[group.first_triangle : group.first_triangle + group.triangles, :3]
        lower = meshes.vertices[faces[:, 0], :3]
        upper = lower.copy()
        for corner in (1, 2):
            points = meshes.vertices[faces[:, corner], :3]
            np.minimum(lower, points, out=lower)
            np.maximum(upper, points, out=upper)
        return build_bvh(lower, upper, width=width, leaf_size=leaf, session=session)

    def fits(tree: Bvh) -> bool:
        """Return whether a tree has these many triangles and the shape that kernels are compiled for."""
        shape = (tree.children.shape[1], tree.blocks.shape[1], int(np.count_nonzero(tree.blocks >= 0)))
        return shape == (width, leaf, group.triangles) and quality(tree).stack <= MAX_STACK

    way = session.kind if session.loop_limit is None else f"{session.kind} in short loops"
    return load_or_build(f"{group.key} {width} {leaf} {way}", build, fits)


def _nodes(tree: Bvh, group: TriangleGroup, first_node: int, first_block: int) -> NDArray[np.float32]:
    out = np.empty((len(tree.children), 7, tree.children.shape[1]), np.float32)
    corners = tree.bounds.reshape(-1, 2, 3, tree.children.shape[1]).transpose(0, 1, 3, 2)
    out[:, :6] = shifted(corners, group.shift).transpose(0, 1, 3, 2).reshape(tree.bounds.shape)
    children = tree.children.copy()
    inner = (children >= 0) & (children != EMPTY)
    children[inner] += first_node
    children[children < 0] -= first_block
    out[:, 6] = children.view(np.float32)
    return out


def _blocks(
    tree: Bvh, group: TriangleGroup, triangles: NDArray[np.int32], vertices: NDArray[np.float32]
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


def _instance_tree(
    meshes: PackedMeshes,
    instances: NDArray[np.void],
    vertices: NDArray[np.float32],
    width: int,
    session: Session,
    movements: Movements | None,
) -> Bvh:
    boxes = []
    for group in meshes.groups:
        points = vertices[group.first_vertex : group.first_vertex + group.vertices, :3]
        boxes.append((points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)))
    low, high = (np.array(side)[meshes.group_of_instance] for side in zip(*boxes, strict=True))
    rows = np.stack([instances[f"world_{axis}"] for axis in "xyz"], axis=1).astype(np.float64)
    linear, offset = rows[:, :, :3], rows[:, :, 3]
    lowest, highest = _placed_boxes(linear, offset, low, high)
    for index, primitive in enumerate(instances["first_primitive"].tolist()):
        if movements is not None and movements.of_primitive[primitive, 1]:
            places = movements.places(primitive)
            turns, shifts = places.matrices[:, :3, :3], places.matrices[:, :3, 3]
            way = _placed_boxes(turns @ linear[index], turns @ offset[index] + shifts, low[index], high[index])
            lowest[index], highest[index] = places.box(*way, (lowest[index], highest[index]))
    infinity = np.float32(np.inf)
    lower = np.nextafter(lowest.astype(np.float32), -infinity)
    upper = np.nextafter(highest.astype(np.float32), infinity)
    return build_bvh(lower, upper, width=width, leaf_size=1, session=session)


def _placed_boxes(linear: Array, offset: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the corners (n, 3) of boxes round boxes that are placed (n, 3, 3) and (n, 3), grown by rounding."""
    middle = (linear @ ((low + high) / 2)[..., None])[..., 0] + offset
    half = (np.abs(linear) @ ((high - low) / 2)[..., None])[..., 0]
    half += ROUNDING * (np.abs(middle) + half).max(axis=1, keepdims=True)
    return middle - half, middle + half


def _top_nodes(tree: Bvh, first_node: int) -> NDArray[np.float32]:
    out = np.empty((len(tree.children), 7, tree.children.shape[1]), np.float32)
    out[:, :6] = tree.bounds
    children = tree.children.copy()
    leaves = children < 0
    inner = ~leaves & (children != EMPTY)
    children[leaves] = ~tree.blocks[~children[leaves], 0]
    children[inner] += first_node
    out[:, 6] = children.view(np.float32)
    return out
