"""Stages of USD as scenes of ours: meshes, instances, preview materials, lamps and cameras, at one moment."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.remember import content_name
from rptcam_cl.exchange import conversion
from rptcam_cl.exchange.conversion import Array, Conversion, Faces
from rptcam_cl.exchange.usd_lamps import Lamps
from rptcam_cl.exchange.usd_materials import Keys, PrimReport, Shading, materialx_layer, number_of, pxr
from rptcam_cl.scene.shapes import bezier_pieces

_WIDTH_PX = 960
_MOST_FACES = (400_000, 400_000, 10_000, 10_000)  # that each division of a subdivision surface may lead to
_CAMERA_STEPS = 8  # keyframes of a camera go straight
_SHARP = 10.0  # a crease of so much is one of every division (UsdGeomMesh, SHARPNESS_INFINITE)
_MOST_PIXEL_ASPECT = 20.0
_MOST_DISPLACED, _MOST_STEPS = 1_000_000, 256  # triangles of a displaced mesh, parts of each edge


# A stage, prim by prim.


@dataclass(eq=False)
class Stage:
    """Takes the prims of a stage at one moment.

    Attributes
    ----------
    objects : list of dict
    places : dict
        Matrices that an object stands at in tables, by its index.
    ends : list of UsdGeom.XformCache
        Where things are when the shutter opens and when it closes, at time `codes`; none where it has no time.
    moves : bool
        Whether something moves in between.
    """

    stage: Any
    time: Any
    report: PrimReport
    files: conversion.FileStore
    objects: list[Keys] = field(default_factory=list)
    materials: dict[str, Keys] = field(default_factory=dict)
    camera: Any = None
    ends: list[Any] = field(default_factory=list)
    codes: tuple[float, float] = (0.0, 0.0)
    shutter_s: tuple[float, float] = (0.0, 0.0)
    moves: bool = False
    _meshes: dict[str, list[tuple[str, Any]]] = field(default_factory=dict)
    _contents: dict[str, list[tuple[str, Any]]] = field(default_factory=dict)
    _names: dict[str, str] = field(default_factory=dict)
    _heights: dict[str, Keys | None] = field(default_factory=dict)
    _primvars: dict[str, set[str]] = field(default_factory=dict)  # that a material reads, by its path
    _sizes: dict[str, tuple[int, bool]] = field(default_factory=dict)
    _coloured: set[str] = field(default_factory=set)  # files of meshes that show colours of their own

    def __post_init__(self) -> None:
        self.geom, self.shade = pxr("UsdGeom"), pxr("UsdShade")
        self.cache = self.geom.XformCache(self.time)
        unit = float(self.geom.GetStageMetersPerUnit(self.stage))
        self.shading = Shading(self.time, self.report, self.files, unit)
        self.lamps = Lamps(self.stage, self.time, self.report, self.shading)

    def add_all(self) -> None:
        """Add everything that is shown."""
        self.camera = self._choose_camera()
        self._open_shutter()
        self._add_below(self.stage.GetPseudoRoot(), None, None)

    def _add_below(self, root: Any, frame: Any, table: str | None) -> None:
        """Add the prims below one; with a frame, relative to it, at the places of a table."""
        usd = pxr("Usd")
        walk = iter(usd.PrimRange(root, usd.TraverseInstanceProxies()))
        for prim in walk:
            if prim == self.stage.GetPseudoRoot():
                continue
            if not self._is_shown(prim) or prim.IsA(self.geom.PointInstancer):
                walk.PruneChildren()
            if not self._is_shown(prim):
                continue
            if prim.IsA(self.geom.PointInstancer):
                self._add_instancer(prim, frame)
            elif prim.HasAPI(self.lamps.lux.LightAPI):
                self._add_lamp(prim, frame, table)
            elif prim.IsA(self.geom.Gprim):
                self._add_shape(prim, self._placement(prim, frame), table)

    def _choose_camera(self) -> Any:
        """Return the camera that the stage's render settings name, else the first that is shown; None without one."""
        usd, cameras = pxr("Usd"), []
        walk = iter(usd.PrimRange(self.stage.GetPseudoRoot(), usd.TraverseInstanceProxies()))
        for prim in walk:
            if not prim.IsPseudoRoot() and (not self._is_shown(prim) or prim.IsA(self.geom.PointInstancer)):
                walk.PruneChildren()
            elif prim.IsA(self.geom.Camera):
                cameras.append(prim)
        settings = self._settings()
        named = settings.GetCameraRel().GetForwardedTargets() if settings else []
        cameras.sort(key=lambda prim: prim.GetPath() not in named)
        for prim in cameras[1:]:
            self.report.say("ignored", f"all cameras but {cameras[0].GetPath()}", prim)
        return next(iter(cameras), None)

    def _settings(self) -> Any:
        """The render settings that the stage names."""
        return pxr("UsdRender").Settings.GetStageRenderSettings(self.stage)

    def _conform(self, width: float, height: float) -> tuple[list[int], float, float]:
        """Return the resolution, and the sides of the film as render settings with one of their own change them."""
        settings = self._settings()
        if not settings or not settings.GetResolutionAttr().HasAuthoredValue():
            return [_WIDTH_PX, max(round(_WIDTH_PX * height / width), 1)], width, height
        across, down = (max(int(side), 1) for side in settings.GetResolutionAttr().Get(self.time))
        aspect = across / down * (settings.GetPixelAspectRatioAttr().Get(self.time) or 1.0)
        policy = str(settings.GetAspectRatioConformPolicyAttr().Get(self.time))
        is_wider = aspect > width / height
        if policy == "adjustApertureWidth" or (policy, is_wider) in (("expandAperture", True), ("cropAperture", False)):
            width = height * aspect
        elif policy != "adjustPixelAspectRatio":
            height = width / aspect
        return [across, down], width, height

    def _open_shutter(self) -> None:
        """Note from when to when the camera's shutter is open, which it says in time codes about the moment."""
        if self.camera is None or not self.time.IsNumeric():
            return
        shutter = self.geom.Camera(self.camera)
        opens, closes = (float(each.Get(self.time) or 0.0) for each in (
            shutter.GetShutterOpenAttr(), shutter.GetShutterCloseAttr()))  # fmt: skip
        if closes > opens:
            code, rate = self.time.GetValue(), self.stage.GetTimeCodesPerSecond()
            self.codes = code + opens, code + closes
            self.ends = [self.geom.XformCache(pxr("Usd").TimeCode(each)) for each in self.codes]
            self.shutter_s = self.codes[0] / rate, self.codes[1] / rate

    def _ends_of(self, prim: Any) -> tuple[Array, Array]:
        """Return the 4x4 matrices of a prim when the shutter opens and when it closes."""
        start, end = (np.array(cache.GetLocalToWorldTransform(prim)).T for cache in self.ends)
        return start, end

    def _moves(self, prim: Any) -> bool:
        """Return whether a prim moves while the shutter is open."""
        return bool(self.ends) and not np.array_equal(*self._ends_of(prim))

    def _motion(self, prim: Any) -> Keys:
        """Return transform and keyframes of what turns or shifts while the shutter is open, nothing for all else."""
        if not self.ends:
            return {}
        start, end = self._ends_of(prim)
        if prim.IsA(self.geom.PointBased) and self.geom.PointBased(prim).GetPointsAttr().ValueMightBeTimeVarying():
            self.report.say("approximated", "points that move by themselves stay while the shutter is open", prim)
        if np.array_equal(start, end):
            return {}
        frames = conversion.motion_between(start, end, self.shutter_s) if conversion.is_usable(start) else None
        if frames is None:
            self.report.say("approximated", "what stretches while the shutter is open stays", prim)
            return {}
        self.moves = True
        rest = start.copy()
        rest[:3, 3] = 0
        return {"transform": {"matrix": conversion.tidy(rest[:3])}, "motion": frames}

    def shutter_keys(self) -> Keys:
        """Return the shutter of a scene in which something moves, nothing where nothing does."""
        opens, closes = self.shutter_s
        return {"shutter": {"open_s": opens, "time_s": closes - opens}} if self.moves else {}

    def _is_shown(self, prim: Any) -> bool:
        if not prim.IsActive() or prim.IsAbstract():
            return False
        imageable = self.geom.Imageable(prim)
        if not imageable:
            return True
        visible = imageable.GetVisibilityAttr().Get(self.time) != self.geom.Tokens.invisible
        return visible and imageable.ComputePurpose() in (self.geom.Tokens.default_, self.geom.Tokens.render)

    def _placement(self, prim: Any, frame: Any) -> Array:
        """Return the 4x4 matrix that takes a prim to the world, or to a prim above it."""
        if frame is None:
            return np.array(self.cache.GetLocalToWorldTransform(prim)).T
        return np.array(self.cache.ComputeRelativeTransform(prim, frame.GetParent())[0]).T

    def _add_instancer(self, prim: Any, frame: Any) -> None:
        if frame is not None:
            self.report.say("ignored", "instances of instances", prim)
            return
        instancer = self.geom.PointInstancer(prim)
        own = instancer.ComputeInstanceTransformsAtTime(
            self.time, self.time, instancer.ExcludeProtoXform, instancer.ApplyMask
        )
        if self._moves(prim) or self._has_moving_places(prim, instancer):
            self.report.say("approximated", "an instancer that moves while the shutter is open stays", prim)
        numbers = np.array(instancer.GetProtoIndicesAttr().Get(self.time))
        mask = instancer.ComputeMaskAtTime(self.time)
        numbers = numbers[np.array(mask, bool)] if len(mask) else numbers
        world = self._placement(prim, None)
        matrices = world @ np.swapaxes(np.array(own).reshape(-1, 4, 4), 1, 2)
        for number, path in enumerate(instancer.GetPrototypesRel().GetForwardedTargets()):
            places = matrices[numbers == number]
            places = np.array([place[:3] for place in places if conversion.is_usable(place)])
            root = self.stage.GetPrimAtPath(path)
            if len(places) and root:
                table = self._table(f"{prim.GetName()}-{number}", places)
                self._add_below(root, root, table)

    def _has_moving_places(self, prim: Any, instancer: Any) -> bool:
        """Return whether the places of an instancer, or what stands there, move while the shutter is open."""
        if not self.ends:
            return False
        codes = [pxr("Usd").TimeCode(each) for each in self.codes]
        start, end = (np.array(instancer.ComputeInstanceTransformsAtTime(
            code, codes[0], instancer.ExcludeProtoXform, instancer.ApplyMask)) for code in codes)  # fmt: skip
        return not np.array_equal(start, end) or any(
            each.IsA(self.geom.Xformable) and self.geom.Xformable(each).TransformMightBeTimeVarying()
            for path in instancer.GetPrototypesRel().GetForwardedTargets()
            if self.stage.GetPrimAtPath(path)
            for each in pxr("Usd").PrimRange(self.stage.GetPrimAtPath(path))
        )

    def _table(self, name: str, places: Array) -> str:
        return self.files.add("places", f"{name}.npz", lambda path: np.savez(path, matrices=places))

    def _add_shape(self, prim: Any, placement: Array, table: str | None) -> None:
        if not conversion.is_usable(placement):
            self.report.say("ignored", "a transform that flattens space", prim)
            return
        shapes: list[tuple[Keys, Any]] = []
        if prim.IsA(self.geom.Mesh):
            shapes = [({"shape": "mesh", "file": file}, bound) for file, bound in self._mesh_files(prim)]
        elif prim.IsA(self.geom.BasisCurves):
            shapes = [(keys, prim) for keys in self._strands(prim)]
        elif (keys := self._solid(prim)) is not None:
            shapes = [(keys, prim)]
        else:
            self.report.say("ignored", f"there is no such shape as a {prim.GetTypeName()}", prim)
        transform: Keys = {}
        if not np.array_equal(placement, np.eye(4)):
            transform = {"transform": {"matrix": conversion.tidy(placement[:3])}}
        places = {"instances": {"file": table}} if table else {}
        for keys, bound in shapes:
            if keys.get("file") in self._coloured:
                material = {}
            elif keys["shape"] == "curves":
                material = {"material": self._material_of_curves(self._material(bound, prim), prim)}
            else:
                material = {"material": self._material(bound, prim)}
            moving = {} if table else self._motion(prim)
            moved = self._displacement(bound, prim, keys)
            self.objects.append({**keys, **transform, **moving, **places, **moved, **material})

    def _displacement(self, bound: Any, prim: Any, shape: Keys) -> Keys:
        """Return the displacement of an object by its material, with as many triangles as a million allows."""
        material = self._bound_material(bound)
        if not material:
            return {}
        path = str(material.GetPath())
        if path not in self._heights:
            self._heights[path] = self.shading.displacement(material)
        if (heights := self._heights[path]) is None:
            return {}
        count, mapped = self._sizes.get(shape.get("file", ""), (0, False))
        if not mapped:
            self.report.say("ignored", "displacement of what is no mesh with texture coordinates", prim)
            return {}
        steps = min(max(math.isqrt(_MOST_DISPLACED // count), 1), _MOST_STEPS)
        self.report.say("approximated", f"displacement, with each edge in {steps} parts", prim)
        return {"displacement": {**heights, "steps": steps}}

    def _strands(self, prim: Any) -> Iterator[Keys]:
        """Yield the curves of a prim: linear ones and cubic ones of every basis, with their widths."""
        curves = self.geom.BasisCurves(prim)
        points = _numbers(curves.GetPointsAttr().Get(self.time), 3)
        counts = _numbers(curves.GetCurveVertexCountsAttr().Get(self.time), 1, np.int64)
        basis = "linear" if str(curves.GetTypeAttr().Get()) == "linear" else str(curves.GetBasisAttr().Get())
        wrap = str(curves.GetWrapAttr().Get())
        least = 2 if basis == "linear" or wrap == "pinned" else 4
        if not len(counts) or counts.sum() != len(points) or counts.min() < least:
            self.report.say("ignored", "curves whose points are not those of their counts", prim)
            return
        if wrap == "periodic":
            self.report.say("approximated", "closed curves by open ones", prim)
        given = _numbers(curves.GetWidthsAttr().Get(self.time), 1)
        widths = _widths_of(given if len(given) else np.ones(1), counts)
        rows = np.column_stack([points, widths])
        strands = []
        for start, count in zip(np.cumsum(counts) - counts, counts, strict=True):
            strand = rows[start : start + count]
            if basis == "catmullRom" and wrap != "pinned":
                ends = bezier_pieces(strand[None], "catmull_rom")[0, 1:-1]
                strand = np.concatenate([ends[0, :1], ends[:, 1:].reshape(-1, 4)])
            strands.append(strand)
        if basis == "catmullRom":
            basis = "catmull_rom" if wrap == "pinned" else "bezier"
        if basis == "bezier" and any(len(strand) % 3 != 1 for strand in strands):
            self.report.say("ignored", "Bézier curves whose points make no whole pieces", prim)
            return
        normals = curves.GetNormalsAttr().Get(self.time) is not None
        if normals:
            self.report.say("approximated", "ribbons with normals by such that turn to whoever sees them", prim)
        arrays: Any = {"points": np.concatenate(strands), "counts": np.array([len(strand) for strand in strands])}
        arrays["points"][:, 3] = np.maximum(arrays["points"][:, 3], 0)
        file = self.files.add("curves", f"{prim.GetName()}.npz", lambda path: np.savez(path, **arrays))
        yield {"shape": "curves", "file": file, "basis": basis, "form": "flat" if normals else "tube"}

    def _material_of_curves(self, name: str, prim: Any) -> str:
        """Return the name of a material that curves may have: that given, or its colour alone."""
        keys = self.materials[name]
        solid = keys["kind"] in ("dielectric", "thin_glass", "mirror", "emissive") or keys.get("transmission", 0) != 0
        if not (solid or "emission" in keys or "opacity" in keys):
            return name
        self.report.say("approximated", "curves by a matte material of the same colour", prim)
        colour = keys.get("base_color", keys.get("reflectance", [0.5] * 3))
        self.materials[f"{name}-of-curves"] = {"kind": "matte", "reflectance": colour}
        return f"{name}-of-curves"

    def _mesh_files(self, prim: Any) -> list[tuple[str, Any]]:
        """Return the files of a mesh, one for each of its materials, and the prims that the materials are bound to."""
        source = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = str(source.GetPath())
        if key not in self._meshes:
            self._meshes[key] = self._write_mesh(prim)
        subsets = {str(bound.GetName()): bound for bound in prim.GetChildren() if bound.IsA(self.geom.Subset)}
        return [(file, subsets.get(name, prim)) for file, name in self._meshes[key]]

    def _own_colours(self, prim: Any) -> Any:
        """Return the colours that differ about a mesh and what they belong to; None where materials hide them."""
        primvar = self.geom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
        values = primvar.ComputeFlattened(self.time) if primvar and primvar.HasValue() else None
        material = self._bound_material(prim)
        if values is None or len(values) < 2 or self.shade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            return None
        if material and not self.shading.shows_colours(material):
            return None
        if material:
            self.report.say("approximated", "a material with the colours of a mesh by matte ones", prim)
        elif (share := self.shading.primvar("displayOpacity", prim)) is not None and share.min() < 1:
            self.report.say("ignored", "the opacity of a mesh with colours of its own", prim)
        return values, primvar.GetInterpolation()

    def _write_mesh(self, prim: Any) -> list[tuple[str, Any]]:
        mesh = self.geom.Mesh(prim)
        caged = self._polygons(prim, mesh)
        if caged is None:
            return []
        subsets = [
            (str(subset.GetPrim().GetName()), _numbers(subset.GetIndicesAttr().Get(self.time), 1, np.int64))
            for subset in self.shade.MaterialBindingAPI(prim).GetMaterialBindSubsets()
        ]
        holes = _numbers(mesh.GetHoleIndicesAttr().Get(self.time), 1, np.int64)
        # what is copied about a stage without being instanced is written once
        content = content_name(caged, str(mesh.GetSubdivisionSchemeAttr().Get()), subsets, holes)
        if content not in self._contents:
            self._contents[content] = self._write_parts(prim, mesh, caged, subsets, holes)
        return self._contents[content]

    def _write_parts(
        self, prim: Any, mesh: Any, caged: conversion.PolygonMesh, subsets: list[tuple[str, Faces]], holes: Faces
    ) -> list[tuple[str, Any]]:
        polygons, begins, smooth = self._smooth(prim, mesh, caged)
        parts: list[tuple[str, Faces | None]] = []
        taken = np.zeros(len(polygons.counts), bool)
        for name, own in (("", holes), *subsets):
            own = own[(own >= 0) & (own < len(begins) - 1)]
            spans = zip(begins[own], begins[own + 1], strict=True)
            faces = np.concatenate([own[:0], *(np.arange(begin, end) for begin, end in spans)])
            if name:
                parts.append((name, faces[~taken[faces]]))
            taken[faces] = True
        parts.append(("", np.flatnonzero(~taken)))
        written = []
        for name, chosen in parts:
            data = polygons.triangles(chosen, smooth=smooth)
            data = replace(data, faces=data.faces[data.areas() > 0])
            if len(data.faces):
                file = self.files.add("meshes", f"{prim.GetName()}{name and '-'}{name}.ply", data.write_ply)
                self._sizes[file] = len(data.faces), data.uvs is not None
                if data.colours is not None:
                    self._coloured.add(file)
                written.append((file, name))
        if not written:
            self.report.say("ignored", "a mesh without faces of any area", prim)
        return written

    def _polygons(self, prim: Any, mesh: Any) -> conversion.PolygonMesh | None:
        """Return the faces of a mesh as they are written; None, with a report, where they are not sound."""
        points = _numbers(mesh.GetPointsAttr().Get(self.time), 3)
        counts = _numbers(mesh.GetFaceVertexCountsAttr().Get(self.time), 1, np.int64)
        corners = _numbers(mesh.GetFaceVertexIndicesAttr().Get(self.time), 1, np.int64)
        sound = len(points) and len(counts) and counts.min() >= 0 and counts.sum() == len(corners)
        if not sound or corners.min() < 0 or corners.max() >= len(points) or not np.isfinite(points).all():
            self.report.say("ignored", "a mesh without sound faces", prim)
            return None
        face_of = np.repeat(np.arange(len(counts)), counts)
        uvs = self._on_corners(self._uv_primvar(prim), corners, face_of, 2)
        normals = self._on_corners(self._normals(prim, mesh), corners, face_of, 3)
        colours = self._on_corners(self._own_colours(prim), corners, face_of, 3)
        colours = None if colours is None else np.clip(colours, 0, 1)
        if mesh.GetOrientationAttr().Get(self.time) == self.geom.Tokens.leftHanded:
            ends = np.cumsum(counts)
            order = np.concatenate(
                [np.arange(end - 1, end - count - 1, -1) for end, count in zip(ends, counts, strict=True)]
            )
            corners = corners[order]
            uvs, normals, colours = (None if rows is None else rows[order] for rows in (uvs, normals, colours))
        return conversion.PolygonMesh(points, counts, corners, uvs, normals, *self._creases(mesh, len(points)), colours)

    def _creases(self, mesh: Any, count: int) -> tuple[Faces | None, Array | None, Array | None]:
        """Return the edges of a mesh that are creased, how sharply, and how sharp its points are."""
        at = _numbers(mesh.GetCornerIndicesAttr().Get(self.time), 1, np.int64)
        how = _numbers(mesh.GetCornerSharpnessesAttr().Get(self.time), 1)
        spikes = None
        if len(at) and len(at) == len(how) and at.min() >= 0 and at.max() < count:
            spikes = np.zeros(count)
            spikes[at] = np.where(how >= _SHARP, np.inf, how)
        lengths = _numbers(mesh.GetCreaseLengthsAttr().Get(self.time), 1, np.int64)
        run = _numbers(mesh.GetCreaseIndicesAttr().Get(self.time), 1, np.int64)
        sharpness = _numbers(mesh.GetCreaseSharpnessesAttr().Get(self.time), 1)
        if not len(run) or lengths.sum() != len(run) or lengths.min() < 2 or run.min() < 0 or run.max() >= count:
            return None, None, spikes
        firsts = np.delete(np.arange(len(run)), np.cumsum(lengths) - 1)
        if len(sharpness) == len(lengths):
            sharpness = np.repeat(sharpness, lengths - 1)
        elif len(sharpness) != len(firsts):
            return None, None, spikes
        ends = np.stack([run[firsts], run[firsts + 1]], axis=1)
        return ends, np.where(sharpness >= _SHARP, np.inf, sharpness), spikes

    def _smooth(
        self, prim: Any, mesh: Any, polygons: conversion.PolygonMesh
    ) -> tuple[conversion.PolygonMesh, Faces, bool]:
        """Subdivide a mesh where it says so.

        Returns
        -------
        polygons : PolygonMesh
        begins : (n + 1,) array of int
            Where the faces stand that each face has become, and where they end.
        smooth : bool
            Whether normals are to be made.
        """
        scheme = mesh.GetSubdivisionSchemeAttr().Get()
        begins = np.arange(len(polygons.counts) + 1)
        # a subdivision surface has no normals of its own; where no scheme is written, they show that it is none
        written = mesh.GetSubdivisionSchemeAttr().HasAuthoredValue()
        if scheme == self.geom.Tokens.none or (polygons.normals is not None and not written):
            return polygons, begins, False
        if scheme == self.geom.Tokens.catmullClark:
            for most in _MOST_FACES:
                if len(polygons.corners) > most:  # which there would be faces of
                    break
                begins = np.concatenate([[0], np.cumsum(polygons.counts)])[begins]
                polygons = polygons.subdivided()
            if len(mesh.GetCreaseIndicesAttr().Get(self.time) or []) and polygons.creases is None:
                self.report.say("ignored", "creases that do not fit the mesh", prim)
        else:
            self.report.say("approximated", f"a subdivision surface ({scheme}) as its smooth cage", prim)
        return polygons, begins, polygons.normals is None

    def _on_corners(self, primvar: Any, corners: Faces, face_of: Faces, width: int) -> Array | None:
        """Return values of a primvar at the corners of faces."""
        if primvar is None:
            return None
        flat, interpolation = primvar
        values = _numbers(flat, width)
        index = {"vertex": corners, "varying": corners, "uniform": face_of, "constant": 0 * corners,
                 "faceVarying": np.arange(len(corners))}.get(str(interpolation))  # fmt: skip
        if index is None or not len(values) or index.max(initial=0) >= len(values):
            return None
        return np.asarray(values[index])

    def _uv_primvar(self, prim: Any) -> Any:
        """Return the texture coordinates that the materials of a mesh read, else st or the first."""
        primvars = self.geom.PrimvarsAPI(prim).FindPrimvarsWithInheritance()
        bound = [prim, *(each.GetPrim() for each in self.shade.MaterialBindingAPI(prim).GetMaterialBindSubsets())]
        materials = filter(None, map(self._bound_material, bound))
        requested = dict.fromkeys(name for material in materials for name in self.shading.coordinates(material))
        there = [name for name in requested if any(each.GetPrimvarName() == name for each in primvars)]
        if len(there) > 1:
            what = f"all texture coordinates but {there[0]}, which place all pictures"
            self.report.say("ignored", what, prim)
        first = next(iter(there), "st")
        for primvar in sorted(primvars, key=lambda each: each.GetPrimvarName() != first):
            named = primvar.GetPrimvarName() in (first, "st", "uv", "st0", "UVMap")
            if "texCoord2" in str(primvar.GetTypeName()) or (named and "2" in str(primvar.GetTypeName())):
                return primvar.ComputeFlattened(self.time), primvar.GetInterpolation()
        return None

    def _normals(self, prim: Any, mesh: Any) -> Any:
        primvar = self.geom.PrimvarsAPI(prim).GetPrimvar("normals")
        if primvar and primvar.HasValue():
            return primvar.ComputeFlattened(self.time), primvar.GetInterpolation()
        if (normals := mesh.GetNormalsAttr().Get(self.time)) is not None:
            return normals, mesh.GetNormalsInterpolation()
        return None

    def _solid(self, prim: Any) -> Keys | None:
        """Return the keys of a shape of a few numbers; None for what is none of ours."""
        number = partial(number_of, prim, time=self.time)
        axis = {"X": np.eye(3)[0], "Y": np.eye(3)[1]}.get(str(prim.GetAttribute("axis").Get()), np.eye(3)[2])
        ends = {key: (sign * number("height", 2.0) / 2 * axis).tolist() for key, sign in (("base", -1), ("top", 1))}
        match str(prim.GetTypeName()):
            case "Sphere":
                return {"shape": "sphere", "center": [0, 0, 0], "radius": number("radius", 1.0)}
            case "Cube":
                half = number("size", 2.0) / 2
                return {"shape": "box", "min": [-half] * 3, "max": [half] * 3}
            case "Cylinder":
                return {"shape": "cylinder", **ends, "radius": number("radius", 1.0)}
            case "Cone":
                return {"shape": "cone", "base": ends["base"], "apex": ends["top"], "radius": number("radius", 1.0)}
            case "Capsule":
                self.report.say("approximated", "a capsule without its caps", prim)
                return {"shape": "cylinder", **ends, "radius": number("radius", 0.5)}
            case "Plane":
                # along x width, along y length; about x along z width, about y along x width (UsdGeomPlane)
                side, up = {"X": (2, 1), "Y": (0, 2)}.get("XYZ"[int(axis.argmax())], (0, 1))
                u, v = np.eye(3)[side] * number("width", 2.0), np.eye(3)[up] * number("length", 2.0)
                return {"shape": "rectangle", "corner": (-(u + v) / 2).tolist(), "edge_u": u.tolist(),
                        "edge_v": v.tolist()}  # fmt: skip
        return None

    def _bound_material(self, bound: Any) -> Any:
        """The material that is bound to a prim."""
        return self.shade.MaterialBindingAPI(bound).ComputeBoundMaterial()[0]

    def _material(self, bound: Any, prim: Any) -> str:
        """The name of the material that is bound to a prim; of one without, its colour."""
        material = self._bound_material(bound)
        if not material:
            keys, name = self._display_colour(prim), "color"
        else:
            name = str(material.GetPrim().GetName())
            path = str(material.GetPath())
            if (key := self._key_on(path, prim)) in self._names:
                return self._names[key]
            keys = self.shading.surface(material, prim) or self._display_colour(prim)
            self._primvars[path] = self.shading.primvars
        content = repr(keys)
        if content not in self._names:
            count, free = 1, name
            while free in self.materials:
                count += 1
                free = f"{name}-{count}"
            self.materials[free], self._names[content] = keys, free
        if material:
            self._names[self._key_on(path, prim)] = self._names[content]
        return self._names[content]

    def _key_on(self, path: str, prim: Any) -> str:
        """Name a material on one prim, by its path and the primvars that it reads there."""
        return content_name(path, *(self.shading.primvar(name, prim) for name in sorted(self._primvars.get(path, ()))))

    def _display_colour(self, prim: Any) -> Keys:
        primvar = self.geom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
        values = primvar.ComputeFlattened(self.time) if primvar and primvar.HasValue() else None
        share = self.shading.primvar("displayOpacity", prim)
        holes = {} if share is None or share.mean() >= 1 else {"opacity": float(np.clip(share.mean(), 0, 1))}
        if values is None or not len(values):
            return {"kind": "matte", "reflectance": [0.18] * 3, **holes}
        if len(values) > 1 or (share is not None and np.ptp(share) > 0):
            self.report.say("approximated", "colours of vertices or faces as their mean", prim)
        return {"kind": "matte", "reflectance": np.clip(np.mean(values, axis=0), 0, 1).tolist(), **holes}

    def _add_lamp(self, prim: Any, frame: Any, table: str | None) -> None:
        """Add a lamp: one with a surface is an object, at the places of a table or where it moves."""
        placement = self._placement(prim, frame)
        if (keys := self.lamps.add(prim, placement, is_instance=bool(table), moves=self._moves(prim))) is not None:
            moving = {"instances": {"file": table}} if table else self._motion(prim)
            self.objects.append({**keys, **moving})

    def camera_keys(self, metres_per_unit: float) -> tuple[Keys, Keys]:
        """Return the keys of camera and film."""
        if self.camera is None:
            raise InputError("no camera")
        camera = self.geom.Camera(self.camera).GetCamera(self.time)
        pose = _pose(self._placement(self.camera, None)) | self._camera_motion()
        width, height = camera.horizontalAperture, camera.verticalAperture
        if not (width > 0 and height > 0 and width / height < _MOST_PIXEL_ASPECT):
            width, height = 20.955, 15.2908
        pixels, width, height = self._conform(float(width), float(height))
        film: Keys = {"resolution": pixels, "width_mm": width}
        if abs(pixels[0] / pixels[1] / (width / height) - 1) > 0.01:  # pixels that are not square
            film = {"resolution": pixels, "size_mm": [width, height]}
        offset = {"shift_mm": camera.horizontalApertureOffset, "rise_mm": camera.verticalApertureOffset}
        tenth = metres_per_unit / 10  # focal length and film are tenths of a unit of the scene
        if str(camera.projection).endswith("Orthographic"):
            if any(offset.values()):
                self.report.say("ignored", "the offset of the film", self.camera)
            return {"kind": "orthographic", **pose, "width_m": width * tenth}, film
        fov = math.degrees(2 * math.atan(width / 2 / camera.focalLength))
        keys: Keys = {"kind": "pinhole", **pose, "fov_degrees": fov}
        if camera.fStop > 0 and camera.focusDistance > 0:
            radius = camera.focalLength * tenth / camera.fStop / 2
            focus = float(camera.focusDistance) * metres_per_unit
            keys |= {"kind": "thin_lens", "aperture_radius_m": radius, "focus_distance_m": focus}
        if any(offset.values()):
            keys["movements"] = offset
        return keys, film

    def picture_keys(self) -> Keys:
        """Return the keys of a picture that the camera makes brighter or darker than its film, nothing of another."""
        if self.camera is None:
            return {}
        number = partial(number_of, self.camera, time=self.time)
        factor = 2 ** number("exposure", 0.0) * number("exposure:time", 1.0) * number("exposure:iso", 100.0) / 100
        factor *= number("exposure:responsivity", 1.0) / number("exposure:fStop", 1.0) ** 2
        if factor == 1 or not factor > 0:
            return {}
        what = f"the camera's exposure, a factor of {factor:g}, goes to picture.ev; the linear film is not scaled"
        self.report.say("approximated", what, self.camera)
        return {"picture": {"ev": math.log2(factor)}}

    def _camera_motion(self) -> Keys:
        """Return the keyframes of a camera that moves while the shutter is open, nothing for one at rest."""
        codes = [pxr("Usd").TimeCode(each) for each in np.linspace(*self.codes, _CAMERA_STEPS + 1).tolist()]
        caches = [self.geom.XformCache(each) for each in codes if self.ends]
        worlds = [np.array(cache.GetLocalToWorldTransform(self.camera)).T for cache in caches]
        if all(np.array_equal(worlds[0], each) for each in worlds[1:]):
            return {}
        self.moves = True
        times = np.linspace(*self.shutter_s, len(worlds)).tolist()
        return {"motion": [{"time_s": at} | _pose(world) for at, world in zip(times, worlds, strict=True)]}

    def framed(self) -> tuple[Keys, Keys]:
        """Return the keys of a camera that sees everything, and of its film."""
        purposes = [self.geom.Tokens.default_, self.geom.Tokens.render]
        box = (
            self.geom.BBoxCache(self.time, purposes).ComputeWorldBound(self.stage.GetPseudoRoot()).ComputeAlignedRange()
        )
        low, high = np.array(box.GetMin()), np.array(box.GetMax())
        if box.IsEmpty() or not np.isfinite([low, high]).all():
            low, high = -np.ones(3), np.ones(3)
        z_up = self.geom.GetStageUpAxis(self.stage) == self.geom.Tokens.z
        up, away = (np.eye(3)[2], [0.5, -1.0, 0.4]) if z_up else (np.eye(3)[1], [0.5, 0.4, 1.0])
        middle, reach = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 1e-6)
        eye = middle + np.array(away) / np.linalg.norm(away) * reach / math.sin(math.radians(20))
        keys: Keys = {"kind": "pinhole", "eye": conversion.tidy(eye), "target": conversion.tidy(middle),
                      "up": up.tolist(), "fov_degrees": 40, "fov_axis": "vertical"}  # fmt: skip
        return keys, {"resolution": [_WIDTH_PX, _WIDTH_PX * 2 // 3]}


def _pose(world: Array) -> Keys:
    """Return the keys of where a camera stands and what it looks at."""
    _, up, back, eye = world[:3].T
    return {
        "eye": conversion.tidy(eye), "target": conversion.tidy(eye - back / np.linalg.norm(back)),
        "up": conversion.tidy(up / np.linalg.norm(up)),
    }  # fmt: skip


def _numbers(values: Any, width: int, kind: Any = np.float64) -> Any:
    """Return an array of a stage, (n, width) or of single numbers; an empty one for what is none."""
    try:
        array = np.asarray(values if values is not None else [], kind)
    except (TypeError, ValueError):
        array = np.zeros(0, kind)
    fits = array.ndim == 2 and array.shape[1] == width if width > 1 else array.ndim == 1
    return array if fits else np.zeros((0, width) if width > 1 else 0, kind)


def _widths_of(given: Array, counts: Faces) -> Array:
    """Return a width for each point of curves: one for all, for each curve, each point, or the ends of their pieces."""
    total = int(counts.sum())
    if len(given) == total:
        return given
    if len(given) == len(counts):
        return np.repeat(given, counts)
    if len(given) < len(counts) or len(given) % len(counts):
        return np.full(total, float(given.mean()))
    per_curve = given.reshape(len(counts), -1)
    places = [np.linspace(0, per_curve.shape[1] - 1, count) for count in counts]
    of = [np.interp(at, np.arange(per_curve.shape[1]), own) for at, own in zip(places, per_curve, strict=True)]
    return np.concatenate(of)


def _merge_instances(stage: Stage) -> None:
    """Put objects that differ in their transforms alone into tables, where they are many."""
    keys = [repr({key: value for key, value in item.items() if key != "transform"}) for item in stage.objects]
    counts = Counter(keys)
    merged: list[Keys] = []
    for key, item in zip(keys, stage.objects, strict=True):
        if counts[key] < conversion.TABLED or "instances" in item or "motion" in item:
            merged.append(item)
        elif counts[key]:
            alike = [other for k, other in zip(keys, stage.objects, strict=True) if k == key]
            places = np.array([other.get("transform", {"matrix": np.eye(4)[:3]})["matrix"] for other in alike])
            rest = {name: value for name, value in item.items() if name != "transform"}
            merged.append({**rest, "instances": {"file": stage._table("places", places)}})
            counts[key] = 0
    stage.objects = merged


def _pose_skeletons(stage: Any, code: float, report: PrimReport) -> None:
    """Move the points of meshes to where their skeletons and blend shapes put them at a time code."""
    skel, usd = pxr("UsdSkel"), pxr("Usd")
    walk = usd.PrimRange(stage.GetPseudoRoot(), usd.TraverseInstanceProxies())
    skinned = [prim for prim in walk if prim.IsA(skel.Root)]
    for prim in skinned:
        if prim.IsInstanceProxy():
            report.say("approximated", "instanced meshes with a skeleton in their pose at rest", prim)
    if skinned:
        stage.SetEditTarget(stage.GetSessionLayer())  # the files stay as they are
        skel.BakeSkinning(stage.Traverse(), pxr("Gf").Interval(code, code))


def _open_stage(source: Path, report: PrimReport) -> Any:
    """Return the stage of a file, with what it takes from files of MaterialX; such a file alone as a row of balls."""
    usd = pxr("Usd")
    if not source.is_file():
        raise InputError(f"{source}: no such file")
    heard = pxr("UsdUtils").CoalescingDiagnosticDelegate()  # else the library prints what it has to say
    if source.suffix.lower() == ".mtlx":
        return _materials_on_balls(materialx_layer(str(source.resolve()), report), source)
    try:
        opened = usd.Stage.Open(str(source))
    except Exception as problem:
        said = re.findall(r" : '(.*)", str(problem)) or [str(problem)]
        raise InputError(f"{source}: is no stage of USD ({said[0][:200]})") from None
    made = set()
    for layer in opened.GetUsedLayers():
        for name in layer.GetCompositionAssetDependencies():
            if not name.lower().endswith(".mtlx"):
                continue
            path = layer.ComputeAbsolutePath(name)
            try:
                below = materialx_layer(path, report)
            except InputError as problem:
                report.say("ignored", str(problem), opened.GetPseudoRoot())
                continue
            layer.UpdateCompositionAssetDependency(name, below.identifier)  # in memory; the file stays as it is
            made |= {name, path}
    for warning in heard.TakeUncoalescedDiagnostics():
        missing = re.search(r"Could not open asset @([^@]*)@", warning.commentary)
        if missing and missing[1] not in made:
            report.say("ignored", f"{missing[1]} cannot be read", opened.GetPseudoRoot())
    return opened


def _materials_on_balls(layer: Any, source: Path) -> Any:
    """Return a stage with a ball for each material of a layer, in a row."""
    geom, shade = pxr("UsdGeom"), pxr("UsdShade")
    stage = pxr("Usd").Stage.CreateInMemory("balls.usda")
    stage.GetRootLayer().subLayerPaths.append(layer.identifier)
    materials = stage.GetPrimAtPath("/MaterialX/Materials").GetChildren()
    if not materials:
        raise InputError(f"{source}: has no materials (allowed: surfacematerial with a surfaceshader)")
    for place, prim in enumerate(materials):
        ball = geom.Sphere.Define(stage, f"/Balls/{prim.GetName()}")
        geom.XformCommonAPI(ball).SetTranslate((2.5 * place, 0.0, 0.0))
        shade.MaterialBindingAPI.Apply(ball.GetPrim()).Bind(shade.Material(prim))
    return stage


def convert_stage(source: Path, target: Path, *, time_s: float | None = None) -> Conversion:
    """Convert a stage of USD to a scene of ours.

    Parameters
    ----------
    source
        A .usd, .usda, .usdc or .usdz file, or one of MaterialX (.mtlx), whose materials are shown on balls.
    target
        Where the scene of ours is to go; files that it names lie beside it.
    time_s
        Moment, counted from the first time code [s]; by default that first one, if the stage has any.

    Raises
    ------
    InputError
        When there is no such stage, or nothing in it can be shown.
    """
    usd, geom = pxr("Usd"), pxr("UsdGeom")
    report = PrimReport()
    opened = _open_stage(source, report)
    start = opened.GetStartTimeCode() if opened.HasAuthoredTimeCodeRange() else 0.0
    is_timed = opened.HasAuthoredTimeCodeRange() or time_s is not None
    code = start + (time_s or 0.0) * opened.GetTimeCodesPerSecond()
    _pose_skeletons(opened, code if is_timed else opened.GetStartTimeCode(), report)
    stage = Stage(opened, usd.TimeCode(code) if is_timed else usd.TimeCode.EarliestTime(), report,
                  conversion.FileStore(target.parent, target.stem, report))  # fmt: skip
    stage.add_all()
    if not stage.objects:
        raise InputError(f"{source}: 0 objects: nothing of the stage can be shown")
    _merge_instances(stage)
    unit = float(geom.GetStageMetersPerUnit(opened))
    camera, film = stage.framed() if stage.camera is None else stage.camera_keys(unit)
    if stage.camera is None:
        report.say("note", "has no camera: one that sees everything", opened.GetPseudoRoot())
    scene: Keys = {"metres_per_unit": unit} if unit != 1 else {}
    scene |= {"film": film, "camera": camera, "materials": stage.materials, "objects": stage.objects}
    scene |= stage.picture_keys() | stage.shutter_keys()
    if stage.lamps.lights:
        scene["lights"] = stage.lamps.lights
    glowing = {name for name, keys in stage.materials.items() if np.any(keys.get("emission", 0.0))}
    lit = stage.lamps.lights or any(
        isinstance(item.get("material"), dict) or item.get("material") in glowing for item in stage.objects
    )
    if stage.lamps.environment is None and not lit:
        report.say("note", "has no lights: an even sky", opened.GetPseudoRoot())
        stage.lamps.environment = {"kind": "constant", "radiance": [1.0, 1.0, 1.0]}
    if stage.lamps.environment is not None:
        scene["environment"] = stage.lamps.environment
    return Conversion(source, scene, report, stage.files)
