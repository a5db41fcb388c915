"""The dials of the viewfinder by name: what turning one changes in the scene."""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

from rptcam_cl.core import LUMENS_PER_WATT
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError, RptcamError, near_name
from rptcam_cl.core.files import Folders, References, lenses_dir
from rptcam_cl.core.remember import Disk, remember
from rptcam_cl.optics.lens import Lens, in_configuration
from rptcam_cl.optics.library import list_lenses, load_lens, named_lens
from rptcam_cl.rendering.cameras import model, setting
from rptcam_cl.scene import base, lens_settings
from rptcam_cl.scene.camera import KEY_GROUPS, keys_as, plain_keys
from rptcam_cl.scene.changes import change_scene, with_camera
from rptcam_cl.scene.exposure import LEAST_CD_M2, MOST_CD_M2, MOST_STOPS, Exposure
from rptcam_cl.scene.film import COOLEST, HOTTEST, LIGHTS, NO_BALANCE, SIDES_MM, TONES
from rptcam_cl.scene.scene import Scene
from rptcam_cl.viewfinder.lens_panel import INFINITY_M, nearest_focus_m, perspective
from rptcam_cl.viewfinder.panel import (
    BODIES,
    F_NUMBERS,
    KEPT,
    KITS,
    SPEEDS,
    TIMES,
    Linked,
    Mode,
    Panel,
    Settings,
    Turn,
    exposure_of,
    f_number_of_camera,
    f_numbers,
    film_mm,
    flag,
    focal_length_mm,
    is_same_size,
    linked,
    number,
    optics_key,
    value_per_radiance,
    word,
)

#
# Which lenses the viewfinder offers: those of the library, and lens files that lie in the scene's own folder.
#
# A client names a lens of this list and nothing else: no path that it sends is ever opened.

SUFFIXES = (".yaml", ".yml", ".json", ".dat", ".zmx", ".seq", ".txt")
_MIXED = (".yaml", ".yml", ".json")
FOLDERS = ("", "lenses")  # of the scene's folder, that are searched
_TABLE_FOLDERS = ("", "luts")  # the same for tables of colours
MOST_FILES = 1000
MOST_BYTES = 1 << 20


@dataclass(frozen=True)
class LensEntry:
    """A lens to choose.

    Attributes
    ----------
    name : str
        What the scene says: a name of the library, or a file relative to the scene's folder.
    title : str
        What the lens is called.
    focal_length_mm, f_number : float or None
        At the first position of a zoom; None for a lens without focal length.
    zoom : bool
    kind : str
        ``library`` or ``file``.
    """

    name: str
    title: str
    focal_length_mm: float | None
    f_number: float | None
    zoom: bool
    kind: Literal["library", "file"]


def lens_entries(scene: Scene) -> list[LensEntry]:
    """Return the lenses that a scene can be seen through, the library first; a scene's own prescription is not here."""
    return [*_library(), *_files(scene.folders)]


_DISK = Disk(
    "lens-list",
    ("optics", "viewfinder"),
    pack=lambda entries: ({}, {"lenses": [asdict(entry) for entry in entries]}),
    unpack=lambda _, facts: tuple(LensEntry(**entry) for entry in facts["lenses"]),
)


@cache
def _library() -> tuple[LensEntry, ...]:
    """Return the lenses of the library, as kept from an earlier run: reading them all takes longer than a picture."""
    files = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(lenses_dir().glob("*.yaml"))]
    return _DISK.find_or_make(files, lambda: tuple(_entry(name, named_lens(name), "library") for name in list_lenses()))


