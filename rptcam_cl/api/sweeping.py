"""Sweeps: one picture for each combination of values of some keys of a scene, and a table of measures."""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rptcam_cl._version import __version__
from rptcam_cl.api.contact_sheet import contact_sheet
from rptcam_cl.api.interface import render
from rptcam_cl.api.series import SeriesRenderer
from rptcam_cl.api.settings import RenderSettings
from rptcam_cl.core.atomic import replacing, unlinked
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError, StateError
from rptcam_cl.core.kept import OneMaker, made_by
from rptcam_cl.device import Wanted, open_sessions
from rptcam_cl.focusing import focus_drive
from rptcam_cl.imaging import Image, check_sensor, develop, mtf50_at, read_film
from rptcam_cl.rendering import window
from rptcam_cl.scene import Scene, load_scene, set_keys

MOST_ENTRIES = 10_000
SHEET, TABLE = "contact_sheet.png", ("table.csv", "table.json")


@dataclass(frozen=True, eq=False)
class SweepEntry:
    """One combination of a sweep.

    Attributes
    ----------
    values : dict
        Of the keys that the sweep varies.
    measures : dict
        ``mean`` luminance of the film; ``noise``, the relative standard error of the picture; ``spp``, the mean of all
        pixels; ``seconds`` of rendering; ``mtf50`` [cycles per pixel] where there is an edge at the point that was
        given.
    image : Image
        The picture; one that was kept from an earlier run has no layers.
    kept : bool
        Whether it was.
    file : Path or None
        Of the film.
    """

    values: dict[str, Any]
    measures: dict[str, Any]
    image: Image
    kept: bool
    file: Path | None

    @property
    def label(self) -> str:
        """The values as people read them."""
        return ", ".join(self._lines)

    @property
    def _lines(self) -> list[str]:
        return [f"{key.rpartition('.')[2]} {shown(value)}" for key, value in self.values.items()]


Pictures = Callable[[Mapping[int, Scene]], Iterable[tuple[int, Image]]]
"""Renders scenes by number, in any order."""


@dataclass(frozen=True)
class _Planned:
    values: dict[str, Any]
    scene: Scene
    key: str
    name: str


def sweep(
    scene: Scene | str | Path | Mapping[str, Any],
    over: Mapping[str, Sequence[Any]],
    folder: str | Path | None = None,
    *,
    spp: int | None = None,
    size: tuple[int, int] | None = None,
    seed: int | None = None,
    mtf_at: tuple[float, float] | None = None,
    device: Wanted = None,
    pictures: Pictures | None = None,
    allow_mixed: bool = False,
) -> Iterator[SweepEntry]:
    """Return an iterator over the pictures of all combinations of values, the last key's changing first.

    All scenes are checked before the first is rendered. With a folder, each film and its measures are kept there, and
    rendered again only when something that decides them has changed; at the end follow a table and a contact sheet.

    Parameters
    ----------
    scene
        A scene, or anything that `load_scene` takes.
    over
        Values of each key path: ``{"camera.f_number": [2, 4, 8], "camera.lens": ["dgauss-50mm", "triplet-50mm"]}``.
    folder
        Where to keep the films; made if it is missing.
    spp, size, seed, device
        As for `render`.
    pictures
        Renders those that are missing, in place of this process: takes scenes by number, and returns an iterator over
        numbers and images in any order, as `rptcam_cl.cluster.render_scenes_on_cluster` does.
    mtf_at
        Where an edge is to be measured, in fractions of the picture from the left and the top.
    allow_mixed
        Whether pictures of the folder that other code, another numpy or another driver has made are kept beside new
        ones, with a warning.

    Raises
    ------
    InputError
        A key or a value is wrong, with the combination that it belongs to.
    StateError
        The folder cannot be written, or holds pictures that other code has made.
    """
    settings = RenderSettings(spp=spp, size=size, seed=seed)
    given = scene if isinstance(scene, Scene) else load_scene(scene)
    planned = _plan(settings.applied_to(given), over, mtf_at)
    place = None if folder is None else _folder(Path(folder))
    return _entries(planned, place, mtf_at, device, pictures, OneMaker(allow_mixed))


def _plan(scene: Scene, over: Mapping[str, Sequence[Any]], mtf_at: tuple[float, float] | None) -> list[_Planned]:
    """Return every combination with its scene, checked."""
    if not over:
        raise InputError("over: no key to vary (allowed: as camera.f_number=2,4,8)")
    for path, choices in over.items():
        if isinstance(choices, str) or not choices:
            raise InputError(f"over: {path}: has no list of values (got {choices!r}; allowed: as [2, 4, 8])")
    if mtf_at is not None and not all(0 <= share <= 1 for share in mtf_at):
        raise InputError(f"mtf_at: is no point of the picture (got {mtf_at}; allowed: two numbers in 0..1)")
    if (count := math.prod(len(values) for values in over.values())) > MOST_ENTRIES:
        raise InputError(f"over: {count} combinations are too many (allowed: {MOST_ENTRIES})")
    planned: dict[str, _Planned] = {}
    for combination in itertools.product(*over.values()):
        values = dict(zip(over, combination, strict=True))
        title = ", ".join(f"{key}={shown(value)}" for key, value in values.items())
        try:
            changed = set_keys(scene, values)
            check_sensor(changed, *window(changed)[2:])
            if changed.lens_source() is not None:
                focus_drive(changed)  # whether the lens opens so far
        except RptcamError as problem:
            raise type(problem)(f"{title}: {problem}") from None
        facts = [__version__, changed.picture_hash(), changed.render.most_spp, list(mtf_at or ())]
        if changed.render.layers:
            facts += [list(changed.render.layers), changed.render.layers_spp]
        key = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]
        slug = re.sub(r"[^A-Za-z0-9.+-]+", "_", title.replace("=", "-"))[:80]
        if key in planned:
            raise InputError(f"{title}: is the same picture as {planned[key].name} (leave one of them out)")
        planned[key] = _Planned(values, changed, key, f"{slug}-{key}")
    return list(planned.values())


