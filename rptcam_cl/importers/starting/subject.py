"""What a new scene shows: the points of a model, what its file says of cameras and lamps, and what a ray meets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.assets.meshes import (
    LAMPS_LEFT_OUT,
    GltfCamera,
    GltfLight,
    GltfWorld,
    MeshPlacement,
    read_gltf_world,
    read_mesh_file,
)
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.references import Folders, named_files
from rptcam_cl.scene import load_scene

Array = NDArray[np.float64]
MOST_POINTS = 20_000  # of a part, which say how large it looks to a hundredth of a per cent
GLTF = (".gltf", ".glb")


@dataclass(frozen=True)
class Subject:
    """What is to be shown.

    Attributes
    ----------
    points : (n, 3) array
        Vertices, in scene units; of large meshes some of them, the outermost of each axis included.
    triangles : (m, 3, 3) array
        Corners of the triangles.
    cameras, lights : list
        Of a glTF file.
    notes : tuple of str
        What of the file is left out.
    files : frozenset of Path
        Files that were read.
    bare : bool
        Whether the file says nothing of its material.
    objects : tuple of dict
        Objects of a scene that are it, where no file is.
    """

    points: Array
    triangles: Array
    cameras: list[GltfCamera]
    lights: list[GltfLight]
    notes: tuple[str, ...] = ()
    files: frozenset[Path] = frozenset()
    bare: bool = False
    objects: tuple[dict[str, Any], ...] = ()

    @property
    def bounds(self) -> tuple[Array, Array]:
        """The lowest and the highest corner."""
        return self.points.min(axis=0), self.points.max(axis=0)

    def first_hit(self, origin: Array, direction: Array) -> float | None:
        """Return how far along a ray its first triangle is (Möller and Trumbore 1997), None where it meets none."""
        first, along = self.triangles[:, 0], self.triangles[:, 1:] - self.triangles[:, :1]
        across = np.cross(direction, along[:, 1])
        scale = np.einsum("ij,ij->i", along[:, 0], across)
        with np.errstate(all="ignore"):
            away = origin - first
            u = np.einsum("ij,ij->i", away, across) / scale
            turned = np.cross(away, along[:, 0])
            v = turned @ direction / scale
            distance = np.einsum("ij,ij->i", along[:, 1], turned) / scale
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
        return float(distance[met].min()) if met.any() else None


def read_subject(path: Path) -> Subject:
    """Return what a mesh file shows.

    Raises
    ------
    InputError
        When it cannot be used as an object of a scene.
    """
    real = path.resolve()
    if not real.is_file():
        raise InputError(f"{path}: {'is not a regular file' if real.exists() else 'no such file'}")
    folders = Folders(real.parent, owner="model")
    with named_files() as files:
        contents = read_mesh_file(real, folders.find_beside(real))
        gltf = read_gltf_world(real) if real.suffix.lower() in GLTF else GltfWorld()
        bare = any(part.material is None for part in contents.parts)
        missing = () if bare else _missing_pictures(real)
    points, triangles = zip(*map(_placed, contents.parts), strict=True)
    return Subject(
        points=_fewer(np.concatenate(points)),
        triangles=np.concatenate(triangles),
        cameras=gltf.cameras,
        lights=gltf.lights,
        notes=(*(note for note in contents.notes if not note.endswith(LAMPS_LEFT_OUT)), *gltf.notes, *missing),
        files=frozenset(files),
        bare=bare,
    )


def _missing_pictures(path: Path) -> tuple[str, ...]:
    """Return which pictures of a model's materials are missing; those that are there become known as named files."""
    camera = {"kind": "pinhole", "eye": [0, 0, 1], "target": [0, 0, 0], "fov_degrees": 40}
    shown = {"camera": camera, "objects": [{"shape": "mesh", "file": path.name}]}
    return load_scene(shown, base_dir=path.parent, missing="grey").stand_ins


def _placed(part: MeshPlacement) -> tuple[Array, Array]:
    """Return points and triangles of a part in the frame of its file."""
    mesh = part.mesh
    vertices = (mesh.positions + mesh.origin) @ part.placement[:3, :3].T + part.placement[:3, 3]
    used = vertices[np.unique(mesh.faces)]
    return _fewer(used), vertices[mesh.faces]


def _fewer(points: Array) -> Array:
    """Return at most `MOST_POINTS` of many points, and the outermost of each axis."""
    ends = points[np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])]
    return np.concatenate([points[:: 1 + len(points) // MOST_POINTS], ends])