def _entry(name: str, lens: Lens, kind: Literal["library", "file"]) -> LensEntry:
    first = lens.first_order()
    return LensEntry(
        name, lens.name, _finite(first.focal_length_mm), _finite(first.f_number), len(lens.configurations) > 1, kind
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _candidates(
    folders: Folders, suffixes: tuple[str, ...] = SUFFIXES, among: tuple[str, ...] = FOLDERS
) -> list[os.DirEntry[str]]:
    """Return the files of the scene's folders that may be lenses by their suffix, in the order of names."""
    found: list[os.DirEntry[str]] = []
    for folder in among:
        with contextlib.suppress(OSError), os.scandir(folders.base / folder) as entries:
            files = [each for each in entries if each.name.lower().endswith(suffixes) and each.is_file()]
            found += sorted(files, key=lambda each: each.path)
    return found


def tables_of(scene: Scene) -> tuple[str, ...]:
    """Return the tables of colours that a scene can be shown by: those that lie in its folder, or its own."""
    files = _candidates(scene.folders, (".cube",), _TABLE_FOLDERS)[:MOST_FILES]
    names = [Path(each.path).relative_to(scene.folders.base).as_posix() for each in files]
    own = scene.picture.lut
    return tuple(dict.fromkeys([*([] if own is None else [own]), *names]))


def files_left_out(scene: Scene) -> int:
    """Return how many files in the scene's folders may be lenses and are not looked at, because there are so many."""
    return max(0, len(_candidates(scene.folders)) - MOST_FILES)


def _files(folders: Folders) -> list[LensEntry]:
    """Return the lenses among the files of the scene's folder; what is none is passed over."""
    found = []
    for each in _candidates(folders)[:MOST_FILES]:
        with contextlib.suppress(OSError):  # it has gone meanwhile
            status = each.stat()
            if status.st_size <= MOST_BYTES:
                found.append(_read(each.path, folders, (status.st_mtime_ns, status.st_size, status.st_ino)))
    return [entry for entry in found if entry is not None]


@lru_cache(maxsize=2 * MOST_FILES)
def _read(place: str, folders: Folders, stamp: tuple[int, int, int]) -> LensEntry | None:
    """Return the lens of a file, None where it is something else; read again when it has changed, by its stamp."""
    name = Path(place).relative_to(folders.base).as_posix()
    try:
        path = folders.find(name)
        if path.suffix.lower() in _MIXED and b"surfaces" not in path.read_bytes():
            return None  # a scene, or something else
        return _entry(name, load_lens(path, References(folders.beside(path))), "file")
    except (RptcamError, OSError):
        return None


def _chosen_lens(scene: Scene, name: str) -> LensEntry:
    """Return the entry of a lens by its name.

    Raises
    ------
    InputError
        None of that name is offered.
    """
    entries = {entry.name: entry for entry in lens_entries(scene)}
    if name not in entries:
        raise InputError(
            f"lens: is not one of the list{near_name(name, entries)}"
            f" (got {name[:80]!r}; allowed: {base.listed(list(entries))})"
        )
    return entries[name]


def current_name(scene: Scene) -> str | None:
    """Return the name of the scene's lens; of a prescription written out, what it is called; None without one."""
    camera = scene.camera.lens_camera
    if camera is None:
        return None
    lens = camera.design
    return lens if isinstance(lens, str) else str(lens.get("name", "own prescription"))


#
# The dials of exposure: mode, f-number, time, ISO, compensation, lock and metering, linked as on a camera.
#
# What the scene can say itself, it says: A is `exposure: auto` by aperture, M with automatic ISO the same by shutter,
# so that a render meters as the viewfinder does. S and P, and what limits hold back, become `exposure: physical` with
# the settings that were found.

MODES: tuple[Mode, ...] = get_args(Mode)
METERINGS = ("average", "centre_weighted", "spot")
_STEADY_EV = 0.02  # change of the light that nothing follows
_MOST_EV = 5.0
_NO_FILM = "the camera has no lens opening: choose M, A, S or P first, and it is exposed as behind an ideal lens"


def _turn_mode(panel: Panel, value: Any) -> Turn:
    """Choose M, A, S, P, or the scene's own scale of values; the picture stays as bright as it is, or is metered."""
    mode: Mode = next(known for known in MODES if known == word("mode", value, MODES))
    dials = panel.dials
    if mode == dials.mode:
        return panel.same()
    if mode == "relative":
        return _as_values(panel)
    settings, pushed = panel.settings, 0.0
    words = f"the camera has no lens opening: it is exposed as behind an ideal lens at f/{settings.f_number:g}"
    messages = (words,) if panel.without_film else ()
    if dials.mode == "relative" or panel.without_film:
        settings, dials = _as_bright(panel, settings), replace(dials, ev=0.0)
    elif dials.mode == "M" and not dials.auto_iso:
        pushed = dials.ev
    if mode == "M" and not dials.auto_iso:  # the settings hold what the meter and the compensation had brought
        dials = replace(dials, ev=0.0, locked_cd_m2=None)
    new = replace(panel, dials=replace(dials, mode=mode))
    return _relink(new, settings, messages, standing=settings, ev_change=pushed)


def _as_values(panel: Panel) -> Turn:
    """Return the scene with values that stand for radiance, as bright as it is."""
    ev = math.log2(value_per_radiance(panel.resolved))
    exposure = Exposure(mode="relative", ev=min(max(ev, -MOST_STOPS), MOST_STOPS))
    dials = replace(panel.dials, mode="relative", auto_iso=False, ev=exposure.ev, locked_cd_m2=None, written=exposure)
    return Turn(dials, {"exposure": _said(exposure)})


def _as_bright(panel: Panel, settings: Settings) -> Settings:
    """Return settings that make a picture as bright as the scene's own scale: by the time, then by the ISO."""
    wanted = value_per_radiance(panel.resolved) * 2.0**panel.resolved.exposure.neutral_density_stops
    low, high = panel.limits.time_s
    light = panel.light(settings.f_number)
    time_s = min(max(wanted / (light * model.values_per_irradiance(1.0, settings.iso)), low), high)
    if low < time_s < high:
        return replace(settings, time_s=time_s)
    return replace(settings, time_s=time_s, iso=wanted / (light * model.values_per_irradiance(time_s, 1.0)))


def _clamp(wanted: float, ends: tuple[float, float], words: str) -> tuple[float, tuple[str, ...]]:
    """Bring a value between the ends of its dial; the words are said where it was beyond them."""
    value = min(max(wanted, ends[0]), ends[1])
    return value, () if value == wanted else (words,)


def _turn_f_number(panel: Panel, value: Any) -> Turn:
    """Set the f-number, in M and A."""
    wanted = F_NUMBERS.exact(number("f_number", value))
    if panel.dials.mode in ("S", "P"):
        return panel.same(f"the f-number follows in {panel.dials.mode}")
    if panel.without_film:
        return panel.same(_NO_FILM)
    low, high = ends = panel.limits.f_number
    f_number, messages = _clamp(wanted, ends, f"the lens goes from f/{low:.3g} to f/{high:.3g}")
    return _relink(panel, replace(panel.settings, f_number=f_number), messages)


def _turn_time(panel: Panel, value: Any) -> Turn:
    """Set the exposure time, in M and S; where values stand for radiance it only smears what moves."""
    wanted = TIMES.exact(number("shutter_s", value))
    if panel.dials.mode in ("A", "P"):
        return panel.same(f"the time follows in {panel.dials.mode}")
    low, high = ends = panel.limits.time_s
    time_s, messages = _clamp(wanted, ends, f"the shutter goes from {TIMES.text(low)} to {TIMES.text(high)}")
    if panel.dials.mode == "relative":
        words = "values stand for radiance, whatever the time: choose M, A, S or P to expose"
        return Turn(panel.dials, {"shutter.time_s": time_s}, (*messages, words))
    return _relink(panel, replace(panel.settings, time_s=time_s), messages)


def _turn_iso(panel: Panel, value: Any) -> Turn:
    """Set the ISO."""
    wanted = SPEEDS.exact(number("iso", value))
    if panel.dials.mode == "relative":
        return panel.same("values stand for radiance, whatever the ISO: choose M, A, S or P to expose")
    if panel.dials.auto_iso:
        return panel.same("the ISO is automatic")
    low, high = ends = panel.limits.iso
    iso, messages = _clamp(wanted, ends, f"the ISO goes from {low:.3g} to {high:.6g}")
    return _relink(panel, replace(panel.settings, iso=iso), messages)


def _turn_auto_iso(panel: Panel, value: Any) -> Turn:
    """Leave the ISO to the meter, or keep what it has found."""
    on = flag("auto_iso", value)
    if panel.dials.mode == "relative":
        return panel.same("values stand for radiance, whatever the ISO: choose M, A, S or P to expose")
    if on == panel.dials.auto_iso:
        return panel.same()
    dials, pushed = replace(panel.dials, auto_iso=on), 0.0
    if panel.dials.mode == "M":
        pushed = panel.dials.ev if on else 0.0
        dials = dials if on else replace(dials, ev=0.0, locked_cd_m2=None)  # the ISO that was found holds it
    return _relink(replace(panel, dials=dials), panel.settings, ev_change=pushed)


def _turn_ev(panel: Panel, value: Any) -> Turn:
    """Set the compensation: what is free follows; in M, and where values stand for radiance, it scales the film."""
    words = f"compensation goes from -{_MOST_EV:g} to +{_MOST_EV:g} EV"
    ev, messages = _clamp(number("ev", value), (-_MOST_EV, _MOST_EV), words)
    new = replace(panel, dials=replace(panel.dials, ev=ev))
    return _relink(new, panel.settings, messages, ev_change=ev - panel.dials.ev)


def _turn_lock(panel: Panel, value: Any) -> Turn:
    """Hold the reading of the meter, or let it go."""
    on = flag("lock", value)
    dials = panel.dials
    if not _follows(panel):
        return panel.same("nothing follows the meter, so there is nothing to lock") if on else panel.same()
    stands = panel.reading_cd_m2 or _standing_reading(panel)
    reading = min(max(stands, LEAST_CD_M2), MOST_CD_M2) if on else None
    return _relink(replace(panel, dials=replace(dials, locked_cd_m2=reading)), panel.settings)


def _turn_metering(panel: Panel, value: Any) -> Turn:
    """Choose what the meter weighs: the frame, its middle, or a spot."""
    metering = word("metering", value, METERINGS)
    dials = replace(panel.dials, metering=metering)
    if metering != "spot":
        dials = replace(dials, spot_at=(0.5, 0.5))
    return _write(replace(panel, dials=dials), Linked(panel.settings, 0.0, ()))


def follow_light(panel: Panel) -> Turn:
    """Set what follows a new reading of the meter; nothing within 0.02 EV, or where the scene's own metering follows.

    Parameters
    ----------
    panel
        With the new reading.
    """
    is_held = panel.reading_cd_m2 is None or panel.dials.locked_cd_m2 is not None
    if is_held or not _follows(panel) or panel.without_film:
        return panel.same()
    turned = _relink(panel, panel.settings)
    if panel.dials.written.mode == "physical" and turned.dials.written.mode == "physical":
        wanted = _exposure_wanted(panel, panel.settings, 0.0)
        off = abs(math.log2(exposure_of(panel.settings, panel.light) / wanted))
        if off < _STEADY_EV:
            return replace(panel.same(), messages=turned.messages)
    return turned


def meter_needle(panel: Panel) -> float | None:
    """Return how much brighter the settings make the metered part than its target [EV]; None without a reading."""
    reading = panel.dials.locked_cd_m2 or panel.reading_cd_m2
    if reading is None or panel.resolved.exposure.mode == "auto":
        return None
    value = reading / LUMENS_PER_WATT * value_per_radiance(panel.resolved)
    return math.log2(value / panel.dials.target)


def _follows(panel: Panel) -> bool:
    return panel.dials.mode in ("A", "S", "P") or (panel.dials.mode == "M" and panel.dials.auto_iso)


def _standing_reading(panel: Panel) -> float:
    """Return the reading for which the settings as they stand would be right [cd/m²]."""
    dials, exposure = panel.dials, panel.resolved.exposure
    lets = exposure_of(panel.settings, panel.light) * 2.0**-exposure.neutral_density_stops
    return float(dials.target * 2.0**dials.ev / lets * LUMENS_PER_WATT)


def _exposure_wanted(panel: Panel, standing: Settings, ev_change: float) -> float:
    """Return the film value per radiance that the meter asks for, before the filter takes its part.

    Without a reading, that of the settings as they stood, and the change of compensation.
    """
    dials = panel.dials
    reading = dials.locked_cd_m2 or panel.reading_cd_m2
    if reading is None:
        return float(exposure_of(standing, panel.light) * 2.0**ev_change)
    stops = dials.ev + panel.resolved.exposure.neutral_density_stops
    return float(dials.target * 2.0**stops / reading * LUMENS_PER_WATT)


def _relink(
    panel: Panel,
    settings: Settings,
    messages: tuple[str, ...] = (),
    standing: Settings | None = None,
    ev_change: float = 0.0,
) -> Turn:
    """Find what is free of the settings anew, and write them into the scene; the messages come first."""
    dials = panel.dials
    if not _follows(panel) or _is_metered_by_scene_alone(panel):
        return _write(panel, Linked(settings, 0.0, ()), messages)
    wanted = _exposure_wanted(panel, standing or panel.settings, ev_change)
    found = linked(dials.mode, dials.auto_iso, settings, wanted, panel.limits, panel.light)
    return _write(panel, found, messages)


def _is_metered_by_scene_alone(panel: Panel) -> bool:
    """Return whether the exposure is `auto` of a camera without a film: compensation is the only dial that counts."""
    return panel.without_film and panel.scene.exposure.mode == "auto" and panel.dials.mode == "A"


def _write(panel: Panel, found: Linked, messages: tuple[str, ...] = ()) -> Turn:
    """Make the changes of the scene that settings stand for, and name the limits that hold them back."""
    dials, settings, scene = panel.dials, found.settings, panel.scene
    exposure = _exposure(panel, found)
    changes: dict[str, Any] = {}
    if scene.camera.has_opening and settings.f_number != panel.settings.f_number:
        changes["camera.f_number"] = settings.f_number
    if (exposure.mode == "physical" or dials.auto_iso) and settings.time_s != scene.shutter.time_s:
        changes["shutter.time_s"] = settings.time_s
    if exposure != scene.exposure:
        changes["exposure"] = _said(exposure)
    return Turn(replace(dials, written=exposure), changes, (*messages, *_words(panel, found)))


def _exposure(panel: Panel, found: Linked) -> Exposure:
    """Return the exposure of a scene that stands for the state of the body."""
    dials, scene, settings = panel.dials, panel.scene, found.settings
    old = scene.exposure
    f_number = None if scene.camera.has_opening else settings.f_number
    if dials.mode == "relative":
        return old.model_copy(update={"ev": dials.ev})
    kept: dict[str, Any] = {"neutral_density_stops": old.neutral_density_stops, "iso": settings.iso}
    if _is_metered_by_scene_alone(panel):
        metered = {"metering": dials.metering, "spot_at": dials.spot_at, "lock_cd_m2": dials.locked_cd_m2}
        return old.model_copy(update={"ev": dials.ev} | metered)
    if f_number is not None:
        kept["f_number"] = f_number
    automatic = (dials.mode == "A" and not dials.auto_iso) or (dials.mode == "M" and dials.auto_iso)
    if automatic and not found.clamped:
        spot = {"spot_at": dials.spot_at} if dials.metering == "spot" else {}
        priority = "aperture" if dials.mode == "A" else "shutter"
        kept |= {"target": dials.target, "metering": dials.metering, "lock_cd_m2": dials.locked_cd_m2} | spot
        return Exposure.model_validate({"mode": "auto", "ev": dials.ev, "priority": priority} | kept)
    ev = dials.ev if dials.mode == "M" and not dials.auto_iso else 0.0
    return Exposure.model_validate({"mode": "physical", "ev": ev} | kept)


def _said(exposure: Exposure) -> dict[str, Any]:
    """Return an exposure as a scene file says it, without what is so by default."""
    names = [name for name in type(exposure).model_fields if name == "mode" or exposure.says(name)]
    plain = exposure.model_dump(mode="json")
    return {name: plain[name] for name in names}


def _words(panel: Panel, found: Linked) -> tuple[str, ...]:
    if not found.clamped:
        return ()
    settings = found.settings
    texts = {
        "f_number": F_NUMBERS.text(settings.f_number),
        "time_s": TIMES.text(settings.time_s),
        "iso": SPEEDS.text(settings.iso),
    }
    lens = " of the lens" if panel.scene.camera.lens_camera is not None and found.clamped == ("f_number",) else ""
    ends = " and ".join(texts[name] for name in found.clamped)
    how = "bright" if found.off_ev > 0 else "dark"
    return (f"{ends} is the limit{lens}: the picture is {abs(found.off_ev):.1f} EV too {how}",)


# The dials of the optics: focus, zoom, lens, shape of the stop, film format.

CLICK = 1.03  # of the focal length
_MOST_CROP = 8.0
_WIDEST_DEGREES, _NARROWEST_DEGREES = 170.0, 0.5
SHAPES = ("circle", "polygon", "star", "heart")
BLADES = (3, 64)
_DEFAULT_BLADES = 7
_INFINITE_M = 1e5  # from here on the focus is at infinity

_ZoomKind = Literal["zoom", "angle", "crop", "none"]
ZOOM_TEXTS: dict[_ZoomKind, str] = {
    "zoom": "the lens zooms",
    "angle": "the camera's field of view changes",
    "crop": "a prime cannot zoom: the film is cropped, as by an extender",
    "none": "a camera that sees the whole sphere has nothing to zoom",
}


def turn_focus(panel: Panel, value: Any) -> Turn:
    """Focus at a distance [m]; from 100 km on at infinity."""
    metres, camera = number("focus_m", value), panel.scene.camera
    if not camera.focuses:
        return panel.same("everything is sharp through this camera: there is no focus to set")
    if not metres > 0:
        raise InputError(f"focus_m: must be above 0 (got {metres:g})")
    nearest = nearest_focus_m(panel.view)
    reached = INFINITY_M if metres >= _INFINITE_M else max(metres, nearest or 0.0)
    messages = (f"the nearest focus is {nearest:.3g} m",) if nearest is not None and metres < nearest else ()
    return Turn(panel.dials, as_paths(camera.focus_keys(reached)), messages)


def as_paths(keys: dict[str, Any]) -> dict[str, Any]:
    """Return keys of the camera as key paths of the scene; those that others replace are left out."""
    return {f"camera.{name}": value for name, value in keys.items() if value is not None}


@remember(most=KEPT, by=optics_key)
def zoom_kind(scene: Scene) -> _ZoomKind:
    """How a camera zooms: by its lens, its angle, or the crop of the film."""
    camera = scene.camera
    if camera.lens_camera is not None:
        return "zoom" if len(scene.load_lens().configurations) > 1 else "crop"
    return "none" if camera.zoom_keys(1.0, 1.0) is None else "angle"


def zoom_range(panel: Panel) -> tuple[float, float] | None:
    """Return the shortest and the longest focal length to zoom to [mm]; of a crop, as behind the whole film."""
    focal_mm = focal_length_mm(panel.view)
    kind = zoom_kind(panel.scene)
    if focal_mm is None or kind == "none":
        return None
    if kind == "zoom":
        return _zoom_ends(panel.scene)
    if kind == "crop":
        return focal_mm, focal_mm * _MOST_CROP
    half = panel.view.film.diagonal_m() * 1e3 / 2
    ends = tuple(half / math.tan(math.radians(degrees) / 2) for degrees in (_WIDEST_DEGREES, _NARROWEST_DEGREES))
    return ends[0], ends[1]


@remember(most=KEPT, by=optics_key)
def _zoom_ends(scene: Scene) -> tuple[float, float]:
    lens, wavelength_nm = scene.load_lens(), setting.lens_camera(scene).wavelength_nm
    states = [in_configuration(lens, state.name) for state in lens.configurations]
    lengths = [state.first_order(wavelength_nm).focal_length_mm for state in states]
    return min(lengths), max(lengths)


def zoomed_mm(panel: Panel) -> float | None:
    """Return the focal length that the camera is zoomed to [mm]; of a crop, as behind the whole film."""
    focal_mm = focal_length_mm(panel.view)
    if focal_mm is None or zoom_kind(panel.scene) != "crop":
        return focal_mm
    return focal_mm * panel.dials.whole_mm[0] / panel.dials.cropped_mm[0]


def zoom_by(panel: Panel, clicks: float) -> Turn:
    """Zoom by clicks of a wheel; a click is 3 % of the focal length."""
    here = zoomed_mm(panel)
    if here is None:
        return panel.same(ZOOM_TEXTS["none"])
    return _turn_zoom(panel, here * CLICK ** number("zoom", clicks))


def _turn_zoom(panel: Panel, value: Any) -> Turn:
    """Zoom to a focal length [mm]."""
    wanted, ends = number("zoom", value), zoom_range(panel)
    if ends is None:
        return panel.same(ZOOM_TEXTS["none"])
    reached = min(max(wanted, ends[0]), ends[1])
    messages = (f"it goes from {ends[0]:.4g} to {ends[1]:.4g} mm",) if abs(reached - wanted) > 1e-9 * wanted else ()
    kind = zoom_kind(panel.scene)
    if kind == "crop":
        return _crop(panel, reached / ends[0], messages)
    if kind == "zoom":
        return Turn(panel.dials, _zoom_changes(panel, reached), messages)
    return Turn(panel.dials, _widen_changes(panel, reached), messages)


def _crop(panel: Panel, factor: float, messages: tuple[str, ...]) -> Turn:
    """Return a film that is smaller by a factor than the whole one."""
    width, height = panel.dials.whole_mm
    size = (width / factor, height / factor) if factor > 1 + 1e-9 else (width, height)
    dials = replace(panel.dials, cropped_mm=size)
    if is_same_size(size, film_mm(panel.scene)):
        return Turn(dials, {}, messages)
    return Turn(dials, {"film.size_mm": list(size)}, messages)


SIZES = ("format", "size_mm", "width_mm", "diagonal_mm", "pixel_pitch_um")


def _zoom_changes(panel: Panel, focal_mm: float) -> dict[str, Any]:
    """Return the changes that zoom a lens; an f-number beyond the zoomed lens's widest becomes that."""
    changes: dict[str, Any] = {"camera.focal_length_mm": focal_mm}
    camera = setting.lens_camera(panel.scene)
    if camera.f_number is not None:
        keys = {"focal_length_mm": focal_mm, "zoom": None, "f_number": None}
        widest = f_numbers(change_scene(panel.scene, camera=keys))[0]
        if camera.f_number < widest:
            changes["camera.f_number"] = widest
    return changes


def _widen_changes(panel: Panel, focal_mm: float) -> dict[str, Any]:
    """Return the changes that give an ideal camera another field."""
    here = focal_length_mm(panel.view)
    assert here is not None
    return {f"camera.{name}": value for name, value in (panel.scene.camera.zoom_keys(focal_mm, here) or {}).items()}


def _turn_lens(panel: Panel, value: Any) -> Turn:
    """Change the lens for another of the list; f-number and focus stay as far as it reaches."""
    if not isinstance(value, str):
        raise InputError(f"lens: must be a name of the list (got {str(value)[:40]!r})")
    scene = panel.scene
    if value == current_name(scene):
        return panel.same()
    entry = _chosen_lens(scene, value)
    lens = scene.camera.lens_camera
    air = {} if lens is None or isinstance(lens.lens, str | dict) else lens.lens.air
    own = {
        "kind": "realistic" if lens is None else scene.camera.kind,
        "lens": {"design": entry.name, **air} if air else entry.name,
        "focus": {"distance_m": INFINITY_M},
    }
    behind, left_out = keys_as(scene.camera, own, without=("view", "lens", "focus", "opening"))
    changed = with_camera(scene, behind)
    messages = tuple(f"a camera with a lens has no {name}: left out" for name in left_out)
    if air:
        try:
            setting.lens_setting(changed)
        except InputError as problem:
            messages = (*messages, f"at 20 degrees: {problem}")
            own["lens"] = entry.name
            changed = with_camera(scene, behind | own)
    keys: dict[str, Any] = {"camera.lens": own["lens"]}
    f_number, (widest, narrowest) = f_number_of_camera(panel.view), f_numbers(changed)
    if f_number is not None and widest < narrowest:
        keys["camera.f_number"] = min(max(f_number, widest), narrowest)
        if f_number < widest * (1 - 1e-9):
            messages = (*messages, f"{entry.title} opens to f/{widest:.3g}")
    nearest, metres = nearest_focus_m(changed), _focus_m(panel.view)
    if nearest is not None and metres < nearest:
        messages, metres = (*messages, f"its nearest focus is {nearest:.3g} m"), nearest
    keys["camera.focus"] = {"distance_m": metres}
    if scene.camera.outline.shape != "circle" and changed.load_lens().stop is None:
        keys["camera.aperture"] = {"shape": "circle"}
        messages = (*messages, f"{entry.title} has no stop to shape: its rims are round")
    if lens is None:
        mounted = change_scene(changed, camera={name.removeprefix("camera."): key for name, key in keys.items()})
        return Turn(panel.dials, {"camera": plain_keys(mounted.camera)}, messages)
    opening = set() if "camera.f_number" in keys else KEY_GROUPS["opening"]
    gone = sorted(KEY_GROUPS["view"] | KEY_GROUPS["lens"] | opening)
    of_lens = [f"camera.{name}" for name in gone if getattr(lens, name, None) is not None]
    return Turn(panel.dials, dict.fromkeys(of_lens) | keys, messages)


def _focus_m(scene: Scene) -> float:
    """Return the distance of the plane in focus [m], to the film of a real lens; infinity where there is none."""
    found = perspective(scene)
    if found is not None and math.isfinite(found.focus_mm):
        return min(found.focus_mm * 1e-3, INFINITY_M)
    if not (scene.camera.focuses or scene.camera.sees_all_around):
        return float(math.dist(scene.camera.eye, scene.camera.target)) * scene.metres_per_unit
    return INFINITY_M


def _turn_stop(panel: Panel, value: Any) -> Turn:
    """Give the stop another shape."""
    shape = word("stop", value, SHAPES)
    if (words := stop_is_fixed(panel.scene)) is not None:
        return panel.same(words)
    aperture: dict[str, Any] = {"shape": shape}
    if shape == "polygon":
        aperture["blades"] = _DEFAULT_BLADES
    return Turn(panel.dials, {"camera.aperture": aperture})


def _turn_blades(panel: Panel, value: Any) -> Turn:
    """Make the stop of so many blades; 0 makes it round."""
    count = number("blades", value)
    if count != round(count):
        raise InputError(f"blades: must be a whole number (got {count:g})")
    if (words := stop_is_fixed(panel.scene)) is not None:
        return panel.same(words)
    if count == 0:
        return Turn(panel.dials, {"camera.aperture": {"shape": "circle"}})
    blades, messages = _clamp(count, BLADES, f"a stop has from {BLADES[0]} to {BLADES[1]} blades")
    aperture = panel.scene.camera.outline
    kept = {}
    if isinstance(aperture, lens_settings.PolygonAperture):
        kept = {name: getattr(aperture, name) for name in ("curvature", "rotation_degrees") if getattr(aperture, name)}
    return Turn(panel.dials, {"camera.aperture": {"shape": "polygon", "blades": int(blades)} | kept}, messages)


@remember(most=KEPT, by=optics_key)
def stop_is_fixed(scene: Scene) -> str | None:
    """Return why the stop of a camera cannot be shaped; None where it can."""
    camera = scene.camera
    if camera.fixed_outline is None and camera.lens_camera is not None and scene.load_lens().stop is None:
        return "this lens has no stop: its rims limit the light"
    return camera.fixed_outline


def _turn_format(panel: Panel, value: Any) -> Turn:
    """Put another film behind the lens."""
    name = word("format", value, tuple(SIDES_MM))
    film = change_scene(panel.scene, film=dict.fromkeys(SIZES) | {"format": name})
    size = film_mm(film)
    return Turn(replace(panel.dials, whole_mm=size, cropped_mm=size, body=None), {"film.format": name})


def _turn_body(panel: Panel, value: Any) -> Turn:
    """Take a camera body by name: its sensor, as far as the picture fills it, and its speeds; None takes no other."""
    if value is None:
        return Turn(replace(panel.dials, body=None))
    body = BODIES[word("body", value, tuple(BODIES))]
    width_mm = body.width_mm(panel.scene.film.resolution)
    size = film_mm(change_scene(panel.scene, film=dict.fromkeys(SIZES) | {"width_mm": width_mm}))
    held = replace(panel, dials=replace(panel.dials, whole_mm=size, cropped_mm=size, body=value))
    turned = held.same()
    if panel.dials.mode != "relative":
        low, high = body.iso
        iso, messages = _clamp(panel.settings.iso, held.limits.iso, f"{body.label} has ISO {low:g} to {high:g}")
        turned = _relink(held, replace(panel.settings, iso=iso), messages)
    return replace(turned, changes={**turned.changes, "film.width_mm": width_mm})


def _turn_kit(panel: Panel, value: Any) -> Turn:
    """Take a body with one of its usual lenses, by the name of the kit; None takes no other."""
    if value is None:
        return panel.same()
    body, lens = KITS[word("kit", value, tuple(KITS))]
    held, mounted = _turn_body(panel, body), _turn_lens(panel, lens)
    return Turn(held.dials, {**held.changes, **mounted.changes}, (*held.messages, *mounted.messages))


BALANCES = (NO_BALANCE, *LIGHTS)


def _turn_white_balance(panel: Panel, value: Any) -> Turn:
    """Choose the light that is made grey, by name or as a temperature [K]."""
    if isinstance(value, str):
        return Turn(panel.dials, {"picture.white_balance": word("white_balance", value, BALANCES)})
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"white_balance: must be a light or a temperature in kelvin (got {str(value)[:40]!r})")
    return _turn_temperature(panel, value)


