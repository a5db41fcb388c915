"""The tree over a scene's bounded primitives as the kernels walk it, a pack of rays at a time."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.kept import identity_of_code, keep_arrays, kept_arrays, name_of
from rptcam_cl.core.records import Kind
from rptcam_cl.device import Session
from rptcam_cl.plan import Movements, Places
from rptcam_cl.rendering.trees.build import build_bvh, check_boxes
from rptcam_cl.rendering.trees.cache import builder_identity
from rptcam_cl.rendering.trees.few_boxes import FEW, tree_of_few
from rptcam_cl.rendering.trees.wide_tree import EMPTY, Bvh, quality, stack_size

Array = NDArray[np.float64]

KEPT = "primitive-trees"  # folder of the cache on disk
BREAK_EVEN = 48  # bounded primitives: see benchmarks/journal.md
LEAF = 4  # most primitives of a leaf: measured best of 1, 2, 4 and 8
ROUNDING = 4e-6  # HIT_ROUNDING of kernels/geometry/primitive_tree.h


@dataclass(frozen=True, eq=False)
class PrimitiveTree:
    """Arrays of the kernels (``kernels/geometry/primitive_tree.h``).

    Attributes
    ----------
    nodes : (n, 8) float32 array
        Middle of a box and ``first``, half size and ``count``; the integers as bits.
    leaves : int32 array
        Primitives, leaf by leaf.
    facts : dict
        Facts that the kernels are compiled for.
    """

    nodes: NDArray[np.float32]
    leaves: NDArray[np.int32]
    facts: dict[str, int]


def primitive_tree(
    records: NDArray[np.void],
    kind_end: NDArray[np.int32],
    session: Session,
    movements: Movements | None = None,
    *,
    on_disk: bool = True,
) -> PrimitiveTree | None:
    """Return the tree over the bounded primitives of a scene, or None where there are too few to gain by one.

    Parameters
    ----------
    records
        ``Primitive`` records, sorted by kind.
    kind_end
        Per kind, the index after its last one.
    movements
        Of what moves, if anything does: its box holds all of its way.
    on_disk
        Whether a tree over few boxes, too, is kept from one run to the next.
    """
    kinds = np.searchsorted(kind_end, np.arange(kind_end[Kind.CONE]), side="right")
    bounded = np.flatnonzero(kinds != Kind.PLANE).astype(np.int32)
    if len(bounded) < max(BREAK_EVEN, 1):
        return None
    lower, upper = primitive_bounds(records[bounded], kinds[bounded])
    for place, index in enumerate(bounded.tolist()):
        if movements is not None and movements.of_primitive[index, 1]:
            box = lower[place], upper[place]
            lower[place], upper[place] = _swept(records[index], int(kinds[index]), movements.places(index), box)
    infinity = np.float32(np.inf)
    lower32 = np.nextafter(lower.astype(np.float32), -infinity)
    upper32 = np.nextafter(upper.astype(np.float32), infinity)
    on_disk = on_disk or len(bounded) > FEW
    nodes, order, stack = (_kept_or_built if on_disk else _built)(lower32, upper32, session)
    return PrimitiveTree(nodes, bounded[order], {"HAS_PRIMITIVE_TREE": 1, "PRIMITIVE_STACK": stack})


def _kept_or_built(
    lower: NDArray[np.float32], upper: NDArray[np.float32], session: Session
) -> tuple[NDArray[np.float32], NDArray[np.int32], int]:
    """Return nodes, the boxes in the order of the leaves, and the size of the stack; kept from one run to the next."""
    driver = session.info.name, session.info.driver, session.kind, session.loop_limit
    boxes = hashlib.sha256(lower.tobytes() + upper.tobytes()).hexdigest()
    name = name_of(builder_identity(), identity_of_code(("rendering/trees",)), driver, boxes)
    if (kept := kept_arrays(KEPT, name)) is not None:
        return kept[0]["nodes"], kept[0]["order"], kept[1]["stack"]
    nodes, order, stack = _built(lower, upper, session)
    keep_arrays(KEPT, name, {"nodes": nodes, "order": order}, {"stack": stack})
    return nodes, order, stack


def _built(
    lower: NDArray[np.float32], upper: NDArray[np.float32], session: Session
) -> tuple[NDArray[np.float32], NDArray[np.int32], int]:
    """Return the same of a new tree."""
    if len(lower) <= FEW:
        check_boxes(lower, upper)
        tree = tree_of_few(lower, upper, LEAF)
    else:
        tree = build_bvh(lower, upper, width=2, leaf_size=LEAF, session=session)
    return _nodes(tree), tree.blocks[tree.blocks >= 0], stack_size(quality(tree).depth)


def primitive_bounds(records: NDArray[np.void], kinds: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the corners of the boxes (n, 3) of primitives, grown by what rounding may move a hit.

    They are those of the records: of the rows of numbers that rays meet, float32 as they are.
    """
    return _bounds_of_rows(np.stack([records[f"row_{axis}"] for axis in "xyz"], axis=1).astype(np.float64), kinds)


