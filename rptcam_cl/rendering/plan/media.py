"""Media as the kernels read them: records, grids of density, the medium in each solid, and those around the camera."""

from __future__ import annotations

import io
from collections.abc import Collection, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, near_name
from rptcam_cl.core.files import read_whole
from rptcam_cl.core.records import DENSITY_BLOCK, MEDIUM, Hidden, fill
from rptcam_cl.core.remember import Memory
from rptcam_cl.rendering.cameras.kinds import camera_of
from rptcam_cl.rendering.plan.materials import Materials
from rptcam_cl.rendering.plan.primitives import Primitives, Prototype
from rptcam_cl.rendering.plan.textures import KnownSpectra
from rptcam_cl.scene.base import describe, listed
from rptcam_cl.scene.camera import pose_matrix
from rptcam_cl.scene.materials import Boundary, Dielectric, Material, Mix, Principled, has_holes
from rptcam_cl.scene.media import DensityGrid, Droplets, ScatteringMedium
from rptcam_cl.scene.scene import Scene, Solid, holds_eye, shines, world_corners
from rptcam_cl.scene.shapes import Object, Plane

_MOST_MEDIA = 31  # whose numbers fit into MEDIUM_BITS of kernels/material/medium.h, 0 being empty space
MEDIUM_BITS = 5
_MOST_NESTED = 4
_NOT_SOLID = -1
EMPTY = ScatteringMedium.model_construct()  # whose validator need not be made for it


@dataclass(frozen=True)
class Media:
    """The media of a scene.

    Attributes
    ----------
    records : array of Medium
        By number; the first is empty space.
    numbers : dict of str to int
        By their content, that round all first.
    at_camera : int
        Those where the camera's rays begin, as the stack of ``kernels/material/medium.h``.
    active : bool
        Whether there are any.
    densities : array of float32
        Of all grids: their voxels, x first, then the least, greatest and mean density of each block.
    steps : float
        That a ray takes through all grids, in the mean over random numbers, where it takes most.
    """

    records: NDArray[np.void]
    numbers: dict[str, int] = field(default_factory=dict)
    at_camera: int = 1 << MEDIUM_BITS
    active: bool = False
    densities: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    steps: float = 0.0

    @property
    def has_glow(self) -> bool:
        """Whether any of them shines."""
        return bool(self.records["emission"][:, :3].any())

    @property
    def facts(self) -> dict[str, int]:
        """Whether the kernels must know of media, and of what kinds."""
        return {
            "HAS_MEDIA": int(self.active),
            "HAS_LAYERED_FOG": int(self.records["layer"].any()),
            "HAS_DENSITY": int(self.densities.size > 0),
            "HAS_DROPLETS": int(self.records["droplets"].any()),
        }


def _interior_of(material: Material) -> ScatteringMedium | None:
    """Find the medium inside of a solid of a material, empty space perhaps; None where it is no solid's."""
    solid = isinstance(material, Dielectric | Boundary) or (
        isinstance(material, Principled) and material.transmission != 0
    )
    if not solid:
        return None
    assert isinstance(material, Dielectric | Boundary | Principled)
    if material.interior is not None:
        return material.interior
    return ScatteringMedium(absorption_per_m=material.absorption) if max(material.absorption) > 0 else EMPTY


def pack_media(
    scene: Scene, primitives: Primitives, shown: Materials, spectra: KnownSpectra
) -> tuple[Media, Materials]:
    """Return the media of a scene and its materials, which know the media inside of solids.

    Absorption in solids becomes a medium where there is any other.

    Raises
    ------
    InputError
        For what does not go with media.
    """
    materials = {id(each.material): each.material for each in primitives.prototypes}
    for material in [*materials.values()]:
        if isinstance(material, Mix):
            materials |= {id(part): part for part in material.materials}
    own = [getattr(material, "interior", None) for material in materials.values()]
    if scene.medium is None and not any(each is not None for each in own):
        return Media(MEDIUM.zeros(1)), shown
    _check(scene, primitives, materials.values())
    found, numbers = [EMPTY], {_key_of(EMPTY, scene): 0}
    for medium in (scene.medium, *map(_interior_of, materials.values())):
        if medium is not None and numbers.setdefault(_key_of(medium, scene), len(found)) == len(found):
            found.append(medium)
    if len(found) > _MOST_MEDIA + 1:
        raise InputError(f"the scene has {len(found) - 1} different media (allowed: {_MOST_MEDIA})")
    records = shown.records.copy()
    records["interior"] = _NOT_SOLID
    for key, material in materials.items():
        records["interior"][shown.index[key]] = _number_in(material, numbers, scene)
    shown = replace(shown, records=records, facts=shown.facts | {"HAS_ABSORPTION": 0})
    records, densities, steps = _records(found, spectra, scene)
    media = Media(records, numbers, active=True, densities=densities, steps=steps)
    _check_nesting(scene, media)
    _mark_shade(scene, media)
    return media, shown


