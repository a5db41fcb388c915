"""Continuous autofocus (AF-C) as a servo: where the focus stands, and which exposure is set, in each frame.

What is measured in a frame is known later, so where the subject is by now is predicted from its motion, and a drive of
limited speed and acceleration follows the prediction. Measurements come in as coordinates of focus; the motion is one
of vergence, the reciprocal of the distance, of which a subject at constant speed has a simple law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core import __version__
from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.core.files import kernels_dir, name_errors
from rptcam_cl.core.remember import Disk
from rptcam_cl.device.session import Session
from rptcam_cl.optics.charts import FAINT, INK, add_key, new_figure, series, styled
from rptcam_cl.rendering.account import resolve_exposure
from rptcam_cl.scene.camera import ANOTHER_LENS, KEY_GROUPS
from rptcam_cl.scene.changes import at_rest, change_scene, set_keys
from rptcam_cl.scene.exposure import ContinuousFocus
from rptcam_cl.scene.scene import Scene
from rptcam_cl.studies.focus.controller import find_focus, in_focus
from rptcam_cl.studies.focus.drives import Drive, focus_drive
from rptcam_cl.studies.focus.probe import NoContrast, OutOfReach

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Found = TypeVar("Found")

#
# The motion of the subject: two extended Kalman filters of vergence, its rate of change and the subject's acceleration.
#
# At an even acceleration a away from the camera the distance 1 / w becomes 1 / w - u t / w^2 + a t^2 / 2. A calm
# subject keeps its speed but for a little noise. The acceleration of an agile one, as feet and brakes can do, fades
# away after a while, as another takes its place (Singer's model). Which of both it is follows from how well they
# predict, and each is corrected from what both knew. (Y. Bar-Shalom, X. Li, T. Kirubarajan, Estimation with
# Applications to Tracking and Navigation, 2001: 8.2.3 Singer's model, 11.6.6 interacting models.)

_CALM = 1.5  # acceleration of a calm subject [m/s^2]
_AGILE, _AGILE_S = 8.0, 0.25  # standard deviation of that of an agile one [m/s^2], and how long it lasts [s]
STAYS = 0.98  # chance that a subject is as calm or agile as at the measurement before
FAST = 10.0  # speeds that a subject has when it is first seen [m/s]
_FAR_DRIFT = 1.0  # depths of focus per second^2 that count as acceleration of whatever is far away
_LEAST_ERROR = 0.05  # depths of focus that a measurement is off at least
NEARLY = 0.9  # of the way to the camera, as far as a prediction goes
CERTAIN = 1.5  # standard errors of the rate at which a subject is taken to move
_JUMP, CHANCE = 0.5, 5.0  # depths of focus and standard errors beyond which another subject is measured
Array = NDArray[np.float64]


def moved(state: Array, t: float) -> Array:
    """Return vergence [1/m], its rate [1/(m s)] and the acceleration [m/s^2] (3,) some seconds later."""
    vergence, rate, acceleration = state.tolist()
    left = acceleration * math.exp(-t / _AGILE_S)
    if vergence <= 0:
        return np.array([vergence + rate * t, rate, left])
    later = vergence / (1 - min(rate * t / vergence - acceleration * vergence * t * t / 2, NEARLY))
    return np.array([later, (rate / vergence**2 - acceleration * t) * later**2, left])


def slopes(state: Array, t: float) -> Array:
    """Return the derivatives (3, 3) of the moved state."""
    vergence, rate, _ = state.tolist()
    of_distance = np.array([[1, t, t * t / 2], [0, 1, t], [0, 0, math.exp(-t / _AGILE_S)]])
    if vergence <= 0:
        return np.asarray(of_distance * np.array([[1, 1, 0], [1, 1, 0], [1, 1, 1]]))
    later, later_rate, _ = moved(state, t).tolist()
    before = np.array([[-1 / vergence**2, 0, 0], [2 * rate / vergence**3, -1 / vergence**2, 0], [0, 0, 1]])
    after = np.array([[-(later**2), 0, 0], [-2 * later_rate * later, -(later**2), 0], [0, 0, 1]])
    return np.asarray(after @ of_distance @ before)


@dataclass(frozen=True)
class _Track:
    """What is known of a subject's motion, taken for calm and for agile.

    Attributes
    ----------
    time_s : float
        Of the last measurement.
    states : (2, 3) array
        As `moved` has them.
    covariances : (2, 3, 3) array
        Of the states.
    chances : (2,) array
        That the subject is calm, and agile.
    """

    time_s: float
    states: Array
    covariances: Array
    chances: Array

    @classmethod
    def start(cls, time_s: float, vergence: float, error: float) -> _Track:
        """Return the track of a subject just seen."""
        known = np.diag([error**2, (FAST * vergence**2) ** 2, 0.0])
        agile = known + np.diag([0.0, 0.0, _AGILE**2])
        return cls(time_s, np.array([[vergence, 0.0, 0.0]] * 2), np.stack([known, agile]), np.array([0.5, 0.5]))

    @property
    def rate(self) -> float:
        """Change of the vergence [1/(m s)]."""
        return float(self.chances @ self.states[:, 1])

    @property
    def sure(self) -> _Track:
        """The track with its motion as far as it is more than chance: at rest, noise alone seems to move a subject."""
        doubt = CERTAIN**2 * float(self.covariances[0, 1, 1])
        share = max(1 - doubt / self.rate**2, 0.0) if self.rate else 0.0
        return replace(self, states=self.states * [1, share, share])

    def vergence_at(self, time_s: float) -> float:
        """Return the vergence at a later moment [1/m]."""
        return float(self.chances @ [moved(state, time_s - self.time_s)[0] for state in self.states])

    def at(self, time_s: float, sharp: float) -> _Track:
        """Return the expected track at a later moment, where a depth of focus is worth so much [1/m]."""
        joint = self.chances[:, None] * np.array([[STAYS, 1 - STAYS], [1 - STAYS, STAYS]])
        chances, t = joint.sum(axis=0), time_s - self.time_s
        states, covariances = [], []
        for kind, shares in enumerate((joint / chances).T):
            mean = shares @ self.states
            away = self.states - mean
            spread = np.einsum("k,kij->ij", shares, self.covariances + away[:, :, None] * away[:, None])
            if kind == 0:
                mean, spread = mean * [1, 1, 0], spread * np.outer([1, 1, 0], [1, 1, 0])
            state, by = moved(mean, t), slopes(mean, t)
            pushed = np.array([t * t / 2, t, 0]) * math.hypot(_CALM * max(state[0], 0.0) ** 2, _FAR_DRIFT * sharp)
            new = kind * _AGILE**2 * -math.expm1(-2 * t / _AGILE_S)
            states.append(state)
            covariances.append(by @ spread @ by.T + np.outer(pushed, pushed) + np.diag([0.0, 0.0, new]))
        return _Track(time_s, np.array(states), np.array(covariances), chances)

    def follow(self, time_s: float, vergence: float, error: float, sharp: float) -> _Track | None:
        """Return the track after a measurement; None where another subject must have been measured.

        Parameters
        ----------
        error
            Standard error of the measurement [1/m].
        sharp
            What a depth of focus is worth [1/m].
        """
        expected = self.at(time_s, sharp)
        off, variances = vergence - expected.states[:, 0], expected.covariances[:, 0, 0] + error**2
        if abs(off[1]) > _JUMP * sharp + CHANCE * math.sqrt(variances[1]):
            return None
        gains = expected.covariances[:, :, 0] / variances[:, None]
        fit = -0.5 * (off**2 / variances + np.log(variances))
        chances = expected.chances * np.exp(fit - fit.max())
        return replace(
            expected,
            states=expected.states + gains * off[:, None],
            covariances=expected.covariances - gains[:, :, None] * expected.covariances[:, None, 0],
            chances=chances / chances.sum(),
        )


#
# The drive: what moves to focus, with its inertia.

# Lenses of 50 mm went from 14 inches to 8 feet, by 9 mm, in 0.20 to 0.31 s, measurement and all (J. Kenny, Focus Speed,
# rev0.net, 2017): 0.6 focal lengths a second, reached in 50 ms, is a drive of that kind.
FOCAL_LENGTHS_PER_S, RISE_S = 0.6, 0.05
STEP_S = 1e-3  # of its simulation at most
_BRAKES = 0.8  # of its acceleration with which it slows down, so that steps of the simulation cannot make it overshoot
_SETTLES_S = 4e-3  # time constant with which it comes to rest


@dataclass(frozen=True)
class DriveLimits:
    """What a drive can do, along the coordinate of focus [mm].

    Attributes
    ----------
    reach : tuple of float
        Least and greatest coordinate.
    speed, acceleration : float
        At most [mm/s, mm/s^2].
    """

    reach: tuple[float, float]
    speed: float
    acceleration: float


def _drive_limits(drive: Drive, settings: ContinuousFocus) -> DriveLimits:
    """Return the limits of a camera's drive: as its lens file says, or else as usual."""
    low, high = sorted(drive.coordinate(state) for state in drive.limits)
    known = drive.motor
    if known is None:
        speed = FOCAL_LENGTHS_PER_S * drive.focal_length_mm * drive.depth_of_focus / drive.sharp_mm
        acceleration = speed / RISE_S
    else:
        speed, acceleration = known.speed_mm_s, known.acceleration_mm_s2
    if settings.speed is not None:
        speed = min(speed, settings.speed * drive.depth_of_focus)
    return DriveLimits((low, high), speed, acceleration)