def shown(value: Any) -> str:
    """Return a value on a label."""
    return f"{value:.6g}" if isinstance(value, float) else value if isinstance(value, str) else json.dumps(value)


def _folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(unlinked(folder / ".rptcam-sweep")) as temporary:
            temporary.touch()
        (folder / ".rptcam-sweep").unlink()
    except OSError as problem:
        why = "is a file, not a folder" if folder.is_file() else f"cannot be written: {problem.strerror or problem}"
        raise StateError(f"{folder}: {why}") from None
    return folder


def _entries(
    planned: Sequence[_Planned],
    folder: Path | None,
    mtf_at: tuple[float, float] | None,
    device: Wanted,
    pictures: Pictures | None,
    same: OneMaker,
) -> Iterator[SweepEntry]:
    """Render what is not there yet; write table and sheet at the end."""
    sessions: list[Any] = []
    series: SeriesRenderer | None = None
    rows, thumbnails = [], []
    made = {} if pictures is None else _made_elsewhere(planned, folder, mtf_at, pictures, same)
    for number, plan in enumerate(planned):
        entry = made.pop(number, None) or _kept(plan, folder, same)
        if entry is None:
            sessions = sessions or open_sessions(device)[0]
            same.add("this program", made_by(session.info.driver for session in sessions))
            series = series or (SeriesRenderer(sessions[0]) if len(sessions) == 1 else None)
            image = render(plan.scene, device=device) if series is None else series.render(plan.scene)
            entry = _made(plan, folder, image, mtf_at)
        if folder is not None:
            rows.append(entry.values | entry.measures | {"file": entry.file.name if entry.file else None})
            thumbnails.append(("\n".join(entry._lines), entry.image))
        yield entry
    if folder is not None:
        _write_tables(folder, rows)
        columns = len({json.dumps(list(plan.values.values())[-1]) for plan in planned})
        with replacing(unlinked(folder / SHEET)) as temporary:
            contact_sheet(thumbnails, columns).save(temporary, format="png")


def _made_elsewhere(
    planned: Sequence[_Planned],
    folder: Path | None,
    mtf_at: tuple[float, float] | None,
    pictures: Pictures,
    same: OneMaker,
) -> dict[int, SweepEntry]:
    """Return the entries of what is not there yet, by number, each kept as it comes."""
    missing = {number: plan.scene for number, plan in enumerate(planned) if _kept(plan, folder, same) is None}
    made = {}
    for number, image in pictures(missing):
        same.add(planned[number].name, image.metadata["made_by"])
        made[number] = _made(planned[number], folder, image, mtf_at)
    return made


def _made(plan: _Planned, folder: Path | None, image: Image, mtf_at: tuple[float, float] | None) -> SweepEntry:
    """Return the entry of a picture, and keep it: the film first, so that measures without a film cannot be."""
    achieved = image.stats.get("numerics", {}).get("noise")  # a worker's picture comes without
    luminance = image.luminance
    measures = {
        "mean": float(luminance.mean(dtype=np.float64)),
        "noise": None if achieved is None else achieved["picture"],
        "spp": image.metadata.get("spp_mean", image.metadata["spp"]),
        "seconds": _seconds(image),
    } | ({} if mtf_at is None else {"mtf50": mtf50_at(luminance, *mtf_at)})
    file = None
    if folder is not None:
        file = folder / f"{plan.name}.exr"
        image.save(unlinked(file))
        try:
            with replacing(unlinked(file.with_suffix(".json"))) as temporary:
                temporary.write_text(json.dumps({"key": plan.key, "measures": measures}), encoding="utf-8")
        except StateError:
            file.unlink(missing_ok=True)  # as on a full disk
            raise
    return SweepEntry(plan.values, measures, image, False, file)


def _seconds(image: Image) -> float:
    """Return how long an image took to render, here or by a worker [s]."""
    if "cluster" in image.stats:
        return float(sum(row["seconds"] for row in image.stats["cluster"]["workers"].values()))
    return float(image.stats["seconds"]["render"])


def _kept(plan: _Planned, folder: Path | None, same: OneMaker) -> SweepEntry | None:
    """Return the entry of an earlier run; None where there is none that is whole.

    Raises
    ------
    StateError
        It was made by other code than what the sweep has already.
    """
    if folder is None:
        return None
    file = folder / f"{plan.name}.exr"
    try:
        found = json.loads(file.with_suffix(".json").read_text("utf-8"))
        if found["key"] != plan.key:
            return None
        image = read_film(file)
        if image.metadata.get("picture_hash") != plan.scene.picture_hash():
            return None
        entry = SweepEntry(plan.values, found["measures"], develop(image), True, file)
    except (OSError, ValueError, KeyError, TypeError, RptcamError):
        return None
    same.add(str(file), image.metadata.get("made_by"))
    return entry


def _write_tables(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({key: shown(value) if isinstance(value, list | dict) else value for key, value in row.items()})
    for name, content in zip(TABLE, (text.getvalue(), json.dumps(rows, indent=2) + "\n"), strict=True):
        with replacing(unlinked(folder / name)) as temporary:
            temporary.write_text(content, encoding="utf-8")
