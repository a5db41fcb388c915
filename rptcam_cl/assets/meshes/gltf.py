"""glTF 2.0 files, .gltf and .glb: meshes, their places in the tree of nodes, and materials."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.contents import LAMPS_LEFT_OUT, Draft, Find, Node
from rptcam_cl.assets.meshes.faces import Polygons, check_corners
from rptcam_cl.assets.meshes.gltf_data import Data, read_container
from rptcam_cl.assets.meshes.gltf_json import JsonNode
from rptcam_cl.assets.meshes.gltf_materials import FOLLOWED, WEBP, GltfMaterials
from rptcam_cl.assets.meshes.gltf_packed import DRACO, MESHOPT
from rptcam_cl.assets.meshes.gltf_vertices import FAN, STRIP, TRIANGLES, Vertices
from rptcam_cl.assets.meshes.mesh import MeshSurface
from rptcam_cl.core.errors import InputError

# Extensions that a file may require. What others do not require and are not listed here is left out.
LIGHTS, VARIANTS, INSTANCES = "KHR_lights_punctual", "KHR_materials_variants", "EXT_mesh_gpu_instancing"
KNOWN_EXTENSIONS = (
    *FOLLOWED, DRACO, MESHOPT, INSTANCES, VARIANTS, WEBP, LIGHTS, "KHR_mesh_quantization", "KHR_texture_transform",
)  # fmt: skip


def read_gltf(path: Path, find: Find) -> Draft:
    """Return the surfaces of a glTF file, one for each triangle primitive, and a part for each node that shows one.

    Raises
    ------
    InputError
        When the file is not as glTF 2.0 says, needs an extension that is not read, or shows no triangles.
    """
    document, binary = read_container(path)
    _check_version(document, path)
    data = Data(document, binary, path.parent, find)
    materials = GltfMaterials(document, data)
    meshes = document.parts("meshes")
    surfaces: list[MeshSurface] = []
    places: dict[int, list[int]] = {}
    nodes: list[Node] = []
    for mesh, placement, name in placed_meshes(document, data):
        if mesh not in places:
            found = _surfaces(meshes[mesh], data, materials)
            places[mesh] = list(range(len(surfaces), len(surfaces) + len(found)))
            surfaces += found
        nodes += [Node(index, placement, name or surfaces[index].name) for index in places[mesh]]
    if not nodes:
        raise InputError(f"{path}: its scene shows no triangles")
    return Draft(surfaces, materials.materials, nodes, [*materials.notes, *_left_out(document)])


def _check_version(document: JsonNode, path: Path) -> None:
    version = document.part("asset").text("version")
    if version.split(".")[0] != "2":
        raise InputError(f"{path}: is not glTF 2.0 (got version {version or 'none'!s}; allowed: 2.0)")
    if missing := [name for name in document.texts("extensionsRequired") if name not in KNOWN_EXTENSIONS]:
        got, allowed = ", ".join(missing), ", ".join(KNOWN_EXTENSIONS)
        raise InputError(f"{path}: needs extensions that are not read (got {got}; allowed: {allowed})")


def _left_out(document: JsonNode) -> list[str]:
    """Return what of a file is left out that changes its picture."""
    primitives = [primitive for mesh in document.parts("meshes") for primitive in mesh.parts("primitives")]
    found = {
        LAMPS_LEFT_OUT: any(part.parts("lights") for part in document.extensions(LIGHTS)),
        "skins are left out": bool(document.parts("skins")),
        "animations are left out": bool(document.parts("animations")),
        "morph targets are left out": any(primitive.has("targets") for primitive in primitives),
        "variants of materials are left out; the default materials show": VARIANTS in document.texts("extensionsUsed"),
    }
    return [f"{document.place}: {text}" for text, there in found.items() if there]


def _surfaces(mesh: JsonNode, data: Data, materials: GltfMaterials) -> list[MeshSurface]:
    name = mesh.text("name") or None
    found = [_surface(primitive, data, materials, name) for primitive in mesh.parts("primitives")]
    return [surface for surface in found if surface is not None]


def _surface(primitive: JsonNode, data: Data, materials: GltfMaterials, name: str | None) -> MeshSurface | None:
    """Return the triangles of a primitive, None when it has none."""
    mode = primitive.whole("mode", TRIANGLES)
    if mode not in (TRIANGLES, STRIP, FAN):
        return None
    vertices = Vertices(primitive, data)
    positions = vertices.rows("POSITION", ("VEC3",))
    if positions is None:
        return None
    material = materials.index(primitive)
    uvs = vertices.rows(f"TEXCOORD_{materials.uv_sets[material]}", ("VEC2",))
    corners = vertices.corners(mode)
    if not len(corners):
        return None
    check_corners(Polygons(np.arange(len(corners)), corners), len(positions), f"{primitive.place}: face")
    surface = MeshSurface(
        positions,
        corners,
        vertices.rows("NORMAL", ("VEC3",)),
        None if uvs is None else np.column_stack([uvs[:, 0], 1 - uvs[:, 1]]),
        material,
        name,
    )
    colours = vertices.rows("COLOR_0", ("VEC3", "VEC4"))
    return surface if colours is None else materials.painted(surface, colours[:, :3], primitive)


# Ratio of the smallest to the largest stretch of a transform that can be inverted in float32 (as for objects).
SMALLEST_STRETCH_RATIO = 1e-6


def placed_meshes(document: JsonNode, data: Data) -> Iterator[tuple[int, NDArray[np.float64], str | None]]:
    """Yield the meshes of the default scene with their placement and name, parents before children."""
    meshes = len(document.parts("meshes"))
    for node, parent in placed_nodes(document):
        if not node.has("mesh"):
            continue
        for instance in _instances(node, data):
            placement = parent @ instance
            if _can_be_shown(placement, node):
                yield node.whole("mesh", below=meshes), placement, node.text("name") or None


def _instances(node: JsonNode, data: Data) -> list[NDArray[np.float64]]:
    """Return the placements of a node's mesh below the node: those of EXT_mesh_gpu_instancing, or one."""
    for extension in node.extensions(INSTANCES):
        attributes = extension.part("attributes")
        given = {
            key: data.array(attributes.whole(key, below=data.count), (kind,)).astype(np.float64)
            for key, kind in (("TRANSLATION", "VEC3"), ("ROTATION", "VEC4"), ("SCALE", "VEC3"))
            if attributes.has(key)
        }
        if len({len(rows) for rows in given.values()}) > 1:
            raise InputError(f"{attributes.place}: TRANSLATION, ROTATION and SCALE are not of one length")
        rows = {key.lower(): values.tolist() for key, values in given.items()}
        count = min((len(values) for values in rows.values()), default=1)
        return [
            _matrix(JsonNode({key: values[index] for key, values in rows.items()}, f"{attributes.place}[{index}]"))
            for index in range(count)
        ]
    return [np.eye(4)]


