"""The frames of a dataset, one after the other: rendered, described, written, and kept when they are there."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any

from rptcam_cl._version import __version__
from rptcam_cl.api import SeriesRenderer, load_scene, settle
from rptcam_cl.calibration import COEFFICIENTS, View, calibrate, calibrate_best, view
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.datasets.folder import DatasetFolder
from rptcam_cl.datasets.numbered import numbered
from rptcam_cl.datasets.specification import MOST_FRAMES, DatasetSpecification, read_specification, whole
from rptcam_cl.device import Wanted, open_sessions
from rptcam_cl.imaging import LABELS, Image, with_classes
from rptcam_cl.scene import Scene, change_scene

POSE = {"eye", "target", "up", "keyframes", "exposure", "shutter_s", "iso"}
REMEMBERED = 256  # camera models
SAMPLES = ("spp", "spp_min", "spp_mean")
STOP = ("f_number", "stop_diameter_mm")
GOOD_PX = 0.05  # residual at which the search for the simplest camera model ends


@dataclass(frozen=True, eq=False)
class DatasetFrame:
    """One frame of a dataset.

    Attributes
    ----------
    index : int
        Counts from 0.
    values : dict
        What was drawn, by key path.
    record : dict
        Its line of the manifest: seed, values, hash of the scene, files, and ``camera``: pose, intrinsics, distortion
        and entrance pupil.
    image : Image or None
        The picture with its layers; None for a frame that was there already, whose files hold it.
    """

    index: int
    values: dict[str, Any]
    record: dict[str, Any]
    image: Image | None

    @property
    def kept(self) -> bool:
        """Whether an earlier run made it."""
        return self.image is None


def dataset(
    source: DatasetSpecification | str | Path | Mapping[str, Any],
    folder: str | Path | None = None,
    *,
    frames: int | None = None,
    only: Iterable[int] | None = None,
    shard: int | None = None,
    device: Wanted = None,
    allow_mixed: bool = False,
) -> Iterator[DatasetFrame]:
    """Return an iterator over the frames of a dataset, in their order.

    Each frame depends on the specification and its index alone, so any of them can be made anywhere. With a folder,
    each is written whole before the next begins, and frames that are there are kept; at the end follows the manifest.

    Parameters
    ----------
    source
        A specification, its file or its content; see docs/datasets.md.
    folder
        Where to write; made if it is missing. Without one nothing is written.
    frames
        How many there are, in place of the specification's.
    only
        The frames to make, of all; by default every one.
    shard
        Frames in each shard, a TAR file as WebDataset reads it, in place of loose files.
    device
        As for `render`.
    allow_mixed
        Whether frames of the folder that other code, another numpy or another driver has made are kept beside new ones;
        each says what made it.

    Raises
    ------
    InputError
        Something in the specification, the scene or the arguments is wrong.
    DeviceError
        No device fits, or a kernel failed.
    StateError
        The folder cannot be written, or holds another dataset.
    """
    if not isinstance(source, DatasetSpecification):
        wanted = read_specification(source, frames=frames)
    else:
        wanted = source if frames is None else replace(source, frames=whole(frames, "frames", 1, MOST_FRAMES))
    chosen = range(wanted.frames) if only is None else _chosen(only, wanted.frames)
    if shard is not None:
        whole(shard, "shard", 1, MOST_FRAMES)
        if folder is None:
            raise InputError(f"shard: needs a folder (got {shard}; allowed: with a folder to write to)")
    if folder is not None and not isinstance(folder, str | os.PathLike):
        raise InputError(f"folder: must be a path (got {folder!r}; allowed: as out/balls)")
    place = None if folder is None else DatasetFolder(Path(folder), wanted, shard, allow_mixed=allow_mixed)
    if place is not None:
        place.begin()
    return _frames(wanted, place, chosen, device)


def _chosen(only: Any, frames: int) -> Sequence[int]:
    """Return the numbers of the frames that are to be made."""
    allowed = f"allowed: 0 to {frames - 1}"
    if not isinstance(only, Iterable):
        raise InputError(f"only: must be a list of numbers of frames (got {only!r}; {allowed}, as [0])")
    chosen = only if isinstance(only, range) else list(only)
    for index in chosen:
        if isinstance(index, bool) or not isinstance(index, Integral):
            raise InputError(f"only: must be a list of whole numbers (got {index!r} in it; {allowed})")
        if not 0 <= int(index) < frames:
            raise InputError(f"frames: {index} is none of the dataset's {frames} ({allowed})")
    if not chosen:
        raise InputError(f"only: names no frame ({allowed})")
    return chosen if isinstance(chosen, range) else [int(index) for index in chosen]


def _frames(
    wanted: DatasetSpecification, place: DatasetFolder | None, chosen: Sequence[int], device: Wanted
) -> Iterator[DatasetFrame]:
    renderer: SeriesRenderer | None = None
    cameras = _Cameras(wanted.camera_model)
    for index in chosen:
        if place is not None and (known := place.record(index)) is not None:
            yield DatasetFrame(index, known["values"], known, None)
            continue
        values, scene = wanted.frame(index)
        if renderer is None:
            renderer = SeriesRenderer(open_sessions(device)[0][0])
            if place is not None:
                place.join([renderer.device.info.driver])
        with numbered(index):
            if scene.requested_autofocus is not None:
                scene = load_scene(settle(scene, device=renderer.device).scene, base_dir=scene.base_dir)
            image = renderer.render(_with_labels(scene) if wanted.truth else scene)
            if "class_names" in image.metadata:
                layers, metadata = with_classes(image.layers, image.metadata, wanted.classes)
                image = replace(image, layers=layers, metadata=metadata)
            record = {
                "frame": index,
                "version": __version__,
                "made_by": image.metadata["made_by"],
                "scene_hash": image.metadata["scene_hash"],
                "seed": scene.render.seed,
                **{key: image.metadata[key] for key in SAMPLES if key in image.metadata},
                "values": values,
                "camera": cameras.of(scene, image, renderer),
            }
            if wanted.truth and "boards" in image.metadata:
                record["boards"] = image.metadata["boards"]
            if place is not None:
                record = place.keep(index, image, scene.render.layers, record)
                place.pack(index)
        yield DatasetFrame(index, values, record, image)
    if place is not None:
        place.finish()


def _with_labels(scene: Scene) -> Scene:
    """Return a scene with the layers that masks and annotations need."""
    return change_scene(scene, render={"layers": tuple(dict.fromkeys((*scene.render.layers, *LABELS)))})


class _Cameras:
    """Describes the cameras of frames; a lens that only moves about is traced and fitted once."""

    def __init__(self, model: str) -> None:
        self._model = model
        self._known: dict[str, dict[str, Any]] = {}
        self._lit: dict[str, dict[str, Any]] = {}  # where the whole picture has light, by all but the stop

    def of(self, scene: Scene, image: Image, renderer: SeriesRenderer) -> dict[str, Any]:
        """Return pose, pupil, film, lens, and the camera model with its residual."""
        if scene.camera.kind == "environment":
            return {"camera": "environment", "world_from_camera": image.metadata["world_from_camera"]}
        seen = view(scene, camera=None if renderer.plan is None else renderer.plan.camera)
        known = {name: image.metadata[name] for name in ("lens", "f_number") if name in image.metadata}
        return seen.facts() | known | self._fitted(seen)

    def _fitted(self, seen: View) -> dict[str, Any]:
        if self._model == "none":
            return {}
        optics, stop = _content(seen)
        known = self._known.get(optics + stop)
        if known is None and optics in self._lit and seen.is_of_any_stop:
            known = self._lit[optics]
        if known is None:
            if self._model == "auto":
                found = calibrate_best(seen, list(COEFFICIENTS), GOOD_PX)
            else:
                found = calibrate(seen, self._model)
            known = {
                "model": found.model,
                "parameters": found.named,
                "matrix": _matrix(found.named),
                "largest_error_px": found.max_px,
                "rms_error_px": found.rms_px,
            }
            if found.lit_share == 1.0:
                _keep(self._lit, optics, known)
        _keep(self._known, optics + stop, known)
        return known


def _keep(known: dict[str, dict[str, Any]], key: str, value: dict[str, Any]) -> None:
    known[key] = value
    if len(known) > REMEMBERED:
        known.pop(next(iter(known)))


def _content(seen: View) -> tuple[str, str]:
    """Return what says by what a camera model is fitted, but for the stop, and how wide that is."""
    optics = seen.scene.camera.model_dump(mode="json", exclude=POSE)
    stop = [optics.pop(key, None) for key in STOP]
    facts = [optics, seen.scene.film.model_dump(mode="json"), seen.distance_m, seen.scene.metres_per_unit]
    if seen.setting is not None:
        facts += [seen.setting.film_distance_mm, seen.setting.lens.vertices.tobytes()]
    return hashlib.sha256(repr(facts).encode()).hexdigest(), repr(stop)


def _matrix(named: Mapping[str, float]) -> list[list[float]]:
    """Return K; the centre of the first pixel is 0.5."""
    return [[named["fx"], 0.0, named["cx"]], [0.0, named["fy"], named["cy"]], [0.0, 0.0, 1.0]]
