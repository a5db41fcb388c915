"""What a comparison of configurations found, as data."""

from __future__ import annotations

from dataclasses import asdict, field
from typing import Any

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.core.errors import InputError
from rptcam_cl.tradeoff.measurement import Measurement
from rptcam_cl.tradeoff.statistics import CONFIDENCE
from rptcam_cl.tradeoff.tiers.errors import FIELDS, TierError


@dataclass(frozen=True)
class Advice:
    """Which configuration suits a request.

    Attributes
    ----------
    wish : str
        ``time`` or ``error``.
    amount : float
        Time [s] or relative error (root of relMSE).
    chosen : str or None
        Name of the configuration; None where none reaches the error, or gives every pixel a sample in the time.
    seconds, error : float
        Its time [s] and its error, with the bias at the upper end of its interval.
    samples : int
        Samples per pixel for that; 0 where none reaches the error.
    least_error, most_error : float
        Interval of the error after these samples, from the ends of those of noise and bias.
    full_seconds, full_error : float
        The same of the most accurate configuration.
    perhaps : str or None
        Another one that is clearly better if its bias is what was measured, and not the upper end of its interval.
    """

    wish: str
    amount: float
    chosen: str | None
    seconds: float
    error: float
    samples: int
    least_error: float
    most_error: float
    full_seconds: float
    full_error: float
    perhaps: str | None


@dataclass(frozen=True)
class Comparison:
    """What a comparison of configurations found, as data.

    Attributes
    ----------
    scene, device : str
    resolution : (width, height)
    tiles : (rendered, all)
        Number of tiles of 8 x 8 pixels.
    grid : (rows, columns)
        Rows and columns of the rendered tiles.
    samples : (int, int, int)
        Samples per pixel of the three sets of pictures; the last has some of the tiles only.
    long_tiles : int
        How many tiles the last set has.
    seeds : int
        Number of independent pictures in each of the first two sets.
    seconds : float
        Time of the whole measurement [s].
    by_cpu : bool
        Whether times are CPU times divided by the number of cores.
    measurements : tuple of Measurement
        The most accurate configuration first.
    cameras : tuple of TierError
        Errors of cheaper camera models over the field, traced in float64.
    allowed : str
        Camera model that `camera.accuracy: auto` takes; empty without a lens of surfaces.
    lens_colour_px : float or None
        Greatest displacement of light of other wavelengths by the lens [pixels].
    diffraction : dict or None
        What `camera.diffraction: auto` decides, with the Airy radius [pixels]; none of the pictures has it.
    ghosts : float or None
        Share of a lamp's light on the axis that `camera.ghosts` adds within the frame; none of the pictures has it.
        None where surfaces reflect nothing.
    budget : float
        How long the measurement was to take [s]; 0 where that is not known.
    truncation : dict
        Bound on the light of paths beyond the scene's depth.
    advice : tuple of Advice
    skipped : dict
        Configurations that could not be rendered, and why.
    """

    scene: str
    device: str
    resolution: tuple[int, int]
    tiles: tuple[int, int]
    grid: tuple[int, int]
    samples: tuple[int, int, int]
    long_tiles: int
    seeds: int
    seconds: float
    by_cpu: bool
    measurements: tuple[Measurement, ...]
    cameras: tuple[TierError, ...]
    allowed: str
    lens_colour_px: float | None
    truncation: dict[str, Any]
    advice: tuple[Advice, ...] = ()
    skipped: dict[str, str] = field(default_factory=dict)
    diffraction: dict[str, Any] | None = None
    ghosts: float | None = None
    budget: float = 0.0

    def named(self, name: str) -> Measurement:
        """Return the measurement of a configuration by its name or by that of another that is the same way."""
        for found in self.measurements:
            if name in (found.name, *found.same_as):
                return found
        names = [known for found in self.measurements for known in (found.name, *found.same_as)]
        raise InputError(f"{name}: was not compared (there are: {', '.join(names)})")

    def camera_of(self, found: Measurement) -> TierError | None:
        """Return the errors of a configuration's camera model, where it is not the traced lens."""
        return next((each for each in self.cameras if each.tier == found.tier), None)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain values; what is infinite becomes null in JSON, which means never (or always)."""
        values = asdict(self)
        for found in values["measurements"]:
            found["seconds_to"] = {f"{target:g}": value for target, value in found["seconds_to"].items()}
        return values | {"fields": list(FIELDS), "confidence": CONFIDENCE}
