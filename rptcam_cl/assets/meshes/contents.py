"""What a mesh file holds: surfaces, their materials, where each is placed, and the further files it names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace
from itertools import product
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes.clean import NOTHING_DROPPED, Dropped
from rptcam_cl.assets.meshes.file_material import FileMaterial
from rptcam_cl.assets.meshes.mesh import Mesh, MeshSurface, NormalsMode, make_mesh
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.references import open_regular


@dataclass(frozen=True, eq=False)
class MeshPlacement:
    """A mesh at its place in the file.

    Attributes
    ----------
    mesh : Mesh
    placement : (4, 4) float64
        From the mesh's coordinates, its origin included, to the file's.
    material : FileMaterial or None
        None where the file does not say.
    name : str or None
    """

    mesh: Mesh
    placement: NDArray[np.float64]
    material: FileMaterial | None = None
    name: str | None = None

    def corners(self) -> NDArray[np.float64]:
        """Return the eight corners (8, 3) of the mesh's bounds, placed."""
        corners = np.array(list(product(*zip(*self.mesh.bounds(), strict=True))))
        return np.asarray(corners @ self.placement[:3, :3].T + self.placement[:3, 3])


@dataclass(frozen=True, eq=False)
class MeshContents:
    """Everything that a mesh file holds.

    Attributes
    ----------
    parts : tuple of PlacedMesh
    dropped : Dropped
        How many triangles could not be used.
    notes : tuple of str
        What of the file is left out, triangles included.
    """

    parts: tuple[MeshPlacement, ...]
    dropped: Dropped = NOTHING_DROPPED
    notes: tuple[str, ...] = ()

    def with_normals(self, mode: NormalsMode) -> MeshContents:
        """Return the contents with the normals of a mode; parts that shared a mesh still do."""
        if mode == "auto":
            return self
        return self._with_meshes({mesh: mesh.with_normals(mode) for mesh in {part.mesh for part in self.parts}})

    def sharing(self, known: dict[str, Mesh]) -> MeshContents:
        """Return the contents with meshes that are known by their hash in place of equal ones; others become known."""
        meshes = {part.mesh for part in self.parts}
        return self._with_meshes({mesh: known.setdefault(mesh.content_hash, mesh) for mesh in meshes})

    def _with_meshes(self, changed: dict[Mesh, Mesh]) -> MeshContents:
        return replace(self, parts=tuple(replace(part, mesh=changed[part.mesh]) for part in self.parts))


LAMPS_LEFT_OUT = "lamps are left out of an object; `rptcam new` makes a scene with them"  # a note of a file


class Node(NamedTuple):
    """A surface at its place in the file."""

    surface: int
    placement: NDArray[np.float64]
    name: str | None


@dataclass(frozen=True, eq=False)
class Draft:
    """What a reader finds in a file.

    Attributes
    ----------
    surfaces : list of Surface
    materials : list of FileMaterial
        What `MeshSurface.material` counts.
    nodes : list of Node
        Where the surfaces are; each at its own coordinates when empty.
    notes : list of str
        What of the file is left out.
    """

    surfaces: list[MeshSurface]
    materials: list[FileMaterial] = field(default_factory=list)
    nodes: list[Node] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def make_contents(draft: Draft, place: str) -> MeshContents:
    """Return the contents of a file from what its reader found.

    Raises
    ------
    InputError
        When no triangle is left.
    """
    nodes = draft.nodes or [Node(index, np.eye(4), surface.name) for index, surface in enumerate(draft.surfaces)]
    dropped = NOTHING_DROPPED
    meshes: dict[int, Mesh | None] = {}
    for index in dict.fromkeys(index for index, _, _ in nodes):
        meshes[index], lost = make_mesh(draft.surfaces[index], place)
        dropped = dropped.plus(lost)
    parts = [
        MeshPlacement(mesh, placement, _material(draft, index, mesh), name)
        for index, placement, name in nodes
        if (mesh := meshes[index]) is not None
    ]
    if not parts:
        raise InputError(f"{place}: has no triangle that can be shown (dropped: {dropped})")
    notes = [*draft.notes, f"{place}: triangles dropped: {dropped}"] if any(dropped) else draft.notes
    return MeshContents(tuple(parts), dropped, tuple(notes))


def _material(draft: Draft, surface: int, mesh: Mesh) -> FileMaterial | None:
    material = draft.surfaces[surface].material
    if material is None:
        return None
    return draft.materials[material] if mesh.uvs is not None else draft.materials[material].without_textures()


LARGEST_MESH = 16 << 30  # bytes

# Returns the checked path of a file given relative to the mesh file.
Find = Callable[[Path], Path]


def open_mesh(path: Path) -> BinaryIO:
    """Return a mesh file opened for reading.

    Raises
    ------
    InputError
        When it is not a regular file of bearable size.
    StateError
        When it cannot be opened.
    """
    try:
        return open_regular(path, LARGEST_MESH)
    except (InputError, StateError) as problem:
        raise type(problem)(f"{path}: {problem}") from None