def _number_in(material: Material, numbers: dict[str, int], scene: Scene) -> int:
    """Return the number of the medium inside of a solid of a material; -1 where it is no solid's."""
    if not isinstance(material, Mix):
        medium = _interior_of(material)
        return _NOT_SOLID if medium is None else numbers[_key_of(medium, scene)]
    inside = {_number_in(part, numbers, scene) for part in material.materials} - {_NOT_SOLID}
    if len(inside) > 1:
        raise InputError("materials of a mix: two solids with different media inside (allowed: the same one)")
    return inside.pop() if inside else _NOT_SOLID


def _key_of(medium: ScatteringMedium, scene: Scene) -> str:
    return str({name: value for name, value in describe(medium, scene.folders).items() if value is not None})


def hidden_from(prototype: Prototype) -> int:
    """Return the rays that primitives are hidden from, also as those that are nothing but the boundary of a medium."""
    is_boundary = isinstance(prototype.material, Boundary)
    return prototype.hidden | is_boundary * (Hidden.FROM_SHADOW | Hidden.FROM_ALL_BUT_WAYS)


def _records(
    media: Sequence[ScatteringMedium], spectra: KnownSpectra, scene: Scene
) -> tuple[NDArray[np.void], NDArray[np.float32], float]:
    """Return the records of media, the densities of their grids, and `Media.steps`."""
    records, densities, used, steps = MEDIUM.zeros(len(media)), [np.zeros(0, np.float32)], 0, 0.0
    for record, medium in zip(records, media, strict=True):
        absorption, scattering, emission = medium.absorption, medium.scattering, medium.emission_per_m
        fill(
            record, asymmetry=medium.mean_cosine, absorption=(*absorption, spectra.number(absorption)),
            scattering=(*scattering, spectra.number(scattering)), by_entry=medium.by_entry,
            emission=(*emission, spectra.number(emission, light=True)), voxels=-1,
        )  # fmt: skip
        if medium.droplets_um is not None:
            asymmetry, *droplets = Droplets.of(medium.droplets_um)
            fill(record, asymmetry=asymmetry, droplets=(*droplets, 0.0))
        if (layer := getattr(medium, "layer", None)) is not None:
            fill(record, layer=layer.scale_heights(scene.camera.eye, scene.metres_per_unit))
        if medium.density is not None:
            volume = load_density(medium.density, scene)
            _fill_grid(record, medium.density, volume, scene, used)
            densities += [volume.voxels.reshape(-1), volume.blocks.reshape(-1)]
            used += volume.voxels.size + volume.blocks.size
            steps += _steps_through(record, volume)
    if used >= 1 << 31:
        raise InputError(f"grids of density have {used} numbers in all (allowed: below {1 << 31})")
    return records, np.concatenate(densities), steps


# Grids of density.

_MOST_VOXELS = 1 << 29  # 2 GiB
_EVENTS_WHERE_IT_SHINES = 8.0  # along the longest side of a grid, at least
_VOLUMES: Memory[Volume] = Memory(most_bytes=1 << 30)  # by content


