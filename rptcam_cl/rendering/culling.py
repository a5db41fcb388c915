"""What spares rays tests of primitives: a tree over many; of few, planes that nothing lies behind, and shared axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.records import ALIGNED, HIT_ROUNDING, SIZELESS_EMITTERS, EmitterKind, Kind
from rptcam_cl.core.remember import Disk
from rptcam_cl.device.session import Session
from rptcam_cl.rendering import tree_build
from rptcam_cl.rendering.plan import geometry
from rptcam_cl.rendering.plan.plan import Plan

# The tree over a scene's bounded primitives as the kernels walk it, a pack of rays at a time.

Array = NDArray[np.float64]

_PRIMITIVES = Disk(
    "primitive-trees",
    ("rendering",),
    pack=lambda tree: ({"nodes": tree[0], "order": tree[1]}, {"stack": tree[2]}),
    unpack=lambda arrays, facts: (arrays["nodes"], arrays["order"], facts["stack"]),
)
BREAK_EVEN = 48  # bounded primitives: see benchmarks/journal.md
_AT_ONCE = 65_536  # primitives whose boxes are found together: each takes half a kilobyte meanwhile
_MOST_HALVINGS = 4  # of a curve, for boxes that hold little else
_SPLIT_GAIN = 0.8  # of the area of a box, that its halves must stay below
_PART_MARGIN = 0.05  # of the half width, by which the nearest place along a curve may be missed, and more
LEAF = 4  # most primitives of a leaf: measured best of 1, 2, 4 and 8


DeviceTree = tuple[dict[str, Any], dict[str, int]]
"""What kernels read of a tree, arrays and numbers by the kernels' names for them; facts that they are compiled for."""


def primitive_tree(
    records: NDArray[np.void],
    kind_end: NDArray[np.int32],
    session: Session,
    movements: geometry.ObjectMovements | None = None,
    *,
    on_disk: bool = True,
) -> DeviceTree | None:
    """Make the tree over the bounded primitives of a scene; None where there are too few to gain by one.

    ``primitive_nodes`` (n, 8) hold the middle of a box and ``first``, half its size and ``count``, the integers as
    bits; ``primitive_leaves`` the primitives, leaf by leaf (``kernels/geometry/primitive_tree.h``).

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
    kinds = np.searchsorted(kind_end, np.arange(kind_end[Kind.CURVE]), side="right")
    bounded = np.flatnonzero(kinds != Kind.PLANE).astype(np.int32)
    if len(bounded) < max(BREAK_EVEN, 1):
        return None
    parts = np.array_split(bounded, -(-len(bounded) // _AT_ONCE))
    lower, upper = np.concatenate([primitive_bounds(records[part], kinds[part]) for part in parts], axis=1)
    splits = kinds[bounded] == Kind.CURVE
    if movements is not None:
        splits &= movements.of_primitive[bounded, 1] == 0
        for place in np.flatnonzero(movements.of_primitive[bounded, 1]).tolist():
            box, index = (lower[place], upper[place]), int(bounded[place])
            lower[place], upper[place] = _swept(records[index], int(kinds[index]), movements.places(index), box)
    whole, lower, upper = _split_curves(records[bounded[splits]], splits, lower, upper)
    lower32, upper32 = tree_build.outwards(lower, upper)

    def build() -> tuple[NDArray[np.float32], NDArray[np.int32], int]:
        return _build(lower32, upper32, session)

    driver = session.info.name, session.info.driver, session.kind, session.loop_limit
    key = tree_build.builder_identity(), driver, lower32, upper32
    nodes, order, stack = _PRIMITIVES.find_or_make(key, build) if on_disk or len(whole) > tree_build.FEW else build()
    arrays = {"primitive_nodes": nodes, "primitive_leaves": bounded[whole[order]]}
    return arrays, {"HAS_PRIMITIVE_TREE": 1, "PRIMITIVE_STACK": stack}


def _build(
    lower: NDArray[np.float32], upper: NDArray[np.float32], session: Session
) -> tuple[NDArray[np.float32], NDArray[np.int32], int]:
    """Return the same of a new tree."""
    if len(lower) <= tree_build.FEW:
        tree_build.check_boxes(lower, upper)
        tree = tree_build.tree_of_few(lower, upper, LEAF)
    else:
        tree = tree_build.build_bvh(lower, upper, width=2, leaf_size=LEAF, session=session)
    return _nodes(tree), tree.blocks[tree.blocks >= 0], tree_build.stack_size(tree_build.longest_way(tree.children)[0])


def primitive_bounds(records: NDArray[np.void], kinds: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the corners of the boxes (n, 3) of primitives, grown by what rounding may move a hit.

    They are those of the records: of the rows of numbers that rays meet, float32 as they are.
    """
    rows, curves = _rows(records), kinds == Kind.CURVE
    if not curves.any():
        return _bounds_of_rows(rows, kinds)
    lower, upper = np.empty((2, len(rows), 3))
    lower[~curves], upper[~curves] = _bounds_of_rows(rows[~curves], kinds[~curves])
    lower[curves], upper[curves] = _bounds_of_curves(rows[curves], _half_width(records[curves]))
    return lower, upper