def _turn_temperature(panel: Panel, value: Any) -> Turn:
    """Choose the colour temperature [K] of the light that is made grey."""
    words = f"temperatures go from {COOLEST:g} to {HOTTEST:g} K"
    kelvin, messages = _clamp(number("temperature_k", value), (COOLEST, HOTTEST), words)
    balance = panel.scene.picture.white_balance
    tint = {} if balance is None or balance.tint is None else {"tint": balance.tint}
    return Turn(panel.dials, {"picture.white_balance": {"temperature_k": kelvin} | tint}, messages)


def _turn_tone(panel: Panel, value: Any) -> Turn:
    """Choose the tone curve."""
    return Turn(panel.dials, {"picture.tone": word("tone", value, TONES)})


def _turn_lut(panel: Panel, value: Any) -> Turn:
    """Show the picture by a table of colours beside the scene; by none with None."""
    return Turn(panel.dials, {"picture.lut": None if value is None else word("lut", value, tables_of(panel.scene))})


DIALS: dict[str, Callable[[Panel, Any], Turn]] = {
    "mode": _turn_mode,
    "f_number": _turn_f_number,
    "shutter_s": _turn_time,
    "iso": _turn_iso,
    "auto_iso": _turn_auto_iso,
    "ev": _turn_ev,
    "lock": _turn_lock,
    "metering": _turn_metering,
    "focus_m": turn_focus,
    "zoom": _turn_zoom,
    "lens": _turn_lens,
    "stop": _turn_stop,
    "blades": _turn_blades,
    "format": _turn_format,
    "body": _turn_body,
    "kit": _turn_kit,
    "white_balance": _turn_white_balance,
    "temperature_k": _turn_temperature,
    "tone": _turn_tone,
    "lut": _turn_lut,
}


def turn_dial(panel: Panel, name: str, value: Any) -> Turn:
    """Turn a dial.

    Parameters
    ----------
    panel
        The camera in use; without a reading of the meter, the exposure that stands is kept.
    name, value
        Of the dial, as `dial_list` has them.

    Raises
    ------
    InputError
        There is no such dial, or the value is not one of its kind; nothing has changed.
    """
    if name not in DIALS:
        raise InputError(f"{name[:40]}: is no dial{near_name(name, DIALS)} (allowed: {base.listed(list(DIALS))})")
    return DIALS[name](panel, value)


def wheel(scene: Scene) -> dict[str, str]:
    """How the wheel zooms this camera: ``zoom``, ``angle``, ``crop`` or ``none``, and how to say it."""
    does = zoom_kind(scene)
    return {"does": does, "text": ZOOM_TEXTS[does]}