@dataclass(frozen=True, eq=False)
class Volume:
    """Densities of a grid.

    Attributes
    ----------
    voxels : (nz, ny, nx) array of float32
    blocks : (bz, by, bx, 3) array of float32
        The least, greatest and mean density in blocks of `DENSITY_BLOCK` voxels a side, between voxels as well.
    box : (2, 3) array or None
        Corners where the file says [scene units].
    """

    voxels: NDArray[np.float32]
    blocks: NDArray[np.float32]
    box: NDArray[np.float64] | None

    @property
    def nbytes(self) -> int:
        """Size in memory."""
        return self.voxels.nbytes + self.blocks.nbytes


def load_density(density: DensityGrid, scene: Scene) -> Volume:
    """Return the densities of a grid's file, remembered by its content.

    Raises
    ------
    InputError
        The file is no grid of densities; the message says where the scene names it.
    """

    def read() -> Volume:
        try:
            source = density.source(scene.folders)
            is_vdb = not isinstance(source, bytes) and source.suffix.lower() == ".vdb"
            voxels, box = _read_vdb(source, density.grid) if is_vdb else _read_array(source, density)
            return Volume(*_with_blocks(voxels), box)
        except InputError as problem:
            raise InputError(f"{density.place}{problem}") from None

    return _VOLUMES.find_or_make((scene.digest_of(density), density.grid), read)


def _read_array(source: Path | bytes, density: DensityGrid) -> tuple[NDArray[Any], None]:
    """Return the numbers of a `.npy` file as (x, y, z)."""
    try:
        numbers = np.load(io.BytesIO(read_whole(source, 4 * _MOST_VOXELS)), allow_pickle=False)
    except (OSError, ValueError, EOFError) as problem:
        reason = str(problem).splitlines()[0]
        raise InputError(f"is no array of NumPy: {reason} (allowed: .npy or .vdb files, or an array)") from None
    if not isinstance(numbers, np.ndarray) or numbers.ndim != 3 or numbers.dtype.kind not in "fiu":
        shape = numbers.shape if isinstance(numbers, np.ndarray) else "several arrays"
        raise InputError(f"is no grid of numbers along x, y and z (got {shape}; allowed: three axes)")
    if density.grid is not None:
        raise InputError("holds one grid, so that none is named (allowed: no key `grid`)")
    if density.min is None:
        raise InputError("says not where it lies (allowed: `min` and `max` beside it)")
    return numbers, None


def _read_vdb(path: Path | bytes, name: str | None) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Return the active voxels of a grid of OpenVDB as (x, y, z), one of the background round them, and their box."""
    try:
        import tinyvdb
    except ImportError:
        raise InputError('is of OpenVDB, which needs the package tinyvdb (pip install "rptcam_cl[vdb]")') from None
    try:
        file = tinyvdb.open(str(path))
        file.read_grids()
        names = [str(file.grid_name(index)) for index in range(file.grid_count)]
        wanted = name or ("density" if "density" in names or len(names) != 1 else names[0])
        if wanted not in names:
            raise InputError(f"has no grid {wanted}{near_name(wanted, names)} (allowed: {listed(names) or 'none'})")
        grid = file.grid(names.index(wanted))
        if not str(grid.type_name).startswith("Tree_float_"):
            raise InputError(f"grid {wanted} is of the type {grid.type_name} (allowed: Tree_float)")
        facts, placed = grid.metadata, grid.transform
        low, high = np.array(facts["file_bbox_min"]) - 1, np.array(facts["file_bbox_max"]) + 2
        if (high - low <= 2).any():
            raise InputError(f"grid {wanted} has no active voxel")
        _check_size(high - low)
        dense = grid.materialize_dense(tuple(map(int, low)), tuple(map(int, high)))
        voxels = np.frombuffer(dense.to_bytes(), np.float32).reshape(tuple(high - low), order="F")
    except (tinyvdb.VDBError, KeyError) as problem:
        raise InputError(f"cannot be read as OpenVDB: {problem}") from None
    if not np.array_equal(placed["matrix"], np.eye(4)):
        raise InputError(f"grid {wanted} lies turned in space (allowed: moved and scaled, or `min` and `max`)")
    ends = np.stack([low, high]) - 0.5  # values lie at whole coordinates
    return voxels, ends * placed["scale"] + placed["translation"]


def _check_size(shape: Any) -> None:
    if int(np.prod(np.asarray(shape, np.int64))) > _MOST_VOXELS:
        said = " x ".join(map(str, shape))
        raise InputError(f"has {said} voxels (allowed: {_MOST_VOXELS} in all)")


def _with_blocks(given: NDArray[Any]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the voxels of an array (x, y, z), and what is known of blocks of them; refuse what is no density."""
    _check_size(given.shape)
    if 0 in given.shape:
        raise InputError(f"has no voxels (got {' x '.join(map(str, given.shape))})")
    voxels = np.ascontiguousarray(given.transpose(2, 1, 0), np.float32)
    if not np.isfinite(voxels).all() or voxels.min() < 0 or voxels.max() > 1e18:
        wrong = voxels[~(np.isfinite(voxels) & (voxels >= 0) & (voxels <= 1e18))][0]
        raise InputError(f"holds what is no density (got {wrong:g}; allowed: 0 to 1e18)")
    most, least, total = (_of_blocks(voxels, each) for each in (np.maximum, np.minimum, np.add))
    count = _of_blocks(np.ones_like(voxels), np.add)
    return voxels, np.stack([least, most, total / count], axis=-1)