def _half_width(records: NDArray[np.void]) -> Array:
    return np.asarray(np.abs(geometry.half_widths(records)).max(axis=1), np.float64)


def _bounds_of_curves(rows: Array, half_width: Array) -> tuple[Array, Array]:
    """Return the boxes of curves by their Bézier points (n, 3, 4), which hold them."""
    farthest = np.abs(rows).max(axis=(1, 2)) + half_width
    margin = (half_width + HIT_ROUNDING * farthest)[:, None]
    return rows.min(axis=2) - margin, rows.max(axis=2) + margin


def _split_curves(
    curves: NDArray[np.void], splits: NDArray[np.bool_], lower: Array, upper: Array
) -> tuple[NDArray[np.int64], Array, Array]:
    """Return boxes round parts of long curves in place of one round each, and of which primitive every box is.

    Parameters
    ----------
    curves
        Records of those that ``splits`` names among all primitives.
    """
    part = np.flatnonzero(splits)
    if not len(part):
        return np.arange(len(splits)), lower, upper
    rows = np.stack([curves[f"row_{axis}"] for axis in "xyz"], axis=1).astype(np.float64)
    wide = (1 + _PART_MARGIN) * _half_width(curves)
    done = [(np.flatnonzero(~splits), lower[~splits], upper[~splits])]
    for _ in range(_MOST_HALVINGS):
        # Halve by de Casteljau what gains by it.
        a, b = (rows[..., :-1] + rows[..., 1:]) / 2, (rows[..., :-2] + 2 * rows[..., 1:-1] + rows[..., 2:]) / 4
        middle = b.mean(axis=2)
        halves = (np.stack([rows[..., 0], a[..., 0], b[..., 0], middle], axis=2),
                  np.stack([middle, b[..., 1], a[..., 2], rows[..., 3]], axis=2))  # fmt: skip
        box, parts = _bounds_of_curves(rows, wide), [_bounds_of_curves(half, wide) for half in halves]
        gains = _area(*parts[0]) + _area(*parts[1]) < _SPLIT_GAIN * _area(*box)
        done.append((part[~gains], box[0][~gains], box[1][~gains]))
        part, wide = np.tile(part[gains], 2), np.tile(wide[gains], 2)
        rows = np.concatenate([half[gains] for half in halves])
    done.append((part, *_bounds_of_curves(rows, wide)))
    whole, low, high = (np.concatenate(each) for each in zip(*done, strict=True))
    return whole, low, high


def _area(lower: Array, upper: Array) -> Array:
    return np.asarray(((upper - lower) * np.roll(upper - lower, 1, axis=1)).sum(axis=1))