def placed_nodes(document: JsonNode) -> Iterator[tuple[JsonNode, NDArray[np.float64]]]:
    """Yield the nodes of the default scene and where each is in the file, parents before children."""
    nodes = document.parts("nodes")
    waiting = [(index, np.eye(4)) for index in reversed(_roots(document, nodes))]
    seen: set[int] = set()
    while waiting:
        index, parent = waiting.pop()
        node = nodes[index]
        if index in seen:
            raise InputError(f"{node.place}: is reached twice (allowed: a tree of nodes)")
        seen.add(index)
        with np.errstate(over="ignore", invalid="ignore"):  # refused where a mesh is shown
            placement = parent @ _matrix(node)
        waiting += [(child, placement) for child in reversed(node.wholes("children", below=len(nodes)))]
        yield node, placement


def _roots(document: JsonNode, nodes: list[JsonNode]) -> list[int]:
    scenes = document.parts("scenes")
    if scenes:
        return scenes[document.whole("scene", 0, below=len(scenes))].wholes("nodes", below=len(nodes))
    children = {child for node in nodes for child in node.wholes("children", below=len(nodes))}
    return [index for index in range(len(nodes)) if index not in children]


def _matrix(node: JsonNode) -> NDArray[np.float64]:
    """Return the transform of a node: its matrix (by columns), or scale, then rotation, then translation."""
    if node.has("matrix"):
        matrix = np.array(node.numbers("matrix", (0.0,) * 16)).reshape(4, 4).T
        if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-6):
            raise node.wrong("matrix", "is not affine", "a last row of 0 0 0 1")
        matrix[3] = (0, 0, 0, 1)
        return np.asarray(matrix)
    result = np.eye(4)
    x, y, z, w = node.numbers("rotation", (0.0, 0.0, 0.0, 1.0))
    length = np.sqrt(x * x + y * y + z * z + w * w)
    if not length > 0:
        raise node.wrong("rotation", "is the zero quaternion", "a unit quaternion")
    x, y, z, w = x / length, y / length, z / length, w / length
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    result[:3, :3] = turn * node.numbers("scale", (1.0, 1.0, 1.0))
    result[:3, 3] = node.numbers("translation", (0.0, 0.0, 0.0))
    return result


def _can_be_shown(placement: NDArray[np.float64], node: JsonNode) -> bool:
    """Return whether a mesh has a size there; refuse a place that flattens space."""
    if not np.isfinite(placement).all():
        raise InputError(f"{node.place}: its transform is beyond floating point")
    stretches = np.linalg.svd(placement[:3, :3], compute_uv=False)
    if stretches[0] == 0:
        return False
    if stretches[-1] < SMALLEST_STRETCH_RATIO * stretches[0]:
        allowed = f"stretches whose ratio is at least {SMALLEST_STRETCH_RATIO:g}"
        raise InputError(f"{node.place}: its transform flattens space (allowed: {allowed})")
    return True