def _of_blocks(voxels: NDArray[np.float32], by: np.ufunc) -> NDArray[np.float32]:
    """Combine the voxels of each block, and those beside it that densities within depend on."""
    for axis in range(3):
        size = voxels.shape[axis]
        ends = [(max(at - 1, 0), min(at + DENSITY_BLOCK + 1, size)) for at in range(0, size, DENSITY_BLOCK)]
        parts = [by.reduce(voxels.take(range(*each), axis), axis) for each in ends]
        voxels = np.stack(parts, axis)
    return voxels


def _fill_grid(record: np.void, density: DensityGrid, volume: Volume, scene: Scene, start: int) -> None:
    """Write where a grid lies about the eye, and where its numbers start."""
    box = volume.box if density.min is None else np.array([density.min, density.max], np.float64)
    assert box is not None
    (nz, ny, nx), (bz, by, bx, _) = volume.voxels.shape, volume.blocks.shape
    low, high = (box - np.array(scene.camera.eye)) * scene.metres_per_unit
    per_m = np.array([nx, ny, nz]) / (high - low)
    rows = {
        f"row_{axis}": (*(per_m[k] * (np.arange(3) == k)).tolist(), float(-low[k] * per_m[k]))
        for k, axis in enumerate("xyz")
    }
    column = float(volume.blocks[..., 1].mean()) * float((high - low).max())
    fill(
        record, **rows, voxels=start, blocks=start + volume.voxels.size, size_x=nx, size_y=ny, size_z=nz,
        blocks_x=bx, blocks_y=by, blocks_z=bz, glow_rate=_EVENTS_WHERE_IT_SHINES / max(column, 1e-9),
    )  # fmt: skip


def _steps_through(record: np.void, volume: Volume) -> float:
    """Return how many blocks and events a ray meets on its way through a grid, along the axis where it meets most.

    Events come by the greatest density of each block, while light is left at the wavelength of which most is left.
    """
    extinction = record["absorption"][:3] + record["scattering"][:3]
    rate, slowest = float(extinction.max()), float(extinction.min())
    if record["emission"][:3].any():
        rate = max(rate, float(record["glow_rate"]))
    most = 0.0
    for axis, row in ((2, "row_x"), (1, "row_y"), (0, "row_z")):
        side_m = DENSITY_BLOCK / float(np.abs(record[row][:3]).max())
        blocks = volume.blocks if axis == 2 else np.swapaxes(volume.blocks, axis, 2)
        for ahead in (blocks, blocks[:, :, ::-1]):
            columns = slowest * side_m * ahead[..., 2].astype(np.float64)
            left = np.exp(columns - np.cumsum(columns, axis=2))  # of light that enters each block
            steps = 1.0 + rate * side_m * ahead[..., 1] * left
            most = max(most, float(steps.sum(axis=2).max()))
    return most