def push(
    place: float, speed: float, wanted: float, wanted_speed: float, step_s: float, limits: DriveLimits
) -> tuple[float, float]:
    """Return where a drive is, and how fast, one step later, on its way to a place that moves.

    It brakes in time: from a distance e it comes to rest at the acceleration a if it goes no faster than sqrt(2 a e).
    """
    away = wanted - place
    brakes = _BRAKES * limits.acceleration
    near = brakes * _SETTLES_S**2
    if abs(away) <= near:
        closing = away / _SETTLES_S
    else:
        closing = math.copysign(math.sqrt(2 * brakes * (abs(away) - near / 2)), away)
    aim = min(max(wanted_speed + closing, -limits.speed), limits.speed)
    most = limits.acceleration * step_s
    new = speed + min(max(aim - speed, -most), most)
    place += (speed + new) / 2 * step_s
    low, high = limits.reach
    return (place, new) if low <= place <= high else (min(max(place, low), high), 0.0)


#
# The servo of a sequence.

NODES = 257  # of the table between coordinate and vergence


class Servo:
    """Continuous autofocus, on one subject after the other.

    Parameters
    ----------
    place
        Coordinate at which it begins, in focus.
    limits
        Of the drive.
    vergence
        Returns 1 / distance of what is sharp at a coordinate [1/m], rising or falling all the way.
    settings
        Of the sequence.

    Attributes
    ----------
    place : float
        Coordinate of the focus.
    expected : float
        Coordinate at which the subject is expected.
    speed : float
        Of the drive [mm/s].
    is_limited : bool
        Whether the drive was at its greatest speed and behind at the last frame.
    """

    def __init__(
        self, place: float, limits: DriveLimits, vergence: Callable[[float], float], settings: ContinuousFocus
    ) -> None:
        self.place, self.expected, self.speed, self.is_limited = place, place, 0.0, False
        self._held = place
        self._limits, self._exact, self._settings = limits, vergence, settings
        self._time_s = 0.0
        self._waiting: list[tuple[float, float | None, float]] = []  # of measurements: time, place and error
        self._track: _Track | None = None
        self._other: _Track | None = None
        self._since_s = 0.0

    @cached_property
    def _table(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coordinates and their vergence, as exact ones take their time."""
        places = np.linspace(*self._limits.reach, NODES)
        return places, np.array([self._exact(float(place)) for place in places])

    def _vergence(self, place: float) -> float:
        return float(np.interp(place, *self._table))

    def _coordinate(self, vergence: float) -> float:
        places, vergences = self._table
        sense = 1 if vergences[-1] > vergences[0] else -1
        return float(np.interp(vergence, vergences[::sense], places[::sense]))

    def _worth(self, place: float, sharp_mm: float) -> float:
        """Return how many 1/m a depth of focus is worth."""
        return abs(self._vergence(place + sharp_mm / 2) - self._vergence(place - sharp_mm / 2)) or 1e-12

    def measure(self, place: float | None, error: float = 0.0) -> None:
        """Take a measurement of this moment, which is known after a delay.

        Parameters
        ----------
        place
            Coordinate at which the subject is sharp; None where nothing was found.
        error
            Its standard error [mm].
        """
        self._waiting.append((self._time_s, place, error))

    def next_frame(self, frame_s: float, sharp_mm: float) -> None:
        """Go on to the next frame.

        Parameters
        ----------
        frame_s
            From the frame before to this one [s].
        sharp_mm
            Depth of focus, in units of the coordinate.
        """
        begun, steps = self._time_s, max(math.ceil(frame_s / STEP_S - 1e-9), 1)
        step_s = frame_s / steps
        for step in range(1, steps + 1):
            self._time_s = begun + step * step_s
            self._take_in(sharp_mm)
            before, self._held = self._held, self._hold(sharp_mm)
            wanted_speed = (self._held - before) / step_s
            self.place, self.speed = push(self.place, self.speed, self._held, wanted_speed, step_s, self._limits)
            behind = abs(self._held - self.place) > sharp_mm / 4
            self.is_limited = behind and abs(self.speed) > 0.999 * self._limits.speed

    def _take_in(self, sharp_mm: float) -> None:
        """Take what is known by now to the motion of the subject."""
        while self._waiting and self._waiting[0][0] + self._settings.delay_s <= self._time_s + 1e-9:
            time_s, place, error = self._waiting.pop(0)
            if place is None:
                self._other = None
                continue
            vergence, sharp = self._vergence(place), self._worth(place, sharp_mm)
            off = max(error / sharp_mm, _LEAST_ERROR) * sharp
            if self._track is None:
                self._track = _Track.start(time_s, vergence, off)
                continue
            track = self._track.follow(time_s, vergence, off, sharp)
            if track is not None:
                self._track, self._other = track, None
                continue
            other = None if self._other is None else self._other.follow(time_s, vergence, off, sharp)
            if other is None:
                other, self._since_s = _Track.start(time_s, vergence, off), time_s
            self._other = other
            if time_s - self._since_s >= self._settings.lock_s - 1e-9:
                self._track, self._other = other, None

    def _hold(self, sharp_mm: float) -> float:
        """Return the coordinate to drive to: the last one, within a band of where the subject is expected.

        The band is as much narrower as the subject goes before the lock ends, so that what moves is in its middle. What
        has not been seen for that long stays where it was expected then.
        """
        if self._track is None:
            return self._held
        settings, track = self._settings, self._track.sure
        there = track.vergence_at(min(self._time_s, track.time_s + settings.delay_s + settings.lock_s))
        low, high = self._limits.reach
        self.expected = min(max(self._coordinate(there), low), high)
        moves = abs(track.rate) * settings.lock_s / self._worth(self.expected, sharp_mm)
        band = max(settings.hold - moves, 0.0) * sharp_mm
        return min(max(self._held, self.expected - band), self.expected + band)


def _servo_of(drive: Drive, place: float, settings: ContinuousFocus) -> Servo:
    """Return a servo of a camera's drive that begins in focus."""
    limits = _drive_limits(drive, settings)
    return Servo(place, limits, lambda at: drive.first_order_vergence(drive.state_at(at)), settings)


#
# What a user reads of it.

SHARP = 0.5  # depths of focus from what is measured, within which it counts as sharp


@dataclass(frozen=True)
class FrameFocus:
    """The focus of a frame in numbers for people.

    Attributes
    ----------
    number : int
    time_s : float
        Since frame 1.
    subject_m, expected_m, focus_m : float or None
        Distances that are sharp on the axis, as those of autofocus: of what it measures in the frame, of where that was
        expected, and of where the lens is focused; None where there is none.
    off : float or None
        From what is measured to the focus [depths of focus]; above 0 where the subject is farther away.
    speed : float
        Of the drive, towards near subjects [depths of focus per second].
    at_greatest_speed : bool
        Whether the drive was behind at its greatest speed.
    """

    number: int
    time_s: float
    subject_m: float | None
    expected_m: float | None
    focus_m: float | None
    off: float | None
    speed: float
    at_greatest_speed: bool

    @classmethod
    def of(cls, number: int, time_s: float, scene: Scene, metadata: Mapping[str, Any]) -> FrameFocus:
        """Return the focus of a frame as its scene and metadata have it."""
        drive, known = focus_drive(scene), metadata["continuous_focus"]

        def distance(state: float | None) -> float | None:
            return None if state is None else drive.object_distance(state)

        subject, expected, focus = (distance(known[name]) for name in ("measured", "expected", "state"))
        off = None if known["off"] is None else drive.nearer * known["off"]
        speed = drive.nearer * known["speed"]
        return cls(number, time_s, subject, expected, focus, off, speed, known["at_greatest_speed"])


def summary_of(frames: Sequence[FrameFocus]) -> str:
    """Say how many frames are sharp."""
    off = np.abs([frame.off for frame in frames if frame.off is not None])
    if not len(off):
        return "nothing was found in any frame"
    sharp = np.count_nonzero(off <= SHARP)
    return (
        f"within {SHARP:g} depth of focus in {sharp} of {len(off)} frames ({sharp / len(off):.0%}), at most"
        f" {off.max():.2g} off; root mean square {np.sqrt(np.mean(off**2)):.2g}"
    )


def doubts_of(frames: Sequence[FrameFocus]) -> list[str]:
    """Say where the drive is too slow, and where nothing was found."""
    slow = [frame.number for frame in frames if frame.at_greatest_speed]
    lost = [frame.number for frame in frames if frame.off is None]
    said = []
    if slow:
        said.append(
            f"the subject is faster than the focus drive in {len(slow)} of {len(frames)} frames,"
            f" from frame {slow[0]} on"
        )
    if lost:
        said.append(f"nothing to focus on in {len(lost)} of {len(frames)} frames, first in frame {lost[0]}")
    return said


@styled()
def servo_plot(frames: Sequence[FrameFocus], title: str) -> Figure:
    """Plot subject, prediction and lens over time, and below how far off the focus is."""
    from matplotlib.ticker import LogLocator

    figure = new_figure(title, (8.0, 5.6))
    distances, errors = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    seconds = [frame.time_s for frame in frames]

    def draw(name: str, style: str, colour: str, label: str, size: float) -> Any:
        values = [getattr(frame, name) or math.nan for frame in frames]
        return distances.plot(seconds, values, style, color=colour, label=label, markersize=size)[0]

    handles = [
        draw("subject_m", "o", FAINT, "subject, as measured", 4),
        draw("focus_m", "-", series(0), "lens", 0),
        draw("expected_m", "--", series(1), "where it was expected", 0),
    ]
    distances.set_yscale("log")
    distances.yaxis.set_major_formatter("{x:g}")
    distances.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
    distances.yaxis.set_minor_formatter("{x:g}")
    distances.set_ylabel("distance [m]")
    off = np.array([math.nan if frame.off is None else frame.off for frame in frames])
    errors.axhspan(-SHARP, SHARP, color=series(2), alpha=0.15, linewidth=0)
    errors.axhline(0.0, color=INK, linewidth=0.8)
    errors.plot(seconds, off, "o-", markersize=3, color=series(0))
    largest = max(1.0, float(np.nanmax(np.abs(off), initial=0.0)) * 1.05)
    errors.set_ylim(-largest, largest)
    errors.set_ylabel("off [depths of focus]")
    errors.set_xlabel("time [s]")
    add_key(figure, handles)
    return figure


#
# Focus and exposure that follow from all frames before: each frame is measured alone, and a policy goes over them.
#
# What is measured in a frame does not depend on other frames, so that it is kept on disk: a frame that is rendered
# alone, anywhere, has the focus and exposure that it has in its sequence, and finds what another run has measured
# already.

KIND = "frames"
# All code of these rooms and all kernels decide a measurement.
ROOMS = ("core", "device", "optics", "scene", "rendering", "studies")


def needs_tracking(scene: Scene) -> bool:
    """Whether focus or exposure of a frame follow from the frames before."""
    return scene.sequence is not None and (
        scene.sequence.continuous_focus is not None or scene.sequence.exposure_time_constant_s is not None
    )


class FrameTracker:
    """The frames of a sequence with their focus and exposure, from the first one on.

    Parameters
    ----------
    scene
        With a sequence that `needs_tracking`.
    open_session
        Returns the device; called where something is to be measured, or was by its driver and is kept.

    Attributes
    ----------
    measured : int
        Frames that were measured here.
    """

    def __init__(self, scene: Scene, open_session: Callable[[], Session]) -> None:
        assert scene.sequence is not None, "of a scene with frames"
        self._scene, self._sequence, self._open = scene, scene.sequence, open_session
        self._session: Session | None = None
        self._number = 0
        self._frame: tuple[Scene, dict[str, Any]] | None = None
        self._servo: Servo | None = None
        self._lens: Any = None
        self._reading: float | None = None
        self.measured = 0

    def frame(self, number: int) -> tuple[Scene, dict[str, Any]]:
        """Return the scene of a frame in focus and exposed, and metadata of how it came about.

        Raises
        ------
        InputError
            When the first frame has nothing to focus on, or a frame no light to meter.
        """
        if number < self._number:
            self._number, self._servo, self._reading = 0, None, None
        while self._number < number or self._frame is None:
            self._number += 1
            self._frame = self._next(self._number)
        return self._frame

    def _next(self, number: int) -> tuple[Scene, dict[str, Any]]:
        still = set_keys(self._scene, self._sequence.changes(self._scene.shutter.open_s, number))
        metadata: dict[str, Any] = {}
        with name_errors(f"frame {number}"):
            if self._sequence.continuous_focus is not None and at_rest(still).requested_autofocus is not None:
                still, metadata = self._focus(still)
            is_metered = still.exposure.mode == "auto" and still.exposure.lock_cd_m2 is None
            if self._sequence.exposure_time_constant_s is not None and is_metered:
                still = self._expose(still, self._sequence.exposure_time_constant_s)
        return still, metadata

    def _focus(self, still: Scene) -> tuple[Scene, dict[str, Any]]:
        settings, frame_s = self._sequence.continuous_focus, 1 / self._sequence.frames_per_second
        assert settings is not None
        scene = at_rest(still)
        found = self._measure_once("focus", scene, lambda session: _focus_of(scene, session))
        drive, lens = focus_drive(scene), _lens_of(scene)
        state, error = found or (None, 0.0)
        measured, sharp = None if state is None else drive.coordinate(state), drive.depth_of_focus
        metadata: dict[str, Any] = {"measured": state}
        if self._servo is None or (lens != self._lens and measured is not None):
            if state is None or measured is None:
                raise InputError("camera.focus.auto: nothing to focus on in the first frame")
            self._servo, place, where = _servo_of(drive, measured, settings), measured, state
            metadata |= {"state": state, "expected": state, "speed": 0.0, "at_greatest_speed": False}
        else:
            servo = self._servo
            servo.next_frame(frame_s, sharp)
            place, where = servo.place, drive.state_at(servo.place)
            metadata |= {"state": where, "expected": drive.state_at(servo.expected), "speed": servo.speed / sharp}
            metadata["at_greatest_speed"] = servo.is_limited
        metadata["off"] = None if measured is None else (place - measured) / sharp
        self._servo.measure(measured, error)
        self._lens = lens
        return change_scene(still, camera=drive.camera_keys(where)), {"continuous_focus": metadata}

    def _expose(self, still: Scene, time_constant_s: float) -> Scene:
        read = self._measure_once("meter", still, lambda session: _reading_of(still, session))
        assert read is not None, "auto exposure is metered"
        if self._reading is None:
            self._reading = read
        else:
            share = -math.expm1(-1 / (self._sequence.frames_per_second * time_constant_s))
            self._reading *= (read / self._reading) ** share
        return set_keys(still, {"exposure.lock_cd_m2": self._reading})

    def _measure_once(self, what: str, scene: Scene, measure: Callable[[Session], Found]) -> Found:
        """The measurement of a frame, made here or by an earlier run."""
        session = self._session = self._session or self._open()

        def measure_here() -> Found:
            self.measured += 1
            return measure(session)

        disk = Disk(KIND, ROOMS, tuple(sorted(path.name for path in kernels_dir().iterdir())))
        return disk.find_or_make((__version__, session.info.driver, what, scene.content_hash()), measure_here)


def _reading_of(scene: Scene, session: Session) -> float | None:
    """The reading of the exposure meter [cd/m²]; a scene with autofocus is metered in focus."""
    if at_rest(scene).requested_autofocus is not None:
        scene = in_focus(at_rest(scene), session)[0]
    return resolve_exposure(scene, session)[1]


def _focus_of(scene: Scene, session: Session) -> tuple[float, float] | None:
    """The focus state that autofocus finds, and the standard error of its coordinate [mm]; None where it finds none."""
    settings = scene.requested_autofocus
    assert settings is not None, "of a scene with autofocus"
    try:
        report = find_focus(scene, session, settings)
        sharp = report.depth_of_focus_mm
        return report.state, report.error if report.failure is None else max(min(report.error, 10 * sharp), sharp)
    except (NoContrast, OutOfReach):
        return None


def _lens_of(scene: Scene) -> tuple[Any, ...]:
    """The lens, its zoom and its view, which give the coordinate of focus its meaning."""
    return tuple(getattr(scene.camera, name, None) for name in sorted(ANOTHER_LENS | KEY_GROUPS["view"]))
