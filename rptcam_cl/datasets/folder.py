"""A folder with the frames of a dataset, loose or in shards, which a run that was killed leaves fit to go on from.

The record of a frame is written after its files, and a shard after the records of all its frames; each file is written
whole or not at all. So whatever is there is done.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import re
import tarfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rptcam_cl.core.atomic import replacing, unlinked
from rptcam_cl.core.errors import StateError
from rptcam_cl.core.kept import UNKNOWN, OneMaker, made_by
from rptcam_cl.datasets.specification import DatasetSpecification
from rptcam_cl.imaging import LABELS, TRUTH_FILES, Image, categories_of

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
        try:
            if self.shard is not None:
                unlinked(self.frames)
            self.frames.mkdir(parents=True, exist_ok=True)
        except OSError as problem:
            why = "is a file, not a folder" if self.path.is_file() else f"cannot be made: {problem.strerror or problem}"
            raise StateError(f"{self.path}: {why}") from None
        about, mine = self.path / ABOUT, {"key": self.wanted.key, "shard": self.shard}
        if about.exists():
            try:
                found = json.loads(about.read_text("utf-8"))
                known = {name: found[name] for name in mine}
            except (OSError, ValueError, KeyError, TypeError):
                raise StateError(f"{about}: is damaged (remove the folder, or name another)") from None
            for name, words in (("key", "frames of another dataset"), ("shard", "frames in other shards")):
                if known[name] != mine[name]:
                    raise StateError(f"{self.path}: holds {words} (remove it, or name another folder)")
            if makers := found.get("made_by", [UNKNOWN]):  # none where no device was opened yet
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
        if self.shard is not None and index in (packed := self._packed(index // self.shard)):
            return packed[index]
        try:
            found = json.loads(self._file(index, "json").read_text("utf-8"))
            for name, digest in found["files"].items():
                if hashlib.sha256((self.frames / name).read_bytes()).hexdigest() != digest:
                    return None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return None
        return found if isinstance(found, dict) and found.get("frame") == index else None

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
            shown.save(unlinked(self._file(index, suffix)))
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
            replacing(unlinked(self.path / MANIFEST)) as temporary,
            temporary.open("w", encoding="utf-8", newline="\n") as out,
        ):
            for index in range(self.wanted.frames):
                if (record := self.record(index)) is not None:
                    self._same.add(f"{self.path}: frame {index}", record.get("made_by"))
                    out.write(json.dumps(record) + "\n")
        if self.shard is not None and all(map(self._packed, range(-(-self.wanted.frames // self.shard)))):
            with contextlib.suppress(OSError):  # another run may write there, or have removed it
                self.frames.rmdir()

    @property
    def _suffixes(self) -> tuple[str, ...]:
        """Of the files of a frame but its record."""
        return (*self.wanted.files, *TRUTH_FILES) if self.wanted.truth else self.wanted.files

    def _file(self, index: int, suffix: str) -> Path:
        return self.frames / f"{index:06d}.{suffix}"

    def _write(self, path: Path, content: bytes) -> None:
        with replacing(unlinked(path)) as temporary:
            temporary.write_bytes(content)

    def _range(self, number: int) -> range:
        assert self.shard is not None
        return range(number * self.shard, min((number + 1) * self.shard, self.wanted.frames))

    def _tar(self, number: int) -> Path:
        return self.path / f"shard-{number:06d}.tar"

    def _packed(self, number: int) -> dict[int, dict[str, Any]]:
        """Return the records of a shard that is there and whole."""
        if number not in self._shards:
            try:
                with tarfile.open(self._tar(number)) as shard:
                    names = [member for member in shard.getmembers() if RECORD.fullmatch(member.name)]
                    read = [json.load(file) for member in names if (file := shard.extractfile(member)) is not None]
                records = {found["frame"]: found for found in read}
            except (OSError, tarfile.TarError, ValueError, KeyError, TypeError):
                return {}
            if set(self._range(number)) - set(records):
                return {}
            self._shards[number] = records
        return self._shards[number]

    def _pack(self, number: int) -> None:
        """Move the frames of a shard into its file, when all are there."""
        if not self._packed(number):
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
            replacing(unlinked(self._tar(number))) as temporary,
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