def _check(scene: Scene, primitives: Primitives, materials: Collection[Material]) -> None:
    """Refuse what does not go with media."""
    faults = {
        "film.transparent": (scene.film.transparent, "false"),
        "render.caustics": (scene.render.caustics == "on", "off or auto"),
        "camera.ghosts": (getattr(scene.camera, "ghosts", "off") != "off", "off"),
    }
    for key, (wrong, allowed) in faults.items():
        if wrong:
            raise InputError(f"{key}: does not go with media such as fog (allowed: {allowed})")
    medium = scene.medium
    if medium is not None and max(medium.emission_per_m) > 0 and medium.density is None:
        thinnest = min(a + s for a, s in zip(medium.absorption, medium.scattering, strict=True))
        if thinnest <= 0:
            raise InputError("medium.emission_per_m: shines without end where nothing absorbs or scatters"
                             " (allowed: coefficients above 0 in every channel)")  # fmt: skip
    if any(_interior_of(material) is not None and has_holes(material) for material in materials):
        raise InputError("opacity: solids with holes do not go with media such as fog (allowed: 1)")
    partly = Hidden.FROM_CAMERA | Hidden.FROM_REFLECTION
    bounded = any(isinstance(material, Boundary) for material in materials)
    wrong = primitives.runs_of(lambda each: bounded and each.hidden & partly not in (0, partly))
    if len(wrong):
        raise InputError(
            f"objects.{primitives.objects[wrong[0]]}.visible: a boundary of a medium makes no difference between camera"
            " and reflection (allowed: both or neither)"
        )


# Which media surround a place.


@dataclass(frozen=True, eq=False)
class _SolidOfMedium:
    """An object that the medium of a number fills, 0 being empty space."""

    index: int
    item: Object
    solid: Solid
    number: int

    def holds(self, scene: Scene, point: NDArray[np.float64], time_s: float) -> bool:
        """Return whether a point is inside at a moment, or behind a plane."""
        blocks = self.item.place_blocks(scene.folders, time_s)
        return any(holds_eye(self.solid, places, np.append(point, 1.0)) for places in blocks)

    def size(self) -> tuple[float, int]:
        """Return the size of its box [cubic scene units], and its number."""
        if isinstance(self.item, Plane):
            return np.inf, self.number
        return float(np.ptp(world_corners(self.item, self.solid), axis=1).prod(axis=1).max()), self.number


_ACROSS = (0.01, 0.5, 0.99)  # of the film, places whose rays show where the camera's rays begin


def about_camera(media: Media, scene: Scene, *, focused: bool = True) -> Media:
    """Return the media of a scene that know in which of them its camera's rays begin: the eye's until it is focused.

    Raises
    ------
    InputError
        They begin in different ones.
    """
    if not media.active:
        return media
    starts, solids = _starts(scene) if focused else np.zeros((1, 3)), _solids(scene, media)
    moments = [_stack_at(scene, media, solids, starts, time_s) for time_s in scene.shutter.span_s]
    if len(set(moments)) > 1:
        raise InputError("camera.motion: the camera moves from one medium into another (allowed: to stay in one)")
    depths = range(0, moments[0].bit_length() - 1, MEDIUM_BITS)  # below the bit that marks the bottom
    if any(media.records["by_entry"][moments[0] >> depth & _MOST_MEDIA] for depth in depths):
        raise InputError("camera.eye: lies in a medium whose color is a texture, which light takes where it enters"
                         " (allowed: outside of it, or a medium of one colour)")  # fmt: skip
    return replace(media, at_camera=moments[0])


def _starts(scene: Scene) -> NDArray[np.float64]:
    """Return places where rays of the camera begin (n, 3), about the eye in its own frame [scene units]."""
    across = np.array([(x, y) for x in _ACROSS for y in _ACROSS]) * scene.film.resolution
    origins, directions = camera_of(scene).chief_rays().rays_of_few(across)
    origins = origins - directions * (getattr(scene.camera, "near_m", 0.0) / directions[:, 2:])
    found = np.isfinite(origins).all(axis=1)
    return np.unique(origins[found], axis=0) / scene.metres_per_unit if found.any() else np.zeros((1, 3))