def _swept(record: np.void, kind: int, places: Places, rest: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the corners (3,) of the box round the whole way of a primitive, whose box at rest is known."""
    rows = np.stack([record[f"row_{axis}"] for axis in "xyz"]).astype(np.float64)
    moved = np.tile(rows, (len(places.matrices), 1, 1))
    if kind == Kind.SPHERE:
        moved[:, 0, :3] = places.matrices[:, :3, :3] @ rows[0, :3] + places.matrices[:, :3, 3]
    else:
        moved = moved @ np.linalg.inv(places.matrices)
    return places.box(*_bounds_of_rows(moved, np.full(len(moved), kind)), rest)


def _bounds_of_rows(rows: Array, kinds: NDArray[np.int64]) -> tuple[Array, Array]:
    placed = np.tile(np.eye(4), (len(rows), 1, 1))
    placed[:, :3] = rows
    is_sphere = kinds == Kind.SPHERE
    placed[is_sphere] = np.eye(4)
    inverse = np.linalg.inv(placed).astype(np.float64)
    linear, origin = inverse[:, :3, :3], inverse[:, :3, 3]
    linear[is_sphere] *= rows[is_sphere, 0, 3, None, None]
    origin[is_sphere] = rows[is_sphere, 0, :3]
    lower, upper = origin.copy(), origin.copy()
    for kind in set(kinds.tolist()):
        of_kind = kinds == kind
        low, high = _extent(Kind(kind), *np.moveaxis(linear[of_kind], 2, 0))
        lower[of_kind] += low
        upper[of_kind] += high
    # The rows of a skewed placement magnify rounding.
    magnified = np.abs(linear) @ np.abs(rows[:, :, :3])
    magnified[is_sphere] = np.eye(3)
    farthest = np.maximum(np.abs(lower), np.abs(upper)).max(axis=1)
    margin = ROUNDING * (magnified.sum(axis=2).max(axis=1) * farthest)[:, None]
    return lower - margin, upper + margin


def _extent(kind: Kind, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """Return how far a kind's canonical shape, its axes placed as given (n, 3), reaches from its origin."""
    zero = np.zeros_like(x)
    if kind in (Kind.SPHERE, Kind.ELLIPSOID):
        reach = np.sqrt(x * x + y * y + z * z)
        return -reach, reach
    if kind is Kind.BOX:
        reach = np.abs(x) + np.abs(y) + np.abs(z)
        return -reach, reach
    if kind is Kind.RECTANGLE:
        return np.minimum(x, 0) + np.minimum(y, 0), np.maximum(x, 0) + np.maximum(y, 0)
    circle = np.sqrt(x * x + y * y)
    if kind is Kind.CYLINDER:
        return np.minimum(z, 0) - circle, np.maximum(z, 0) + circle
    apex = z if kind is Kind.CONE else zero
    return np.minimum(apex, -circle), np.maximum(apex, circle)


def _nodes(tree: Bvh) -> NDArray[np.float32]:
    """Return the root's node, then the two below each node of a binary tree, the farther along its axis last."""
    bounds = tree.bounds.transpose(0, 2, 1).astype(np.float64)  # (node, child, corner)
    used = tree.children != EMPTY
    middle = np.zeros((*used.shape, 3))
    middle[used] = (bounds[used, :3] + bounds[used, 3:]) / 2
    both = used.all(axis=1)  # a root may have one child
    apart = np.where(both[:, None], middle[:, 1] - middle[:, 0], 0)
    axis = np.abs(apart).argmax(axis=1)
    turned = apart[np.arange(len(axis)), axis] < 0
    order = np.stack([turned, ~turned], axis=1).astype(np.int64)
    children = np.take_along_axis(tree.children, order, axis=1).ravel()
    corners = np.take_along_axis(bounds, order[..., None], axis=1).reshape(-1, 6)
    counts = (tree.blocks >= 0).sum(axis=1)
    firsts = np.cumsum(counts) - counts
    inner, leaf = (children >= 0) & (children != EMPTY), children < 0
    links = np.zeros((len(children), 2), np.int64)
    links[inner] = np.stack([1 + 2 * children[inner], ~axis[children[inner]]], axis=1)
    links[leaf] = np.stack([firsts[~children[leaf]], counts[~children[leaf]]], axis=1)
    whole = np.concatenate([bounds[0, :, :3].min(axis=0), bounds[0, :, 3:].max(axis=0)])
    return _packed(np.vstack([whole, corners]), np.vstack([[1, ~axis[0]], links]))


def _packed(corners: Array, links: NDArray[np.int64]) -> NDArray[np.float32]:
    out = np.zeros((len(corners), 8), np.float32)
    there = np.isfinite(corners).all(axis=1)
    low, high = corners[there, :3], corners[there, 3:]
    middle = ((low + high) / 2).astype(np.float32)
    half = np.maximum(high - middle, middle - low)
    out[there, :3] = middle
    out[there, 4:7] = np.nextafter(half.astype(np.float32), np.float32(np.inf))
    out[~there, 4:7] = -np.inf  # met by no ray
    out[:, 3], out[:, 7] = links.astype(np.int32).view(np.float32).reshape(-1, 2).T
    return out
