"""Sweeps: many pictures of a scene with other values of some keys, a contact sheet and a table of measures."""

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
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.api.interface import render
from rptcam_cl.api.job import RenderOptions, SceneSource, SeriesRenderer, read_scene
from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError, StateError
from rptcam_cl.core.files import check_writable, make_folder, replacing, resolve_links
from rptcam_cl.core.remember import OneMaker, made_by
from rptcam_cl.device.session import Wanted, open_sessions
from rptcam_cl.imaging.development import quantise
from rptcam_cl.imaging.image import Image, read_film, with_picture_settings
from rptcam_cl.imaging.sensor import check_sensor
from rptcam_cl.rendering.account import window
from rptcam_cl.scene.load import set_keys
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.drives import focus_drive

if TYPE_CHECKING:
    from PIL.Image import Image as Picture


# Contact sheets: developed pictures in a grid, each with its label.

WIDTH_PX = 320  # of a picture at most
GAP_PX, TEXT_PX = 8, 14
PAPER, INK = (24, 24, 24), (230, 230, 230)


def contact_sheet(pictures: Sequence[tuple[str, Image]], columns: int) -> Picture:
    """Return a sheet of pictures with their labels below, row after row.

    Parameters
    ----------
    pictures
        Label, of one or more lines, and image of each.
    columns
        Pictures in a row.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    small = [(label, _small(image)) for label, image in pictures]
    width = max(max(picture.width for _, picture in small), 160)
    height = max(picture.height for _, picture in small)
    font = ImageFont.load_default(TEXT_PX)
    lines = max(len(label.splitlines()) for label, _ in small)
    across, down = width + GAP_PX, height + (lines + 1) * TEXT_PX + GAP_PX
    rows = -(-len(small) // columns)
    sheet = Pillow.new("RGB", (columns * across + GAP_PX, rows * down + GAP_PX), PAPER)
    draw = ImageDraw.Draw(sheet)
    for index, (label, picture) in enumerate(small):
        x, y = GAP_PX + index % columns * across, GAP_PX + index // columns * down
        sheet.paste(picture, (x + (width - picture.width) // 2, y))
        for number, line in enumerate(label.splitlines()):
            while draw.textlength(line, font) > width and len(line) > 1:
                line = f"{line.rstrip('…')[:-1]}…"
            place = (x + width / 2, y + height + TEXT_PX // 4 + number * TEXT_PX)
            draw.text(place, line, INK, font, anchor="ma")
    return sheet


def _small(image: Image) -> Picture:
    from PIL import Image as Pillow

    codes = np.asarray(quantise(image.developed(), 8))
    picture = Pillow.fromarray(codes)
    scale = min(WIDTH_PX / image.width, 1.0)
    if scale == 1.0:
        return picture
    return picture.resize((WIDTH_PX, max(round(image.height * scale), 1)), Pillow.Resampling.BOX)


# Sweeps: one picture for each combination of values of some keys of a scene, and a table of measures.

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
        return [f"{key.rpartition('.')[2]} {_format_value(value)}" for key, value in self.values.items()]


Pictures = Callable[[Mapping[int, Scene]], Iterable[tuple[int, Image]]]
"""Renders scenes by number, in any order."""


@dataclass(frozen=True)
class _Combination:
    """Values of a sweep and their scene; the film is kept under a name that follows from all that decides it."""

    values: dict[str, Any]
    scene: Scene
    key: str
    name: str
    folder: Path | None
    mtf_at: tuple[float, float] | None

    @property
    def file(self) -> Path | None:
        """The film, where one is kept."""
        return None if self.folder is None else self.folder / f"{self.name}.exr"

    def read(self, same: OneMaker) -> SweepEntry | None:
        """The entry of an earlier run; None where there is none that is whole.

        Raises
        ------
        StateError
            It was made by other code than what the sweep has already.
        """
        if self.file is None:
            return None
        try:
            saved = json.loads(self.file.with_suffix(".json").read_text("utf-8"))
            if saved["key"] != self.key:
                return None
            image = read_film(self.file)
            if image.metadata.get("picture_hash") != self.scene.picture_hash():
                return None
            entry = SweepEntry(
                self.values, saved["measures"], with_picture_settings(image, self.scene.picture), True, self.file
            )
        except (OSError, ValueError, KeyError, TypeError, RptcamError):
            return None
        same.add(str(self.file), image.metadata.get("made_by"))
        return entry

    def keep(self, image: Image) -> SweepEntry:
        """Measure a picture, and keep it: the film first, so that measures without a film cannot be."""
        achieved = image.stats.get("numerics", {}).get("noise")  # a worker's picture comes without
        luminance = image.luminance
        measures = {
            "mean": float(luminance.mean(dtype=np.float64)),
            "noise": None if achieved is None else achieved["picture"],
            "spp": image.metadata.get("spp_mean", image.metadata["spp"]),
            "seconds": _seconds(image),
        } | ({} if self.mtf_at is None else {"mtf50": mtf50_at(luminance, *self.mtf_at)})
        if self.file is not None:
            image.save(resolve_links(self.file))
            try:
                with replacing(resolve_links(self.file.with_suffix(".json"))) as temporary:
                    temporary.write_text(json.dumps({"key": self.key, "measures": measures}), encoding="utf-8")
            except StateError:
                self.file.unlink(missing_ok=True)  # as on a full disk
                raise
        return SweepEntry(self.values, measures, image, False, self.file)


def sweep(
    scene: SceneSource,
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
        numbers and images in any order, as `rptcam_cl.batch.cluster_run.render_scenes_on_cluster` does.
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
    place = None if folder is None else Path(folder)
    applied = RenderOptions(spp=spp, size=size, seed=seed).apply_to(read_scene(scene))
    planned = _plan(applied, over, place, mtf_at)
    if place is not None:
        check_writable(make_folder(place) / SHEET)
    return _entries(planned, place, device, pictures, OneMaker(allow_mixed))


def _plan(
    scene: Scene, over: Mapping[str, Sequence[Any]], folder: Path | None, mtf_at: tuple[float, float] | None
) -> list[_Combination]:
    """Check every combination with its scene."""
    if not over:
        raise InputError("over: no key to vary (allowed: as camera.f_number=2,4,8)")
    for path, choices in over.items():
        if isinstance(choices, str) or not choices:
            raise InputError(f"over: {path}: has no list of values (got {choices!r}; allowed: as [2, 4, 8])")
    if mtf_at is not None and not all(0 <= share <= 1 for share in mtf_at):
        raise InputError(f"mtf_at: is no point of the picture (got {mtf_at}; allowed: two numbers in 0..1)")
    if (count := math.prod(len(values) for values in over.values())) > MOST_ENTRIES:
        raise InputError(f"over: {count} combinations are too many (allowed: {MOST_ENTRIES})")
    planned: dict[str, _Combination] = {}
    for combination in itertools.product(*over.values()):
        values = dict(zip(over, combination, strict=True))
        title = ", ".join(f"{key}={_format_value(value)}" for key, value in values.items())
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
        planned[key] = _Combination(values, changed, key, f"{slug}-{key}", folder, mtf_at)
    return list(planned.values())


def _format_value(value: Any) -> str:
    """Return a value on a label."""
    return f"{value:.6g}" if isinstance(value, float) else value if isinstance(value, str) else json.dumps(value)


def _entries(
    planned: Sequence[_Combination], folder: Path | None, device: Wanted, pictures: Pictures | None, same: OneMaker
) -> Iterator[SweepEntry]:
    """Render what is not there yet; write table and sheet at the end."""
    sessions: list[Any] = []
    series: SeriesRenderer | None = None
    rows, thumbnails = [], []
    made = {} if pictures is None else _render_elsewhere(planned, pictures, same)
    for number, plan in enumerate(planned):
        entry = made.pop(number, None) or plan.read(same)
        if entry is None:
            sessions = sessions or open_sessions(device)[0]
            same.add("this program", made_by(session.info.driver for session in sessions))
            series = series or (SeriesRenderer(sessions[0]) if len(sessions) == 1 else None)
            image = render(plan.scene, device=device) if series is None else series.render(plan.scene)
            entry = plan.keep(image)
        if folder is not None:
            rows.append(entry.values | entry.measures | {"file": entry.file.name if entry.file else None})
            thumbnails.append(("\n".join(entry._lines), entry.image))
        yield entry
    if folder is not None:
        _write_tables(folder, rows)
        columns = len({json.dumps(list(plan.values.values())[-1]) for plan in planned})
        with replacing(resolve_links(folder / SHEET)) as temporary:
            contact_sheet(thumbnails, columns).save(temporary, format="png")


def _render_elsewhere(planned: Sequence[_Combination], pictures: Pictures, same: OneMaker) -> dict[int, SweepEntry]:
    """Render what is not there yet, each kept as it comes; the entries by number."""
    missing = {number: plan.scene for number, plan in enumerate(planned) if plan.read(same) is None}
    made = {}
    for number, image in pictures(missing):
        same.add(planned[number].name, image.metadata["made_by"])
        made[number] = planned[number].keep(image)
    return made


def _seconds(image: Image) -> float:
    """Return how long an image took to render, here or by a worker [s]."""
    if "cluster" in image.stats:
        return float(sum(row["seconds"] for row in image.stats["cluster"]["workers"].values()))
    return float(image.stats["seconds"]["render"])


def _write_tables(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow(
            {key: _format_value(value) if isinstance(value, list | dict) else value for key, value in row.items()}
        )
    for name, content in zip(TABLE, (text.getvalue(), json.dumps(rows, indent=2) + "\n"), strict=True):
        with replacing(resolve_links(folder / name)) as temporary:
            temporary.write_text(content, encoding="utf-8")


# Sharpness at an edge in a picture: MTF by the slanted edge.
#
# The method of ISO 12233, without its corrections for chart angles: pixels around the point are sorted by their
# distance from the edge, which gives the edge's profile at a quarter of a pixel; its derivative is the line spread,
# whose Fourier transform is the MTF in the direction across the edge.

BINS_PER_PIXEL = 4
REACH_PX = 20  # of the region around the point, on each side
SPAN_PX = 24  # of the profile, across the edge
LEAST_SLANT = 0.02  # of the edge against rows and columns, or its profile has gaps
LEAST_CONTRAST = 0.1  # (bright - dark) / (bright + dark) of both sides

WHOLE_STEP = 0.8  # of the largest step of a row: others the edge leaves at a side

Plane = NDArray[np.float64]


def mtf50_at(luminance: NDArray[np.floating], x: float, y: float) -> float | None:
    """Return the frequency at which the contrast of the edge at a point has fallen to a half [cycles per pixel].

    Parameters
    ----------
    luminance : (height, width) array
        Linear.
    x, y
        The point, in fractions of width and height from the left and the top.

    Returns
    -------
    float or None
        None where there is no single straight edge of some contrast, slanted against rows and columns.
    """
    profile = _profile(np.asarray(luminance, np.float64), x, y)
    if profile is None:
        return None
    spread = np.gradient(profile) * _window(len(profile))
    response = np.abs(np.fft.rfft(spread, 8 * len(spread)))
    if response[0] <= 0:
        return None
    frequency = np.fft.rfftfreq(8 * len(spread), 1 / BINS_PER_PIXEL)
    # bins average over their width, and the difference of neighbours over twice that
    mtf = response / response[0] / (np.sinc(frequency / BINS_PER_PIXEL) * np.sinc(2 * frequency / BINS_PER_PIXEL))
    below = int(np.argmax(mtf < 0.5))
    if below == 0:
        return None
    ahead = (mtf[below - 1] - 0.5) / (mtf[below - 1] - mtf[below])
    return float(frequency[below - 1] + ahead * (frequency[below] - frequency[below - 1]))


def _window(length: int) -> Plane:
    """Return a window that is flat in its inner half and falls by cosines to its ends (Tukey), to keep noise out."""
    across = np.abs(np.linspace(-1, 1, length))
    return np.asarray(np.where(across <= 0.5, 1.0, 0.5 * (1 + np.cos(2 * np.pi * (across - 0.5)))))


def _profile(values: Plane, x: float, y: float) -> Plane | None:
    """Return the mean of the pixels by their distance from the edge; None where there is no edge."""
    height, width = values.shape
    row, column = min(int(y * height), height - 1), min(int(x * width), width - 1)
    rows = slice(max(row - REACH_PX, 0), row + REACH_PX + 1)
    columns = slice(max(column - REACH_PX, 0), column + REACH_PX + 1)
    region = values[rows, columns]
    if min(region.shape) < REACH_PX:
        return None
    down, across = (float(np.abs(np.diff(region, axis=axis)).sum()) for axis in (0, 1))
    level = down > across  # the edge is nearer to a row than to a column
    distance = _distance(region.T if level else region)
    if distance is None:
        return None
    distance = distance.T if level else distance
    bins = np.floor((distance + SPAN_PX / 2) * BINS_PER_PIXEL).astype(np.int64)
    count = SPAN_PX * BINS_PER_PIXEL
    inside = (bins >= 0) & (bins < count)
    number = np.bincount(bins[inside], minlength=count)
    if not number.all():
        return None
    profile = np.bincount(bins[inside], region[inside], minlength=count) / number
    first, last = profile[: count // 8].mean(), profile[-(count // 8) :].mean()
    if abs(last - first) < LEAST_CONTRAST * abs(last + first):
        return None
    return np.asarray(profile)


def _distance(region: Plane) -> Plane | None:
    """Return how far each pixel is from an edge that crosses the rows; None where it is not slanted or there is none.

    The edge is the straight line through the centroids of the rows' derivatives.
    """
    steps = np.diff(region, axis=1)
    rises = steps.sum(axis=1)
    if not np.isfinite(rises).all() or not (largest := np.abs(rises).max()) > 0:
        return None
    crossed = np.abs(rises) > WHOLE_STEP * largest
    rows = np.flatnonzero(crossed)
    if len(rows) < REACH_PX / 2:
        return None
    centroids = steps[crossed] @ (np.arange(steps.shape[1]) + 0.5) / rises[crossed]
    slope, start = np.polyfit(rows, centroids, 1)
    if abs(slope) < LEAST_SLANT:
        return None
    y, x = np.mgrid[: region.shape[0], : region.shape[1]].astype(np.float64)
    return np.asarray((x - start - slope * y) / math.hypot(1.0, slope))