def _solids(scene: Scene, media: Media) -> list[_SolidOfMedium]:
    """Return the objects that media fill."""
    materials = {id(material): material for material in scene.shown_materials()}
    inside = {key: _number_in(material, media.numbers, scene) for key, material in materials.items()}
    solids = []
    for index, (item, solid) in enumerate(zip(scene.objects, scene.solids(), strict=True)):
        number = max((inside[id(material)] for material in solid.shown_materials()), default=_NOT_SOLID)
        if number != _NOT_SOLID:
            solids.append(_SolidOfMedium(index, item, solid, number))
    return solids


def _stack_at(
    scene: Scene, media: Media, solids: Sequence[_SolidOfMedium], starts: NDArray[np.float64], time_s: float
) -> int:
    """Return the stack of the media where rays begin at a moment, those of the solids around on top."""
    pose = pose_matrix(scene.camera.pose_at(time_s))
    around = (1 << MEDIUM_BITS) | media.numbers[_key_of(scene.medium or EMPTY, scene)]
    stacks = set()
    for point in starts @ pose[:3, :3].T + pose[:3, 3]:
        held, stack = [each for each in solids if each.holds(scene, point, time_s)], around
        if len(held) > _MOST_NESTED:
            raise InputError(f"camera.eye: lies in {len(held)} solids at once (allowed: {_MOST_NESTED} beside media)")
        for each in sorted(held, key=_SolidOfMedium.size, reverse=True):
            stack = (stack << MEDIUM_BITS) | each.number
        stacks.add(stack)
    if len(stacks) > 1:
        raise InputError(
            "camera: its rays begin in different media, where they leave the lens or its plane (allowed: all in one)"
        )
    return stacks.pop()


def _mark_shade(scene: Scene, media: Media) -> None:
    """Mark the media that lie in nothing but solids of glass without a lamp: glass stops all light samples."""
    lamps = [(item, solid) for item, solid in zip(scene.objects, scene.solids(), strict=True) if shines(solid)]
    placed = (*(item for item, _ in lamps), *(each.item for each in _solids(scene, media)))
    if any(item.instances is not None or item.trajectory is not None or isinstance(item, Plane) for item in placed):
        return
    corners = [world_corners(item, solid)[0] for item, solid in lamps]
    corners += [np.array([light.position]) for light in scene.lights if hasattr(light, "position")]
    lit = {0} if scene.medium is None else {0, media.numbers[_key_of(scene.medium, scene)]}
    for each in _solids(scene, media):
        own = world_corners(each.item, each.solid)[0]
        near = any(
            np.all((own.min(axis=0) <= one.max(axis=0)) & (one.min(axis=0) <= own.max(axis=0))) for one in corners
        )
        glass = all(isinstance(material, Dielectric | Principled) for material in each.solid.shown_materials())
        if near or not glass or each.item.visible.hidden:
            lit.add(each.number)
    media.records["in_shade"] = [number not in lit for number in range(len(media.records))]


def _check_nesting(scene: Scene, media: Media) -> None:
    """Refuse solids one in another that a path cannot tell, where the middle of the inner one shows it."""
    solids = [
        each for each in _solids(scene, media) if each.item.instances is None and not isinstance(each.item, Plane)
    ]
    corners = np.array([world_corners(each.item, each.solid)[0] for each in solids]).reshape(-1, 8, 3)
    low, high = corners.min(axis=1), corners.max(axis=1)
    for own, middle in zip(solids, (low + high) / 2, strict=True):
        near = np.flatnonzero(((low < middle) & (middle < high)).all(axis=1))
        around = [solids[at] for at in near if solids[at] is not own]
        around = [each for each in around if each.holds(scene, middle, scene.shutter.open_s)]
        if len(around) >= _MOST_NESTED:
            raise InputError(
                f"objects.{own.index}: lies in {len(around)} other solids beside media (allowed: {_MOST_NESTED - 1})"
            )
        numbers = {each.number for each in (own, *around)}
        if media.records["by_entry"][[*numbers]].sum() > 1:
            raise InputError(
                f"objects.{own.index}: lies in another medium whose color is a texture, and light keeps one such colour"
                " (allowed: a medium of one colour, inside or around)"
            )
