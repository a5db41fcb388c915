"""Camera models of computer vision, fitted to the chief rays of a lens, and by how much each errs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.exchange.camera_view import View
from rptcam_cl.optics.charts import new_figure, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#
# Camera models of computer vision: how each projects a direction on the picture.
#
# All but the last see (a, b) = (x / z, y / z) and distort it (Brown 1966; the rational and thin-prism terms as OpenCV
# has them). Kannala and Brandt (IEEE PAMI 28, 2006) go by the angle from the axis instead, so that a fisheye fits.
# Parameters are fx, fy, cx, cy [pixels, from the picture's corner] and then the coefficients in the order of OpenCV.

Array = NDArray[np.float64]

_INTRINSICS = ("fx", "fy", "cx", "cy")
_BROWN = ("k1", "k2", "p1", "p2", "k3")
COEFFICIENTS: dict[str, tuple[str, ...]] = {
    "pinhole": (),
    "brown_conrady": _BROWN,
    "rational": (*_BROWN, "k4", "k5", "k6"),
    "thin_prism": (*_BROWN, "k4", "k5", "k6", "s1", "s2", "s3", "s4"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
}
BY_ANGLE = "kannala_brandt"
_LEAST_AHEAD = 0.02  # z of a unit direction below which a plane in front of the camera has no place for it


def normal_points(model: str, directions: Array) -> Array:
    """The coordinates (n, 2) that a model distorts: tangents, or of the model by angles the angle along its azimuth."""
    across = directions[:, :2]
    with np.errstate(all="ignore"):
        if model != BY_ANGLE:
            return np.asarray(across / directions[:, 2:])
        length = np.linalg.norm(across, axis=1)
        angle = np.arctan2(length, directions[:, 2])
        return np.asarray(across * np.where(length > 1e-12, angle / length, 1.0)[:, None])


def _sees(model: str, parameters: Array, directions: Array) -> NDArray[np.bool_]:
    """Return which directions (n, 3) a model of these parameters sees.

    Those ahead of the camera, z > 0; of the model by angles those up to where its radius no longer grows with the
    angle, beyond 90 degrees too, but for what lies straight behind, which has no azimuth.
    """
    if model != BY_ANGLE:
        return np.asarray(directions[:, 2] > 0)
    across = np.linalg.norm(directions[:, :2], axis=1)
    angle = np.arctan2(across, directions[:, 2])
    return np.asarray((angle < _widest(parameters[4:])) & ((across > 0) | (directions[:, 2] > 0)))


def _widest(coefficients: Array) -> float:
    """Return the angle at which the radius of the model by angles turns back, above 180 degrees if nowhere [rad]."""
    slope = np.append(coefficients[::-1] * [9.0, 7.0, 5.0, 3.0], 1.0)  # of the radius, by powers of the squared angle
    roots = np.roots(slope)
    turns = roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real > 0)]
    return float(np.sqrt(turns.min(initial=16.0)))


def project(model: str, parameters: Array, directions: Array) -> Array:
    """Return the places (n, 2) of directions (n, 3) in the picture [pixels from its corner].

    Not-a-number for directions that the model does not see: behind the camera (z <= 0), or for the model by angles,
    which sees beyond 90 degrees, past the angle at which its radius turns back.

    Parameters
    ----------
    model : str
        One of `COEFFICIENTS`.
    parameters : array
        fx, fy, cx, cy, and the coefficients.
    """
    with np.errstate(all="ignore"):
        places = placed(model, parameters, normal_points(model, directions))
    places[~_sees(model, parameters, directions)] = np.nan
    return places


def placed(model: str, parameters: Array, points: Array) -> Array:
    """Return the places (n, 2) in the picture of points of `normal_points` (n, 2) [pixels from its corner]."""
    return np.asarray(distorted(model, parameters[4:], points) * parameters[:2] + parameters[2:4])


def distorted(model: str, coefficients: Array, points: Array) -> Array:
    """Return points of `normal_points` (n, 2) as the coefficients bend them."""
    if model == "pinhole":
        return points
    square = np.sum(points * points, axis=1)
    if model == BY_ANGLE:
        k1, k2, k3, k4 = coefficients
        return np.asarray(points * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))[:, None])
    k1, k2, p1, p2, k3 = coefficients[:5]
    x, y = points.T
    scale = 1 + square * (k1 + square * (k2 + square * k3))
    if len(coefficients) > 5:
        scale = scale / _denominator(coefficients, square)
    bent = [
        x * scale + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        y * scale + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
    ]
    if len(coefficients) > 8:
        s1, s2, s3, s4 = coefficients[8:12]
        bent[0] = bent[0] + square * (s1 + square * s2)
        bent[1] = bent[1] + square * (s3 + square * s4)
    return np.stack(bent, axis=1)


def slopes(model: str, parameters: Array, points: Array) -> Array:
    """Return the derivatives (n, 2, parameters) of places in the picture, of points of `normal_points` (n, 2)."""
    focal, coefficients = parameters[:2], parameters[4:]
    square = np.sum(points * points, axis=1)
    jacobian = np.zeros((len(points), 2, len(parameters)))
    jacobian[:, 0, 0], jacobian[:, 1, 1] = distorted(model, coefficients, points).T
    jacobian[:, 0, 2] = jacobian[:, 1, 3] = 1.0
    by = jacobian[:, :, 4:]
    powers = np.multiply.accumulate(np.repeat(square[:, None], 4, axis=1), axis=1)
    if model == BY_ANGLE:
        by[:] = points[:, :, None] * powers[:, None]
    elif model != "pinhole":
        k1, k2, _, _, k3 = coefficients[:5]
        x, y = points.T
        along = points
        if len(coefficients) > 5:
            below = _denominator(coefficients, square)
            along = points / below[:, None]
            ratio = (1 + square * (k1 + square * (k2 + square * k3))) / below
            by[:, :, 5:8] = -(along * ratio[:, None])[:, :, None] * powers[:, None, :3]
        by[:, :, :2], by[:, :, 4] = along[:, :, None] * powers[:, None, :2], along * powers[:, 2:3]
        by[:, 0, 2], by[:, 1, 2] = 2 * x * y, square + 2 * y * y
        by[:, 0, 3], by[:, 1, 3] = square + 2 * x * x, 2 * x * y
        if len(coefficients) > 8:
            by[:, 0, 8:10] = by[:, 1, 10:12] = powers[:, :2]
    by *= focal[:, None]
    return jacobian


def _denominator(coefficients: Array, square: Array) -> Array:
    """The denominator of the rational model, at squared distances from the axis."""
    k4, k5, k6 = coefficients[5:8]
    return np.asarray(1 + square * (k4 + square * (k5 + square * k6)))


#
# Camera models fitted to the chief rays of a lens, and by how much each errs.
#
# The fit makes the sum of squared errors in the picture least (Levenberg 1944, Marquardt 1963). Its residual is
# measured at more places than those of the fit, to the very corners and to the edge of the light.

Mask = NDArray[np.bool_]

FITTED = (25, 19)  # places across and down that the fit goes by, from edge to edge
CHECKED = (37, 29)  # places across and down that the residual is measured at, from edge to edge; 1 more than 4 n
# Times as fine along edges and diagonals, where models err fastest, and between places with and without light.
_FINER = 8
_LEAST_PLACES = 40  # with light, below which nothing can be fitted
_ROUNDS = 120
_DAMPING = 1e-3
_NEAR = 1e-9  # the same for a start that leaves little
_SMALL = 1e-13  # share of the error by which a step has to improve it
_TOO_HIGH = 1e12  # damping at which no step helps any more


@dataclass(frozen=True)
class Calibration:
    """A camera model that stands for a lens.

    Attributes
    ----------
    model : str
        One of `COEFFICIENTS`.
    parameters : array
        fx, fy, cx, cy [pixels; 0.5 is the centre of the first pixel], and the coefficients in the order of OpenCV.
    max_px, rms_px : float
        Largest and root mean square error over the places of the picture that have light [pixels].
    errors : (rows, columns, 2) array
        Model less lens [pixels], at places spread evenly from edge to edge; not-a-number where it is dark.
    lit_share : float
        Share of the picture that has light.
    """

    model: str
    parameters: Array
    max_px: float
    rms_px: float
    errors: Array
    lit_share: float

    @property
    def named(self) -> dict[str, float]:
        """The parameters by their names."""
        names = (*_INTRINSICS, *COEFFICIENTS[self.model])
        return dict(zip(names, self.parameters.tolist(), strict=True))

    @property
    def coefficients(self) -> list[float]:
        """The coefficients in the order of OpenCV."""
        coefficients: list[float] = self.parameters[4:].tolist()
        return coefficients

    def project(self, directions: Array) -> Array:
        """Return the places (n, 2) of directions (n, 3) in the picture: x right, y down, z ahead [pixels].

        Not-a-number for what the model does not see: z <= 0, behind the camera. ``kannala_brandt`` goes by the angle
        from the axis and sees beyond 90 degrees, up to the angle at which its radius no longer grows. What is seen
        may lie outside of the picture.
        """
        return project(self.model, self.parameters, np.atleast_2d(np.asarray(directions, np.float64)))


@dataclass(frozen=True)
class _Samples:
    """Places of a picture and their directions in the scene, where it has light.

    Attributes
    ----------
    places, directions : (n, 2), (n, 3) arrays
    weights : (n,) array
        How many places of the picture each stands for.
    middle : (2,) array or None
        Of a picture of which a quarter stands for all.
    """

    places: Array
    directions: Array
    weights: Array
    middle: Array | None = None


def calibrate(view: View, model: str) -> Calibration:
    """Return a camera model fitted to a view.

    Raises
    ------
    InputError
        When the picture has too little light to fit anything to, or shows more than the model has places for.
    """
    if model not in COEFFICIENTS:
        raise InputError(f"model: unknown camera model (got {model}; allowed {', '.join(COEFFICIENTS)})")
    seen, checked, evenly_lit, lit_share = _samples(view)
    count = int(seen.weights.sum())
    if count < _LEAST_PLACES:
        raise InputError(
            f"{view.name}: the picture shows nothing to fit a camera model to: light reaches {count} of"
            f" {FITTED[0] * FITTED[1]} places (allowed: a film inside the image circle)"
        )
    ahead = np.concatenate([seen.directions, checked.directions])[:, 2]
    if model != BY_ANGLE and not (ahead > _LEAST_AHEAD).all():
        widest = np.degrees(np.arccos(seen.directions[:, 2].min()))
        raise InputError(
            f"{view.name}: {model} has no place for a direction {widest:.1f} degrees from the axis"
            f" (allowed: {BY_ANGLE}, or a film with less field)"
        )
    parameters = _fitted(model, seen)
    off = placed(model, parameters, normal_points(model, checked.directions)) - checked.places
    errors = np.full((*evenly_lit.shape, 2), np.nan)
    errors[evenly_lit] = off[: np.count_nonzero(evenly_lit)]
    if seen.middle is not None:
        for axis, number in enumerate(CHECKED):
            errors = _unfolded(errors, number, axis)
    squares = off[:, 0] ** 2 + off[:, 1] ** 2
    max_px, rms_px = math.sqrt(squares.max()), math.sqrt(float(checked.weights @ squares / checked.weights.sum()))
    return Calibration(model, parameters, max_px, rms_px, errors, lit_share)


def _unfolded(errors: Array, count: int, axis: int) -> Array:
    """Return the errors of some columns (axis 0) or rows, given up to the one in the middle, by their mirror image."""
    first = errors[:, : count // 2] if axis == 0 else errors[: count // 2]
    other = np.flip(first, axis=1 - axis) * np.where(np.arange(2) == axis, -1.0, 1.0)
    return np.concatenate([errors, other], axis=1 - axis)


def calibrate_best(view: View, models: Sequence[str], allowed_px: float) -> Calibration:
    """Return the first model that errs by at most some pixels, or the best of those that fit at all."""
    fits: list[Calibration] = []
    refused: InputError | None = None
    for model in models:
        try:
            fits.append(calibrate(view, model))
        except InputError as problem:
            refused = problem
            continue
        if fits[-1].max_px <= allowed_px:
            return fits[-1]
    if not fits:
        assert refused is not None
        raise refused
    return min(fits, key=lambda fit: fit.max_px)


@lru_cache(maxsize=8)
def _samples(view: View) -> tuple[_Samples, _Samples, Mask, float]:
    """Find the places that a fit goes by, and those that its residual is measured at.

    Returns
    -------
    seen, checked : _Samples
        Those of the residual are some spread evenly; then some along edges and diagonals, and where some of four
        neighbours have light and others none.
    evenly_lit : (rows, columns) array
        Which of the places have light that are spread evenly over a picture from edge to edge, or over its upper left
        quarter to the middle.
    lit_share : float
        Of the picture.
    """
    places, weights, even, lines = _places(view.size, mirrored=view.is_mirrored)
    directions, lit = view.directions(np.concatenate([places, even.reshape(-1, 2), lines]))
    n, m, shape = len(places), len(places) + even.shape[0] * even.shape[1], even.shape[:2]
    middle = np.array(view.size) / 2 if view.is_mirrored else None
    seen = _Samples(places[lit[:n]], directions[:n][lit[:n]], weights[lit[:n]], middle)
    lit_evenly = lit[n:m].reshape(shape)
    bright = lit[n:]
    checked = np.concatenate([even.reshape(-1, 2), lines])[bright]
    away = directions[n:][bright]
    of_lines = np.zeros(np.count_nonzero(lit[m:]))
    if lit_evenly.all():
        weights = np.outer(_simpson(shape[0]), _simpson(shape[1])).ravel()
        return seen, _Samples(checked, away, np.append(weights, of_lines)), lit_evenly, 1.0
    corners = np.stack([lit_evenly[:-1, :-1], lit_evenly[:-1, 1:], lit_evenly[1:, :-1], lit_evenly[1:, 1:]])
    whole = corners.all(axis=0)
    each = np.pad(whole.astype(np.float64), 1) / 4
    weights = (each[:-1, :-1] + each[:-1, 1:] + each[1:, :-1] + each[1:, 1:])[lit_evenly]
    within = (np.stack(np.meshgrid(*[np.arange(_FINER)] * 2), axis=-1).reshape(-1, 2) + 0.5) / _FINER
    mixed = np.argwhere(corners.any(axis=0) & ~whole)[:, None, ::-1]
    edge = (even[0, 0] + (mixed + within) * (even[1, 1] - even[0, 0])).reshape(-1, 2)
    there, shines = view.directions(edge)
    checked, away = np.concatenate([checked, edge[shines]]), np.concatenate([away, there[shines]])
    weights = np.concatenate([weights, of_lines, np.full(np.count_nonzero(shines), 1.0 / _FINER**2)])
    return seen, _Samples(checked, away, weights), lit_evenly, float(weights.sum()) / whole.size


def _simpson(count: int) -> Array:
    """Return the weights of Simpson's rule."""
    return np.array([1.0, *[4.0, 2.0] * ((count - 3) // 2), 4.0, 1.0])


@lru_cache(maxsize=8)
def _places(size: tuple[int, int], *, mirrored: bool) -> tuple[Array, Array, Array, Array]:
    """Return places (n, 2) of the fit and their weights, and those of the residual: spread evenly (rows, columns, 2),
    and along edges and diagonals (n, 2).
    """
    x, y, at_x, at_y = (
        np.linspace(0.0, side, n) for counts in (FITTED, CHECKED) for side, n in zip(size, counts, strict=True)
    )
    if mirrored:
        x, y, at_x, at_y = (values[: (len(values) + 1) // 2] for values in (x, y, at_x, at_y))
    places, even = (np.stack(np.meshgrid(*axes), axis=-1) for axes in ((x, y), (at_x, at_y)))
    weights = (
        np.prod(np.where(places < np.array(size) / 2, 2.0, 1.0), axis=-1) if mirrored else np.ones(places.shape[:2])
    )
    steps = np.linspace(0.0, 1.0, _FINER * max(CHECKED) + 1)
    zero = np.zeros_like(steps)
    rest = () if mirrored else ((steps, zero + 1.0), (zero + 1.0, steps), (steps, 1.0 - steps))
    lines = np.concatenate([np.stack(pair, axis=1) for pair in ((steps, zero), (zero, steps), (steps, steps), *rest)])
    return places.reshape(-1, 2), weights.ravel(), even, lines * (at_x[-1], at_y[-1])


def _fitted(model: str, seen: _Samples) -> Array:
    """Return the parameters whose sum of squared errors is least."""
    points = normal_points(model, seen.directions)
    start = _pinhole(points, seen)
    if model == "pinhole":
        return start
    names = (*_INTRINSICS, *COEFFICIENTS[model])
    # What does not look the same in a mirror is zero where the picture does.
    free = [k for k, name in enumerate(names) if seen.middle is None or name[0] in "fk"]
    fixed, root = np.concatenate([start, np.zeros(len(names) - 4)]), np.sqrt(seen.weights)[:, None]

    def whole(values: Array) -> Array:
        parameters = fixed.copy()
        parameters[free] = values
        return parameters

    def errors(values: Array) -> Array:
        parameters = whole(values)
        bent = distorted(model, parameters[4:], points)
        return np.asarray((bent * parameters[:2] + parameters[2:4] - seen.places) * root).ravel()

    def derivatives(values: Array) -> Array:
        return (slopes(model, whole(values), points)[..., free] * root[..., None]).reshape(2 * len(points), -1)

    count = len(COEFFICIENTS[model])
    if count in (4, 5):
        return whole(_least_squares(errors, derivatives, _radial_start(model, points, seen)[free], _NEAR))
    simpler = _fitted("brown_conrady" if count == 8 else "rational", seen)
    starts = [np.concatenate([simpler, np.zeros(4 + count - len(simpler))])]
    if count == 8:
        starts.append(_rational_start(simpler, points, seen.places))
    square = np.sum(points * points, axis=1)
    solutions = [whole(_least_squares(errors, derivatives, begin[free])) for begin in starts]
    good = [one for one in solutions if _denominator(one[4:], np.linspace(0.0, 1.1 * square.max(), 200)).min() > 0]
    return min(good or [starts[0]], key=lambda one: float(np.sum(errors(one[free]) ** 2)))


def _pinhole(points: Array, seen: _Samples) -> Array:
    """Return fx, fy, cx, cy by a linear fit."""
    weights, places, middle = seen.weights[:, None], seen.places, seen.middle
    none = np.zeros(2)
    centre, mean = (none, middle) if middle is not None else (points.mean(axis=0), places.mean(axis=0))
    across = (points - centre) * weights
    focal = np.sum(across * (places - mean), axis=0) / np.sum(across * (points - centre), axis=0)
    return np.concatenate([focal, mean - focal * centre])


def _radial_start(model: str, points: Array, seen: _Samples) -> Array:
    """Return parameters by a linear fit: of places x that are cx and x times a polynomial of the squared distance."""
    square = np.sum(points * points, axis=1)
    reach, count = square.max(), len(COEFFICIENTS[model]) - 2 * (model != BY_ANGLE)
    powers = np.ones((len(points), count + 1))
    powers[:, 1:] = (square / reach)[:, None]
    np.multiply.accumulate(powers, axis=1, out=powers)
    middle, axes = seen.middle, []
    for k in (0, 1):
        rows, offset = points[:, k, None] * powers, 0.0 if middle is None else middle[k]
        if middle is None:
            rows = np.column_stack([rows, np.ones(len(points))])
        weighted = rows.T * seen.weights
        solution = np.linalg.solve(weighted @ rows, weighted @ (seen.places[:, k] - offset))
        axes.append(solution if middle is None else [*solution, offset])
    (fx, *_, cx), (fy, *_, cy) = axes
    bent = np.mean([np.array(values[1:-1]) / values[0] for values in axes], axis=0) / reach ** np.arange(1, count + 1)
    if model == BY_ANGLE:
        return np.array([fx, fy, cx, cy, *bent])
    k1, k2, k3 = bent
    return np.array([fx, fy, cx, cy, k1, k2, 0.0, 0.0, k3])


def _rational_start(simpler: Array, points: Array, places: Array) -> Array:
    """Return parameters of the rational model by a linear fit: numerator less distortion times denominator is zero."""
    square = np.sum(points * points, axis=1)
    scale = np.sum((places - simpler[2:4]) / simpler[:2] * points, axis=1) / np.maximum(square, 1e-12)
    reach = square.max()
    powers = (square / reach)[:, None] ** [1.0, 2.0, 3.0]
    rows = np.concatenate([powers, -scale[:, None] * powers], axis=1)
    solution = np.linalg.lstsq(rows, scale - 1.0, rcond=1e-10)[0] / np.tile(reach ** np.array([1.0, 2.0, 3.0]), 2)
    k1, k2, k3, k4, k5, k6 = solution
    return np.array([*simpler[:4], k1, k2, 0.0, 0.0, k3, k4, k5, k6])


def _least_squares(
    errors: Callable[[Array], Array], derivatives: Callable[[Array], Array], start: Array, damping: float = _DAMPING
) -> Array:
    """Return the parameters at which the sum of squared errors is least, from a start that is not far."""
    parameters, error = start, errors(start)
    cost = float(error @ error)
    for _ in range(_ROUNDS):
        rows = derivatives(parameters)
        normal, gradient = rows.T @ rows, rows.T @ error
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        while damping < _TOO_HIGH:
            scaled = normal / np.outer(scale, scale) + damping * np.eye(len(scale))
            step = np.linalg.solve(scaled, gradient / scale) / scale
            if gradient @ step <= _SMALL * cost:  # what the step can gain; larger damping gains less
                return parameters
            trial = parameters - step
            with np.errstate(all="ignore"):
                new = errors(trial)
                improved = float(new @ new)
            if improved < cost:
                break
            damping *= 10
        else:
            break
        done = cost - improved <= _SMALL * cost
        parameters, error, cost, damping = trial, new, improved, max(damping / 10, 1e-15)
        if done:
            break
    return parameters


# Plots of how a camera model errs over the picture, and of maps.

WIDTH = 8.0  # of the plot [inches]
_EVERY = 3  # cells between arrows


@styled()
def residual_chart(view: View, calibration: Calibration) -> Figure:
    """Return the errors of a camera model over the picture: their size as a map, and arrows along them."""
    columns, rows = view.size
    figure = new_figure(
        f"{view.name}: {calibration.model} against chief rays, rms {calibration.rms_px:.2g} px,"
        f" at most {calibration.max_px:.2g} px",
        (WIDTH, 1.0 + (WIDTH - 1.4) * rows / columns),
    )
    axes = figure.add_subplot()
    length = np.linalg.norm(calibration.errors, axis=-1)
    down, across = length.shape
    x, y = np.meshgrid(np.linspace(0, columns, across), np.linspace(0, rows, down))
    left, top = x[0, 1] / 2, y[1, 0] / 2  # half of what a place at the edge stands for lies beside the picture
    around = (-left, columns + left, rows + top, -top)
    shown = axes.imshow(length, cmap="viridis", extent=around, vmin=0.0, aspect="equal")
    axes.set(xlabel="column [px]", ylabel="row [px]", xlim=(0, columns), ylim=(rows, 0))
    axes.grid(visible=False)
    part = np.s_[_EVERY // 2 :: _EVERY, _EVERY // 2 :: _EVERY]
    if calibration.max_px > 0:
        errors = calibration.errors[part] / calibration.max_px
        axes.quiver(
            x[part], y[part], errors[..., 0], -errors[..., 1], color="white", scale=18, width=0.003, pivot="middle"
        )
    figure.colorbar(shown, ax=axes, label="error [px]", shrink=0.85)
    return figure
