"""What the readers of other programs' lens files build: rows in our own form, with notes on what was left out."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import LINE_D_NM
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.optics.files.glasses import named_glass, near_glass_words, near_names, other_name
from rptcam_cl.optics.files.native import document_of, read_native
from rptcam_cl.optics.glass import NO_DISPERSION
from rptcam_cl.optics.lens import Lens, in_configuration, limiting_surface, system_matrix
from rptcam_cl.optics.ray_trace import trace_crossings
from rptcam_cl.optics.surface import rotation_matrix, tilt_of

Array = NDArray[np.float64]

FARTHEST = 1e9  # an object beyond this is at infinity [unit]

# Coordinate breaks of sequential lens files, followed along the axis and turned into the pose of each surface.


class AxisFrame:
    """The local frame that decentres, tilts and thicknesses carry along.

    Parameters
    ----------
    senses
        Of positive tilts about x, y and z: 1 right handed, -1 left handed.
    """

    def __init__(self, senses: tuple[float, float, float]) -> None:
        self.senses = senses
        self.place = np.zeros(3)
        self.turn = np.eye(3)
        self.nominal = 0.0
        self.stands: list[tuple[Any, Array, Array, float]] = []

    @property
    def is_nominal(self) -> bool:
        """Whether the frame stands on the axis of the lens, untilted."""
        return bool(np.allclose(self.place, (0, 0, self.nominal)) and np.allclose(self.turn, np.eye(3)))

    def advance(self, thickness: float) -> None:
        """Go on to the next surface."""
        self.place = self.place + self.turn @ np.array([0.0, 0.0, thickness])
        self.nominal += thickness

    def bend(
        self,
        decentre: tuple[float, float, float],
        tilt_degrees: tuple[float, float, float],
        tilt_first: bool = False,
    ) -> None:
        """Decentre, then tilt about x, the new y and the new z; or tilt about z, y and x, and then decentre."""
        x, y, z = (sense * angle for sense, angle in zip(self.senses, tilt_degrees, strict=True))
        turns = [rotation_matrix(angles) for angles in ((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, z))]
        if not tilt_first:
            self.place = self.place + self.turn @ np.array(decentre)
        for turn in reversed(turns) if tilt_first else turns:
            self.turn = self.turn @ turn
        if tilt_first:
            self.place = self.place + self.turn @ np.array(decentre)

    def unbend(self, decentre: tuple[float, float, float], tilt_degrees: tuple[float, float, float]) -> None:
        """Undo a tilt, and then a decentre, as REV of CODE V does behind a surface."""
        bent = AxisFrame(self.senses)
        bent.bend((0.0, 0.0, 0.0), tilt_degrees)
        self.turn = self.turn @ bent.turn.T
        self.place = self.place - self.turn @ np.array(decentre)

    def stand(self, row: dict[str, Any]) -> None:
        """Remember that the surface of a row stands here."""
        self.stands.append((row, self.place, self.turn, self.nominal))

    def place_rows(self, straight: bool) -> dict[str, list[float]]:
        """Give each row its decentre and tilt.

        Parameters
        ----------
        straight
            Whether in the frame of the first surface; else in one whose axis goes through the film, which stands here.

        Returns
        -------
        mapping
            Decentre and tilt of the axes of the scene in that frame; empty where it is the same.
        """
        back = self.turn.T

        def keys(place: Array, turn: Array, nominal: float) -> dict[str, list[float]]:
            if not straight:  # else to the bit as they are
                place, turn = back @ (place - self.place) + (0.0, 0.0, self.nominal), back @ turn
            offset = place - (0.0, 0.0, nominal)
            if np.allclose(place, (0, 0, nominal)) and np.allclose(turn, np.eye(3)):
                return {}
            return {"decentre": [float(v) for v in offset], "tilt_degrees": [float(v) for v in tilt_of(turn)]}

        for row, place, turn, nominal in self.stands:
            row |= keys(place, turn, nominal)
        return {} if straight else keys(np.zeros(3), np.eye(3), 0.0)


STEEPEST = math.tan(math.radians(60))  # field that diameters are chosen for
_LEAST_GLASS = 0.3  # of a six-digit code: 003283 means n_d = 2.003
_UNKNOWN_DIAMETER = 1e-6  # small enough for every shape while first-order data are computed
_LEAST_LEFT = 0.1  # of a diameter that is shrunk so that surfaces do not cross
ROUNDED = 1.005  # by which diameters of a file may differ without a word
ROUNDING = 1e-9
FLATTEST = 0.2  # cosine of the light on a tilted surface, at least, for the choice of its diameter
RIM = 1.05  # clear diameters that a file does not give leave this margin around the beam


FAR = 1e9  # an object beyond this is at infinity


def _object_distance(value: float) -> float:
    return value if 0 < abs(value) < FAR else math.inf


@dataclass
class ZoomPositions:
    """Positions of a zoom, counted from 1: how many, and their names, objects and pupils where these differ [unit]."""

    count: int = 1
    names: dict[int, str] = field(default_factory=dict)
    objects: dict[int, float] = field(default_factory=dict)
    pupils: dict[int, float] = field(default_factory=dict)

    @property
    def numbers(self) -> range:
        """Their numbers."""
        return range(1, self.count + 1)


@dataclass
class LensTable:
    """A lens file under construction.

    Attributes
    ----------
    path : str
        File name, for messages.
    name : str
    unit : str
    rows : list of mappings
        Surfaces as in our own form; a missing diameter is worked out from the pupil and the field.
    keys : mapping
        Further top-level keys of our own form.
    notes : list of str
        One line for each thing that was ignored or guessed.
    makers : tuple of str
        Whose glasses come first: those that the user names, then those that the file does.
    pupil_diameter, f_number, object_aperture : float or None
        What the file says about the beam: entrance pupil [unit], or f-number, or sine of the angle at the object.
    field_degrees, object_height, image_height : float
        The widest field that it says, as an angle or a height [unit].
    working : bool
        Whether the f-number is that of the cone at the image of the object, not focal length over pupil.
    stop_opening : float
        Diameter of a real opening in the stop [unit], which no beam widens.
    field_kind : int
        How Zemax counts fields: 0 as angles, 1 at the object, 2 and 3 at the image.
    object_distance : float
        From the object to the first surface [unit], infinite for most lenses.
    pupils : dict
        Diameter of the entrance pupil [unit] of each zoom position, where they differ.
    zoom : ZoomPositions
        As the file counts them.
    """

    path: str
    name: str = ""
    unit: str = "mm"
    rows: list[dict[str, Any]] = field(default_factory=list)
    keys: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    makers: tuple[str, ...] = ()
    pupil_diameter: float | None = None
    f_number: float | None = None
    object_aperture: float | None = None
    working: bool = False
    stop_opening: float = float("inf")
    field_degrees: float = 0.0
    object_height: float = 0.0
    image_height: float = 0.0
    object_distance: float = float("inf")
    field_kind: int = 0
    pupils: dict[str, float] = field(default_factory=dict)
    zoom: ZoomPositions = field(default_factory=ZoomPositions)

    def set_field(self, widest: float) -> None:
        """Take the widest field as Zemax counts it: an angle, an object height or an image height, by `field_kind`."""
        if self.field_kind == 0:
            self.field_degrees = min(widest, 60.0)
        elif self.field_kind == 1:
            self.object_height = widest
        else:
            self.image_height = widest

    def note(self, line: int, text: str) -> None:
        """Remember what was ignored on a line."""
        self.notes.append(f"{self.path}:{line}: {text}")

    def number(self, words: list[str], line: int) -> float:
        """Return the first of some words as a finite number, or say where there is none."""
        return numbers(words[:1], self.path, line, 1)[0]

    def lens(self) -> Lens:
        """Return the lens, its notes among the warnings."""
        if not self.rows:
            raise InputError(f"{self.path}: a lens needs surfaces; the file has none")
        if any("diameter" not in row for row in self.rows):
            self._fill_diameters()
        rows = [{k: v for k, v in row.items() if v is not None} for row in self.rows]
        document = document_of({"name": self.name or self.path, "unit": self.unit, "surfaces": rows, **self.keys})
        lens = read_native(type(document)(document.data, self.path, {}, {}))
        return self._with_pupils(lens).with_warnings(tuple(self.notes))

    def _with_pupils(self, lens: Lens) -> Lens:
        """Return a zoom lens whose stop has in each position the diameter of its pupil."""
        if not self.pupils or lens.stop is None:
            return lens
        open_mm, first = 2 * lens.stop.semi_diameter, next(iter(self.pupils.values()))
        per_pupil = open_mm * lens.first_order().entrance_pupil.diameter_mm / first
        states = [in_configuration(lens, each.name).first_order() for each in lens.configurations]
        stops = [
            per_pupil * self.pupils[each.name] / state.entrance_pupil.diameter_mm
            for each, state in zip(lens.configurations, states, strict=True)
        ]
        positions = [
            replace(each, stop_diameter_mm=stop) for each, stop in zip(lens.configurations, stops, strict=True)
        ]
        return in_configuration(replace(lens, configurations=tuple(positions)), positions[0].name)

    def set_object(self, distance: float) -> None:
        """Take the distance of the object, infinite for 0 and for what lies beyond `FAR`."""
        self.object_distance = _object_distance(distance)

    def add_positions(self, gaps: Sequence[Sequence[float]]) -> None:
        """Take positions of a zoom whose objects are far, and with near objects the states of groups that float.

        The near positions belong to the far ones in their order.

        Parameters
        ----------
        gaps : for each row its thickness in each position, of the last one that to the film [unit]
        """
        zoom, backs = self.zoom, gaps[-1]
        names = [zoom.names.get(k, str(k)) for k in zoom.numbers]
        objects = [_object_distance(zoom.objects.get(k, self.object_distance)) for k in zoom.numbers]
        pupils = [zoom.pupils.get(k, self.pupil_diameter or 0.0) for k in zoom.numbers] if zoom.pupils else []
        last = len(self.rows) - 1
        varied = {row: values for row, values in enumerate(gaps) if row < last and len(set(values)) > 1}
        far = [k for k, away in enumerate(objects) if not 0 < away < FARTHEST]
        near = [k for k, away in enumerate(objects) if 0 < away < FARTHEST]
        if not varied or not far or len(near) % len(far):
            why = "move no surfaces" if not varied else "do not pair near objects with far ones"
            self.notes.append(f"{self.path}: its {len(names)} positions {why}: it is read as saved")
            return
        for row, values in varied.items():
            self.rows[row]["thickness"] = values[far[0]]
        self.object_distance = float("inf")

        def at(k: int) -> dict[int, float]:
            return {row: values[k] for row, values in varied.items()}

        def states(of: int) -> list[dict[str, Any]]:
            found = []
            for k in near[of :: len(far)]:
                rest = sum(row.get("thickness", 0.0) for place, row in enumerate(self.rows) if place not in varied)
                away = objects[k] + rest + sum(at(k).values()) + backs[k]
                found.append({"distance": away, "gaps": at(k), "film_shift": backs[k] - backs[far[of]]})
            return sorted(found, key=lambda state: -state["distance"])

        if pupils and len(far) > 1:
            self.pupils = {names[k]: pupils[k] for k in far}
            self.pupil_diameter = pupils[far[0]]
        if len(far) == 1:
            self.keys["floating"] = states(0)
            return
        rows = [{"name": names[k], "gaps": at(k), "floating": states(of)} for of, k in enumerate(far)]
        self.keys["configurations"] = [{key: value for key, value in row.items() if value} for row in rows]

    def place(self, frame: AxisFrame) -> None:
        """Place the surfaces and the film, which stands where mirrors have folded the axis to."""
        folds = not frame.is_nominal and any(row.get("mirror") for row in self.rows)
        if fold := frame.place_rows(not folds):
            self.keys["fold"] = fold
        elif not frame.is_nominal:
            self.notes.append(
                f"{self.path}: its image is moved or tilted against the axis of the first surface, but the film stands"
                " across that axis"
            )

    def glass(self, name: str, line: int, nd: float | None = None, vd: float | None = None) -> Any:
        """Return the `glass` entry of a name, or of the index and Abbe number that stand beside it.

        Raises
        ------
        InputError
            When no catalogue has the name and the file has no index; the nearest names are suggested.
        """
        if (model := model_glass(name)) is not None:
            return model
        named = named_glass(name, self.makers, successors=True)
        if named is None and (known := other_name(name)) is not None:
            entry, remark = known
            self.note(line, f"glass {name} is taken as {remark}")
            return entry
        if named is not None:
            if remark := named.remark(name.strip("'\"")):
                self.note(line, remark)
            return named.written
        if nd is None or nd <= 1:
            near = near_names(name)
            hint = f"did you mean {', '.join(near)}?" if near else "its n_d and V_d would do"
            raise InputError(f"{self.path}:{line}: glass {name} is in no catalogue and the file has no index; {hint}")
        if vd is None or vd <= 0:
            self.note(line, f"glass {name} is replaced by the index {nd:g} beside it")
            return {"index": nd}
        beside, near_by = f"the index {nd:g} and Abbe number {vd:g} beside it", near_glass_words(nd, vd)
        self.note(line, f"glass {name} is replaced by {beside}; the nearest known is {near_by}")
        return {"nd": nd, "vd": vd}

    def size_stop(self) -> None:
        """Give the stop the diameter of the axial beam that the file asks for, where it says one.

        The rim of the stop yields to that beam, but not `stop_opening`.
        """
        stop = next((k for k, row in enumerate(self.rows) if row.get("stop")), None)
        if (
            stop is None
            or "centre" in self.rows[stop].get("clear", {})
            or not (self.pupil_diameter or self.f_number or self._cone)
        ):
            return
        lens = self._tiny_lens()
        beam = 2 * abs(float(system_matrix(lens, LINE_D_NM, 0, stop, False)[0] @ self._beam(lens, stop)[:, 0]))
        if not 0 < beam < np.inf:
            return
        row = self.rows[stop]
        rim = row.get("diameter", beam)
        bent = any("decentre" in row for row in self.rows)  # where first-order optics counts along the axis
        if abs(beam - rim) <= (ROUNDED - 1 if bent else ROUNDING) * beam:
            return
        row["diameter"] = min(beam, self.stop_opening)
        if beam > self.stop_opening * ROUNDED:
            words = f"less than the {beam:.5g} of the beam that the file asks for"
            self.notes.append(f"{self.path}: the opening of the stop is {self.stop_opening:.5g}, {words}, and is taken")
        elif beam > rim * ROUNDED:
            words = f"the beam that the file asks for is {beam:.5g} wide at the stop"
            self.notes.append(f"{self.path}: {words}, more than its rim of {rim:.5g}, and is taken")

    @property
    def _cone(self) -> float | None:
        """Sine of the angle of the beam at an object that is not distant."""
        return self.object_aperture if np.isfinite(self.object_distance) else None

    def _tiny_lens(self) -> Lens:
        """Return the lens with diameters that every shape reaches, for first-order data [unit]."""
        tiny = [{**row, "diameter": _UNKNOWN_DIAMETER, "inner_diameter": None} for row in self.rows]
        tiny = [{k: v for k, v in row.items() if v is not None} for row in tiny]
        whole = ("object_medium", "fold", "configurations")
        before: dict[str, Any] = {key: self.keys[key] for key in whole if key in self.keys}
        return read_native(document_of({"name": self.path, "surfaces": tiny, **before}))

    def _beam(self, lens: Lens, stop: int) -> Array:
        """Return height and index times slope, before the first surface, of the marginal and the chief ray (2, 2)."""
        index = float(lens.indices(LINE_D_NM)[0])
        to_stop = system_matrix(lens, LINE_D_NM, 0, stop, False)
        pupil_distance = index * float(np.divide(to_stop[0, 1], to_stop[0, 0])) if to_stop[0, 0] else 0.0
        marginal = self._marginal(lens, stop, pupil_distance)
        slope = self._slope(lens, pupil_distance)
        chief = np.array([-pupil_distance * slope, slope])
        return np.stack([marginal, chief], axis=1) * [[1.0], [index]]

    def _fill_diameters(self) -> None:
        """Give surfaces without a diameter that of the axial beam and the chief ray of the field, to first order."""
        lens = self._tiny_lens()
        missing = [k for k, row in enumerate(self.rows) if "diameter" not in row]
        widest, said = np.zeros(len(self.rows)), self.pupil_diameter
        for name in [each.name for each in lens.configurations] or [""]:
            position = in_configuration(lens, name) if name else lens
            self.pupil_diameter = self.pupils.get(name, said)
            beam = self._beam(position, limiting_surface(position))
            for k in missing:
                heights, slopes = np.abs(system_matrix(position, LINE_D_NM, 0, k, False) @ beam)
                if self.rows[k].get("stop"):  # that of the first position, which the others' pupils are set by
                    widest[k] = widest[k] or heights[0] / _narrows(position, k, slopes[0])
                else:
                    widest[k] = max(widest[k], RIM * heights.sum() / _narrows(position, k, slopes.sum()))
        self.pupil_diameter = said
        for k in missing:
            row, height = self.rows[k], float(widest[k])
            if row.get("radius") and not row.get("conic") and not row.get("aspheric"):
                height = min(height, 0.95 * abs(row["radius"]))
            row["diameter"] = 2 * max(height, _UNKNOWN_DIAMETER)
        for k in missing if not lens.has_mirrors else ():
            for one, other in ((k - 1, k), (k, k + 1)):
                if one >= 0 and other < len(self.rows):
                    self._uncross(self.rows[k], self.rows[one], self.rows[other])
        self.notes.append(f"{self.path}: diameters that the file does not give were chosen for its pupil and field")

    def _marginal(self, lens: Lens, stop: int, pupil_distance: float) -> Array:
        """Return the height and slope, before the first surface, of the ray along the edge of the axial beam."""
        away = self.object_distance
        if self._cone:
            slope = np.tan(np.arcsin(min(abs(self._cone), 0.99)))
            return np.array([away * slope, slope])
        if self.working and self.f_number and not self.pupil_diameter and np.isfinite(away):
            before, behind = (float(lens.indices(LINE_D_NM)[k]) for k in (0, -1))
            image_slope = abs(float(system_matrix(lens, LINE_D_NM)[1] @ [away, before])) / behind  # per slope at it
            slope = 1 / (2 * self.f_number * image_slope) if image_slope else 0.0
            return np.array([away * slope, slope])
        half = self._half_pupil(lens, stop)
        if not np.isfinite(away) or away + pupil_distance == 0:
            return np.array([half, 0.0])
        slope = half / (away + pupil_distance)
        return np.array([away * slope, slope])

    def _slope(self, lens: Lens, pupil_distance: float) -> float:
        """Return the tangent of the widest field that the file says."""
        if self.object_height and np.isfinite(self.object_distance):
            return abs(self.object_height) / max(abs(self.object_distance + pupil_distance), _UNKNOWN_DIAMETER)
        if self.image_height:
            length = abs(lens.first_order().front_focal_length_mm)
            return min(abs(self.image_height) / length, STEEPEST) if np.isfinite(length) and length else 0.0
        return float(np.tan(np.radians(min(self.field_degrees, 60.0))))

    @staticmethod
    def _uncross(chosen: dict[str, Any], first: dict[str, Any], second: dict[str, Any]) -> None:
        """Shrink a chosen diameter until two neighbouring surfaces do not cross inside it, unless little were left."""
        if first.get("stop") or second.get("stop"):
            return
        whole = chosen["diameter"]
        while chosen["diameter"] > _LEAST_LEFT * whole:
            height = min(first["diameter"], second["diameter"]) / 2
            if first["thickness"] + _sag(second, height) - _sag(first, height) >= 0:
                return
            chosen["diameter"] = min(chosen["diameter"], 2 * height) * 0.98
        chosen["diameter"] = whole  # they cross by more than a rim, which a warning says

    def _half_pupil(self, lens: Lens, stop: int) -> float:
        """Return the radius of the entrance pupil: as the file says, else as its rims let through."""
        if self.pupil_diameter:
            return self.pupil_diameter / 2
        if self.f_number and np.isfinite(lens.first_order().focal_length_mm):
            return abs(lens.first_order().focal_length_mm) / self.f_number / 2
        known = [k for k, row in enumerate(self.rows) if "diameter" in row]
        rims = [stop] if stop in known and self.rows[stop].get("stop") else known
        heights = {k: abs(float(system_matrix(lens, LINE_D_NM, 0, k, False)[0, 0])) for k in rims}
        limits = [self.rows[k]["diameter"] / 2 / height for k, height in heights.items() if height > 0]
        if not limits:
            raise InputError(f"{self.path}: gives no diameters, and no pupil or f-number to work them out from")
        return float(min(limits))


def _narrows(lens: Lens, k: int, slope: float) -> float:
    """Return by how much rays of a slope are nearer to the axis than to the middle of the surface, if it is tilted."""
    pose = lens.surfaces[k].pose
    if pose is None:
        return 1.0
    start = lens.from_scene_axes(np.array([[0.0], [0.0], [-1.0]]), np.array([[0.0], [0.0], [1.0]]))
    direction = trace_crossings(lens, range(k), *start, LINE_D_NM, towards_film=True)[2][0]
    cosine = abs(float(direction @ pose.matrix()[:, 2]))
    return max(cosine - slope * math.sqrt(max(1.0 - cosine**2, 0.0)), FLATTEST) if np.isfinite(cosine) else 1.0


def opening_beside_the_axis(
    row: dict[str, Any], centre: tuple[float, float], diameter: float, inner_diameter: float
) -> None:
    """Move what a row clears to a centre [unit]: its rectangle, a circle and one that is blocked; 0 is no circle.

    Its diameter about the axis becomes one that holds the opening, where there is one.
    """
    clear = row.setdefault("clear", {})
    clear["centre"] = [float(value) for value in centre]
    if diameter:
        clear["diameter"] = diameter
    if inner_diameter:
        clear["inner_diameter"] = inner_diameter
    reach = [diameter / 2 + math.hypot(*centre)] if diameter else []
    if "rectangle" in clear:
        reach.append(
            math.hypot(*(side / 2 + abs(middle) for side, middle in zip(clear["rectangle"], centre, strict=True)))
        )
    if reach:
        row["diameter"] = 2 * min(reach)


def _sag(row: dict[str, Any], height: float) -> float:
    """Return the sag of a surface's sphere [file units]."""
    c = 1.0 / row["radius"] if row.get("radius") else 0.0
    bent = c * height  # ** of a large number would raise
    return float(bent * height / (1.0 + np.sqrt(max(1.0 - bent * bent, 0.0))))