def _swept(record: np.void, kind: int, places: geometry.Places, rest: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the corners (3,) of the box round the whole way of a primitive, whose box at rest is known."""
    rows = np.stack([record[f"row_{axis}"] for axis in "xyz"]).astype(np.float64)
    moved = np.tile(rows, (len(places.matrices), 1, 1))
    if kind == Kind.SPHERE:
        moved[:, 0, :3] = places.matrices[:, :3, :3] @ rows[0, :3] + places.matrices[:, :3, 3]
    elif kind == Kind.CURVE:
        moved = places.matrices[:, :3, :3] @ rows + places.matrices[:, :3, 3:]
        half_width = np.full(len(moved), _half_width(record.reshape(1))[0])
        return places.box(*_bounds_of_curves(moved, half_width), rest)
    else:
        moved = moved @ np.linalg.inv(places.matrices)
    return places.box(*_bounds_of_rows(moved, np.full(len(moved), kind)), rest)


def _bounds_of_rows(rows: Array, kinds: NDArray[np.int64]) -> tuple[Array, Array]:
    is_sphere = kinds == Kind.SPHERE
    linear, origin = _placed(rows, is_sphere)
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
    margin = HIT_ROUNDING * (magnified.sum(axis=2).max(axis=1) * farthest)[:, None]
    return lower - margin, upper + margin


def _placed(rows: Array, is_sphere: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the axes (n, 3, 3), as columns, and origins (n, 3) of canonical shapes, from the rows of records."""
    placed = np.tile(np.eye(4), (len(rows), 1, 1))
    placed[:, :3] = rows
    placed[is_sphere] = np.eye(4)
    inverse = np.linalg.inv(placed).astype(np.float64)
    linear, origin = inverse[:, :3, :3], inverse[:, :3, 3]
    linear[is_sphere] *= rows[is_sphere, 0, 3, None, None]
    origin[is_sphere] = rows[is_sphere, 0, :3]
    return linear, origin


def _extent(kind: Kind, x: Array, y: Array, z: Array) -> tuple[Array, Array]:
    """How far a kind's canonical shape, its axes placed as given (n, 3), reaches from its origin."""
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


def _nodes(tree: tree_build.Bvh) -> NDArray[np.float32]:
    """Return the root's node, then the two below each node of a binary tree, the farther along its axis last."""
    bounds = tree.bounds.transpose(0, 2, 1).astype(np.float64)  # (node, child, corner)
    used = tree.children != tree_build.EMPTY
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
    inner, leaf = (children >= 0) & (children != tree_build.EMPTY), children < 0
    links = np.zeros((len(children), 2), np.int64)
    links[inner] = np.stack([1 + 2 * children[inner], ~axis[children[inner]]], axis=1)
    links[leaf] = np.stack([firsts[~children[leaf]], counts[~children[leaf]]], axis=1)
    whole = np.concatenate([bounds[0, :, :3].min(axis=0), bounds[0, :, 3:].max(axis=0)])
    return _pack(np.vstack([whole, corners]), np.vstack([[1, ~axis[0]], links]))


def _pack(corners: Array, links: NDArray[np.int64]) -> NDArray[np.float32]:
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


# Planes that have a whole scene on one side, as the walls of a room or the floor of a hall, stop no light between what
# is in it: light samples leave them out.

_FLAT_KINDS = (Kind.RECTANGLE, Kind.DISK, Kind.PLANE)
_TOUCHES = 1e-6  # of how far something reaches and of the plane's distance from the eye, which float32 has both
_MOST_SOLIDS = 64  # among which planes that nothing lies behind are looked for


def with_outer_planes(plan: Plan, mesh_corners: Array) -> NDArray[np.void]:
    """Return the records of primitives, in which planes that nothing lies behind are marked.

    Nothing is a surface or a lamp; of lamps at infinity all light comes from before the plane. Where much else may lie
    behind, or would take long to look at, records are as they are.

    Parameters
    ----------
    mesh_corners : (n, 3) array
        Of boxes round all meshes [m about the eye].
    """
    records, solids = plan.primitives, int(plan.kind_end[Kind.CONE])
    lamps = plan.emitters.records[: plan.emitters.count]
    has_others = plan.kind_end[Kind.CURVE] > solids or plan.facts["HAS_MOTION"] or plan.facts["HAS_MEDIA"]
    if has_others or solids > _MOST_SOLIDS or (lamps["kind"] == EmitterKind.ENVIRONMENT).any():
        return records
    kinds = _kinds(plan, solids)
    flats = np.flatnonzero(np.isin(kinds, _FLAT_KINDS) & geometry.begins_plane(records[:solids]))
    if not len(flats):
        return records
    rows = _rows(records[:solids])
    normals, shifts = rows[flats, 2, :3], rows[flats, 2, 3]
    low, high = _heights(rows, kinds, normals)
    points = np.concatenate([mesh_corners, lamps["a"][np.isin(lamps["kind"], list(SIZELESS_EMITTERS)), :3]])
    low, high = (np.concatenate([some, normals @ points.T], axis=1) + shifts[:, None] for some in (low, high))
    # What its own rounding may move each: a share of all would let a lamp shine through a wide ground.
    reach = np.maximum(-low, high)
    margin = _TOUCHES * (np.where(np.isfinite(reach), reach, 0) + np.abs(shifts[:, None]))
    suns = lamps[np.isin(lamps["kind"], (EmitterKind.DIRECTIONAL, EmitterKind.SUN))]
    from_above, radii = normals @ suns["normal"][:, :3].T, np.sqrt(suns["a"][:, 3])
    above = (low >= -margin).all(axis=1) & (from_above >= radii).all(axis=1)
    below = (high <= margin).all(axis=1) & (from_above <= -radii).all(axis=1)
    marked = records.copy()
    geometry.mark_outer_planes(marked, flats[above | below])
    return marked


def _heights(rows: Array, kinds: NDArray[np.int64], normals: Array) -> tuple[Array, Array]:
    """Return how low and how high primitives (n) reach along directions (m, 3): two arrays (m, n)."""
    linear, origin = _placed(rows, kinds == Kind.SPHERE)
    along = np.einsum("mi,nij->jmn", normals, linear)
    low = normals @ origin.T
    high = low.copy()
    for kind in set(kinds.tolist()):
        own = kinds == kind
        if kind == Kind.PLANE:  # has no end but along its normal
            reach = np.where((np.abs(along[:2, :, own]) <= HIT_ROUNDING).all(axis=0), 0.0, np.inf)
            ends = -reach, reach
        else:
            ends = _extent(Kind(kind), *along[:, :, own])
        low[:, own] += ends[0]
        high[:, own] += ends[1]
    return low, high


def _kinds(plan: Plan, count: int) -> NDArray[np.int64]:
    return np.searchsorted(plan.kind_end, np.arange(count), side="right")


def _rows(records: NDArray[np.void]) -> Array:
    return np.stack([records[f"row_{axis}"] for axis in "xyz"], axis=1).astype(np.float64)


# Flat primitives and boxes along the axes of the world: kernels/geometry/aligned.h.

_NO_ANGLE = 1e-9  # what quarter turns leave of a sine or cosine of nothing
_FEWEST_ALONE = 3  # flat primitives that gain by what all of them share, where there is no box


def aligned(plan: Plan) -> DeviceTree:
    """Make the records of what lies along the axes, where all flat primitives or all boxes do and nothing moves."""
    count = int(plan.kind_end[Kind.BOX])
    kinds, rows = _kinds(plan, count), _rows(plan.primitives[:count])
    used = np.abs(rows[:, :, :3]) > _NO_ANGLE * np.abs(rows[:, :, :3]).max(axis=2, keepdims=True)
    single = (used.sum(axis=2) == 1) & (used.sum(axis=1) == 1)
    is_flat, is_box = np.isin(kinds, _FLAT_KINDS), kinds == Kind.BOX
    is_aligned = np.where(kinds == Kind.PLANE, used[:, 2].sum(axis=1) == 1, single.all(axis=1))
    boxes = bool(is_box.any()) and bool(is_aligned[is_box].all())
    flats = int(is_flat.sum()) >= (1 if boxes else _FEWEST_ALONE) and bool(is_aligned[is_flat].all())
    if plan.facts["HAS_MOTION"] or not (boxes or flats):
        return {}, {}
    records = ALIGNED.zeros(count)
    if flats:
        _fill_flats(records, rows, np.flatnonzero(is_flat))
    if boxes:
        own, own_used = rows[is_box], used[is_box]
        scale, shift = (own[:, :, :3] * own_used).sum(axis=1), (own[:, :, 3:] * own_used).sum(axis=1)
        records["place"][is_box, :3], records["reach"][is_box, :3] = -shift / scale, 1 / np.abs(scale)
    return {"aligned": records}, {"ALIGNED_FLATS": int(flats), "ALIGNED_BOXES": int(boxes)}


def _fill_flats(records: NDArray[np.void], rows: Array, flats: NDArray[np.int64]) -> None:
    for index in flats.tolist():
        x, y, normal = rows[index]
        axis = int(np.abs(normal[:3]).argmax())
        first, second = (axis + 1) % 3, (axis + 2) % 3
        one, other = (x, y) if abs(x[first]) > abs(y[first]) else (y, x)
        records[index]["axis"] = axis
        records[index]["place"][0] = -normal[3] / normal[axis]
        records[index]["reach"] = one[first], one[3], other[second], other[3]
