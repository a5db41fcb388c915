"""The frames of a dataset, one after the other, in a folder or in shards that a killed run leaves fit to go on."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import tarfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from numbers import Integral
from pathlib import Path
from typing import Any

from rptcam_cl.api.interface import settle
from rptcam_cl.api.job import SeriesRenderer
from rptcam_cl.batch.specification import MOST_FRAMES, DatasetSpecification, number_errors, read_specification, whole
from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.core.files import make_folder, replacing, resolve_links
from rptcam_cl.core.remember import UNKNOWN, Memory, OneMaker, made_by
from rptcam_cl.device.session import Wanted, open_sessions
from rptcam_cl.exchange.camera_models import COEFFICIENTS, calibrate, calibrate_best
from rptcam_cl.exchange.camera_view import View, view
from rptcam_cl.imaging.image import Image
from rptcam_cl.imaging.writers import LABELS, TRUTH_FILES, categories_of, with_classes
from rptcam_cl.scene.load import change_scene, load_scene
from rptcam_cl.scene.scene import Scene

#
# A folder with the frames of a dataset, loose or in shards, which a run that was killed leaves fit to go on from.
#
# The record of a frame is written after its files, and a shard after the records of all its frames; each file is
# written whole or not at all. So whatever is there is done.

ABOUT, MANIFEST = "dataset.json", "manifest.jsonl"
PIXELS = {"centre_of_the_first_pixel": 0.5}
PICTURES = ("png", "jpg", "tif")  # which annotations name where a frame has one
RECORD = re.compile(r"\d+\.json")
LOOSE = "unfinished"  # folder of frames whose shard is not whole yet


class _MovedError(Exception):
    """Another run of the same dataset has moved frames into their shard meanwhile."""


class DatasetFolder:
    """Writes frames and finds those that are there.

    Parameters
    ----------
    path : Path
        Made if it is missing.
    wanted : DatasetSpecification
    shard : int or None
        Frames in each shard.
    allow_mixed : bool
        Whether frames that other code has made stay beside those of this program.
    """

    def __init__(
        self, path: Path, wanted: DatasetSpecification, shard: int | None, *, allow_mixed: bool = False
    ) -> None:
        self.path, self.wanted, self.shard, self._same = path, wanted, shard, OneMaker(allow_mixed)
        self.frames = path if shard is None else path / LOOSE
        self._shards: dict[int, dict[int, dict[str, Any]]] = {}

    def begin(self) -> None:
        """Make the folder, or make sure that it holds this dataset.

        Raises
        ------
        StateError
            When it cannot be written, or holds another dataset, or the same in other shards or by other code.
        """
        make_folder(self.path)
        if self.shard is not None:
            make_folder(resolve_links(self.frames))
        about, mine = self.path / ABOUT, {"key": self.wanted.key, "shard": self.shard}
        if about.exists():
            try:
                facts = json.loads(about.read_text("utf-8"))
                known = {name: facts[name] for name in mine}
            except (OSError, ValueError, KeyError, TypeError):
                raise StateError(f"{about}: is damaged (remove the folder, or name another)") from None
            for name, words in (("key", "frames of another dataset"), ("shard", "frames in other shards")):
                if known[name] != mine[name]:
                    raise StateError(f"{self.path}: holds {words} (remove it, or name another folder)")
            if makers := facts.get("made_by", [UNKNOWN]):  # none where no device was opened yet
                self._same.add(str(self.path), makers)
                self.join([self._same.makers[0]["driver"]])  # whether the code is the same; the device is opened later
        elif any(self.path.glob("*.json")):
            raise StateError(f"{self.path}: holds other files (name an empty folder)")
        self._write_about()

    def join(self, drivers: Iterable[str]) -> None:
        """Let this program add frames by devices with these drivers, and note it.

        Raises
        ------
        StateError
            When frames that are there were made otherwise.
        """
        known = len(self._same.makers)
        self._same.add("this program", made_by(drivers))
        if len(self._same.makers) > known:
            self._write_about()

    def _write_about(self) -> None:
        facts = (
            {"key": self.wanted.key, "shard": self.shard}
            | PIXELS
            | {"frames": self.wanted.frames, "specification": self.wanted.content}
        )
        facts["categories"] = categories_of(self.wanted.classes)
        facts["made_by"] = self._same.makers
        self._write(self.path / ABOUT, (json.dumps(facts, indent=2, default=str) + "\n").encode())

    def record(self, index: int) -> dict[str, Any] | None:
        """Return the record of a frame that is there with all its files undamaged; None for one that has to be made."""
        if self.shard is not None and index in (packed := self._records_of_shard(index // self.shard)):
            return packed[index]
        try:
            record = json.loads(self._file(index, "json").read_text("utf-8"))
            for name, digest in record["files"].items():
                if hashlib.sha256((self.frames / name).read_bytes()).hexdigest() != digest:
                    return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        return record if isinstance(record, dict) and record.get("frame") == index else None

    def keep(self, index: int, image: Image, layers: Sequence[str], record: dict[str, Any]) -> dict[str, Any]:
        """Write the files of a frame, and its record with their digests, which is returned.

        Parameters
        ----------
        layers
            Those of the image that the scene asks for; truth may need others.

        Raises
        ------
        StateError
            A file cannot be written, as on a full disk; nothing of the frame is left then.
        """
        self.frames.mkdir(exist_ok=True)  # where another run has finished meanwhile
        try:
            return self._keep(index, image, layers, record)
        except BaseException:
            for suffix in (*self._suffixes, "json"):
                self._file(index, suffix).unlink(missing_ok=True)
            raise

    def _keep(self, index: int, image: Image, layers: Sequence[str], record: dict[str, Any]) -> dict[str, Any]:
        shown = replace(image, layers={name: image[name] for name in layers})
        for suffix in self.wanted.files:
            shown.save(resolve_links(self._file(index, suffix)))
        if self.wanted.truth:
            self._keep_truth(index, image)
        paths = [self._file(index, suffix) for suffix in self._suffixes]
        digests = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}
        record = json.loads(json.dumps(record | {"files": digests}))
        self._write(self._file(index, "json"), (json.dumps(record) + "\n").encode())
        return dict(record)

    def pack(self, index: int) -> None:
        """Move the frames of the shard of a frame into its file, when all are there; nothing of loose frames."""
        if self.shard is not None:
            self._pack(index // self.shard)

    def _keep_truth(self, index: int, image: Image) -> None:
        picture = next((suffix for suffix in self.wanted.files if suffix in PICTURES), self.wanted.files[0])
        labels = replace(image, layers={name: image[name] for name in LABELS})
        prefix = self._file(index, "").name
        labels.save_truth(self.frames, f"{prefix}{picture}", image_id=index, prefix=prefix)

    def finish(self) -> None:
        """Write the manifest of all frames that are there, one line each; pack what a killed run left loose."""
        if self.shard is not None:
            for number in range(-(-self.wanted.frames // self.shard)):
                self._pack(number)
        with (
            replacing(resolve_links(self.path / MANIFEST)) as temporary,
            temporary.open("w", encoding="utf-8", newline="\n") as out,
        ):
            for index in range(self.wanted.frames):
                if (record := self.record(index)) is not None:
                    self._same.add(f"{self.path}: frame {index}", record.get("made_by"))
                    out.write(json.dumps(record) + "\n")
        if self.shard is not None and all(map(self._records_of_shard, range(-(-self.wanted.frames // self.shard)))):
            with contextlib.suppress(OSError):  # another run may write there, or have removed it
                self.frames.rmdir()

    @property
    def _suffixes(self) -> tuple[str, ...]:
        """Of the files of a frame but its record."""
        return (*self.wanted.files, *TRUTH_FILES) if self.wanted.truth else self.wanted.files

    def _file(self, index: int, suffix: str) -> Path:
        return self.frames / f"{index:06d}.{suffix}"

    def _write(self, path: Path, content: bytes) -> None:
        with replacing(resolve_links(path)) as temporary:
            temporary.write_bytes(content)

    def _range(self, number: int) -> range:
        assert self.shard is not None
        return range(number * self.shard, min((number + 1) * self.shard, self.wanted.frames))

    def _tar(self, number: int) -> Path:
        return self.path / f"shard-{number:06d}.tar"

    def _records_of_shard(self, number: int) -> dict[int, dict[str, Any]]:
        """Return the records of a shard that is there and whole."""
        if number not in self._shards:
            try:
                with tarfile.open(self._tar(number)) as shard:
                    names = [member for member in shard.getmembers() if RECORD.fullmatch(member.name)]
                    read = [json.load(file) for member in names if (file := shard.extractfile(member)) is not None]
                records = {record["frame"]: record for record in read}
            except (OSError, tarfile.TarError, ValueError, KeyError, TypeError):
                return {}
            if set(self._range(number)) - set(records):
                return {}
            self._shards[number] = records
        return self._shards[number]

    def _pack(self, number: int) -> None:
        """Move the frames of a shard into its file, when all are there."""
        if not self._records_of_shard(number):
            if any(self.record(index) is None for index in self._range(number)):
                return
            try:
                self._write_shard(number)
            except _MovedError:
                return
        for path in self._files_of(number):
            path.unlink(missing_ok=True)

    def _write_shard(self, number: int) -> None:
        with (
            replacing(resolve_links(self._tar(number))) as temporary,
            tarfile.open(temporary, "w", format=tarfile.USTAR_FORMAT) as out,
        ):
            for path in self._files_of(number):
                try:
                    content = path.read_bytes()
                except FileNotFoundError:
                    raise _MovedError from None
                member = tarfile.TarInfo(path.name)
                member.size = len(content)
                out.addfile(member, io.BytesIO(content))

    def _files_of(self, number: int) -> Iterator[Path]:
        for index in self._range(number):
            yield from (self._file(index, suffix) for suffix in (*self._suffixes, "json"))


# The frames of a dataset, one after the other: rendered, described, written, and kept when they are there.

POSE = {"eye", "target", "up", "keyframes", "exposure", "shutter_s", "iso"}
REMEMBERED = 512  # camera models
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
    chosen = range(wanted.frames) if only is None else _check_indices(only, wanted.frames)
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


def _check_indices(only: Any, frames: int) -> Sequence[int]:
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
        with number_errors(index):
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
                "camera": cameras.describe(scene, image, renderer),
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
        self._known: Memory[dict[str, Any]] = Memory(REMEMBERED)
        self._lit: Memory[dict[str, Any]] = Memory(REMEMBERED)  # where the whole picture has light, by all but the stop

    def describe(self, scene: Scene, image: Image, renderer: SeriesRenderer) -> dict[str, Any]:
        """The pose, pupil, film, lens, and the camera model with its residual."""
        if scene.camera.sees_all_around:
            return {"camera": scene.camera.kind, "world_from_camera": image.metadata["world_from_camera"]}
        seen = view(scene, camera=None if renderer.plan is None else renderer.plan.camera)
        known = {name: image.metadata[name] for name in ("lens", "f_number") if name in image.metadata}
        return seen.facts() | known | ({} if self._model == "none" else self._fit(seen))

    def _fit(self, seen: View) -> dict[str, Any]:
        optics, stop = _content(seen)
        known: dict[str, Any] | None = self._known.find(optics + stop)
        if known is None and seen.is_of_any_stop:
            known = self._lit.find(optics)
        if known is None:
            if self._model == "auto":
                fit = calibrate_best(seen, list(COEFFICIENTS), GOOD_PX)
            else:
                fit = calibrate(seen, self._model)
            known = {
                "model": fit.model,
                "parameters": fit.named,
                "matrix": _matrix(fit.named),
                "largest_error_px": fit.max_px,
                "rms_error_px": fit.rms_px,
            }
            if fit.lit_share == 1.0:
                self._lit.add(optics, known)
        self._known.add(optics + stop, known)
        return known


def _content(seen: View) -> tuple[str, str]:
    """Keys of the optics that a camera model is fitted to, and of the stop."""
    optics = seen.scene.camera.model_dump(mode="json", exclude=POSE)
    stop = [optics.pop(key, None) for key in STOP]
    facts = [optics, seen.scene.film.model_dump(mode="json"), seen.distance_m, seen.scene.metres_per_unit]
    if seen.setting is not None:
        facts += [seen.setting.film_distance_mm, seen.setting.lens.vertices.tobytes()]
    return hashlib.sha256(repr(facts).encode()).hexdigest(), repr(stop)


def _matrix(named: Mapping[str, float]) -> list[list[float]]:
    """Return K; the centre of the first pixel is 0.5."""
    return [[named["fx"], 0.0, named["cx"]], [0.0, named["fy"], named["cy"]], [0.0, 0.0, 1.0]]
