"""glTF 2.0 files, .gltf and .glb: meshes, their places in the tree of nodes, and materials."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.errors import InputError
from rptcam_cl.mesh_files.contents import Draft, Node
from rptcam_cl.mesh_files.faces import Polygons, check_corners
from rptcam_cl.mesh_files.find import Find
from rptcam_cl.mesh_files.gltf_data import Data, read_container
from rptcam_cl.mesh_files.gltf_json import Part
from rptcam_cl.mesh_files.gltf_materials import FOLLOWED, Materials
from rptcam_cl.mesh_files.gltf_nodes import placed_meshes
from rptcam_cl.mesh_files.mesh import Surface

TRIANGLES, STRIP, FAN = 4, 5, 6

# Extensions that a file may require. What others do not require and are not listed here is left out.
KNOWN_EXTENSIONS = (*FOLLOWED, "KHR_mesh_quantization", "KHR_texture_transform")


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
    materials = Materials(document, data)
    meshes = document.parts("meshes")
    surfaces: list[Surface] = []
    places: dict[int, list[int]] = {}
    nodes: list[Node] = []
    for mesh, placement, name in placed_meshes(document):
        if mesh not in places:
            found = _surfaces(meshes[mesh], data, materials, path)
            places[mesh] = list(range(len(surfaces), len(surfaces) + len(found)))
            surfaces += found
        nodes += [Node(index, placement, name or surfaces[index].name) for index in places[mesh]]
    if not nodes:
        raise InputError(f"{path}: its scene shows no triangles")
    return Draft(surfaces, materials.looks, nodes, [*materials.notes, *_left_out(document)])


def _check_version(document: Part, path: Path) -> None:
    version = document.part("asset").text("version")
    if version.split(".")[0] != "2":
        raise InputError(f"{path}: is not glTF 2.0 (got version {version or 'none'!s}; allowed: 2.0)")
    if missing := [name for name in document.texts("extensionsRequired") if name not in KNOWN_EXTENSIONS]:
        got, allowed = ", ".join(missing), ", ".join(KNOWN_EXTENSIONS)
        raise InputError(f"{path}: needs extensions that are not read (got {got}; allowed: {allowed})")


def _left_out(document: Part) -> list[str]:
    """Return what of a file is left out that changes its looks."""
    primitives = [primitive for mesh in document.parts("meshes") for primitive in mesh.parts("primitives")]
    found = {
        "skins": bool(document.parts("skins")),
        "animations": bool(document.parts("animations")),
        "morph targets": any(primitive.has("targets") for primitive in primitives),
        "colours of vertices": any(primitive.part("attributes").has("COLOR_0") for primitive in primitives),
        "instances of EXT_mesh_gpu_instancing": "EXT_mesh_gpu_instancing" in document.texts("extensionsUsed"),
    }
    return [f"{document.place}: {name} are left out" for name, there in found.items() if there]


def _surfaces(mesh: Part, data: Data, materials: Materials, path: Path) -> list[Surface]:
    name = mesh.text("name") or None
    found = [_surface(primitive, data, materials, name) for primitive in mesh.parts("primitives")]
    return [surface for surface in found if surface is not None]


def _surface(primitive: Part, data: Data, materials: Materials, name: str | None) -> Surface | None:
    """Return the triangles of a primitive, None when it has none."""
    mode = primitive.whole("mode", TRIANGLES)
    if mode not in (TRIANGLES, STRIP, FAN):
        return None
    attributes = primitive.part("attributes")
    if not attributes.has("POSITION"):
        return None
    positions = _attribute(attributes, "POSITION", data, ("VEC3",), None)
    assert positions is not None
    material = materials.index(primitive)
    uvs = _attribute(attributes, f"TEXCOORD_{materials.uv_sets[material]}", data, ("VEC2",), len(positions))
    corners = _corners(primitive, data, len(positions), mode)
    if not len(corners):
        return None
    check_corners(Polygons(np.arange(len(corners)), corners), len(positions), f"{primitive.place}: face")
    return Surface(
        positions,
        corners,
        _attribute(attributes, "NORMAL", data, ("VEC3",), len(positions)),
        None if uvs is None else np.column_stack([uvs[:, 0], 1 - uvs[:, 1]]),
        material,
        name,
    )


def _attribute(
    attributes: Part, key: str, data: Data, types: tuple[str, ...], count: int | None
) -> NDArray[Any] | None:
    """Return the numbers of an attribute in float32, None when it is not there."""
    if not attributes.has(key):
        return None
    rows = data.array(attributes.whole(key, below=data.count), types)
    if count is not None and len(rows) != count:
        raise attributes.wrong(key, f"has {len(rows)} entries", f"{count}, as POSITION has")
    return rows.astype(np.float32, copy=False)


def _corners(primitive: Part, data: Data, vertices: int, mode: int) -> NDArray[np.int64]:
    """Return the vertices of each triangle (m, 3)."""
    if primitive.has("indices"):
        order = data.array(primitive.whole("indices", below=data.count), ("SCALAR",))[:, 0]
        if order.dtype.kind != "u":
            raise primitive.wrong("indices", "are not whole numbers", "an accessor of unsigned numbers")
    else:
        order = np.arange(vertices)
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    count = max(0, len(order) - 2)
    first = np.arange(count)
    if mode == FAN:
        return np.stack([order[first * 0], order[first + 1], order[first + 2]], axis=1)
    odd = first % 2
    return np.stack([order[first + odd], order[first + 1 - odd], order[first + 2]], axis=1)