def model_glass(text: str) -> Any:
    """Return the `glass` entry of an index and an Abbe number written as one word; None for other text.

    ``517642``, ``517.642`` and ``517000.642000`` mean n_d = 1.517 and V_d = 64.2; ``1.5168:64.17`` and ``1.5168/64.17``
    say it in full.
    """
    if match := re.fullmatch(r"(\d{3})(\d{3})", text) or re.fullmatch(r"(\d{3,6})\.(\d{3,6})", text):
        above, vd = int(match[1]) / 10 ** len(match[1]), int(match[2]) / 10 ** (len(match[2]) - 2)
        nd = 1 + above if above >= _LEAST_GLASS else 2 + above
    elif match := re.fullmatch(r"([1-4](?:\.\d*)?)[:/](\d+(?:\.\d*)?)", text):
        nd, vd = float(match[1]), float(match[2])
    else:
        return None
    return model(nd, vd)


def model(nd: float, vd: float) -> dict[str, float]:
    """Return the `glass` entry of an index and an Abbe number, of which 0 and `NO_DISPERSION` mean none."""
    return {"nd": nd, "vd": vd} if 0 < vd < NO_DISPERSION else {"index": nd}


def numbers(words: list[str], path: str, line: int, count: int = 0) -> list[float]:
    """Return words as finite numbers, at least `count` of them, or say where one is not."""
    if len(words) < count:
        raise InputError(f"{path}:{line}: expected {'a number' if count == 1 else f'{count} numbers'}")
    try:
        values = [float(word.replace("D", "E").replace("d", "e")) for word in words]
    except ValueError:
        raise InputError(f"{path}:{line}: expected numbers (got {' '.join(words)!r})") from None
    if not all(map(math.isfinite, values)):
        raise InputError(f"{path}:{line}: every number must be finite (got {' '.join(words)})")
    return values
