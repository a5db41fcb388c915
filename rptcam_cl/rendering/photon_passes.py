"""Which photons belong to which samples: the passes of the photon map, their sizes and radii.

Every sample of the film sees the photons of one pass, which is a function of the sample's number alone: so are its
radius and its photons. The picture then depends on neither waves nor tiles, and parts of its samples can be merged. The
mean over the passes converges to the truth as their radius shrinks (Hachisuka et al. 2008; independent passes: Knaus
and Zwicker 2011).
"""

from __future__ import annotations

from collections.abc import Iterator

from rptcam_cl.core.dataclass import dataclass

SHORT_PASSES = (0, 1, 2, 4, 8)  # first samples, so that few samples have a picture as well
PASS_SAMPLES = 16  # samples of every later pass
PHOTONS_PER_SAMPLE = 0.25  # and pixel of the whole film
LEAST_PHOTONS, MOST_PHOTONS = 1 << 12, 1 << 18  # of a pass; a lattice is good for so many
# Cells repeat after so many for a photon, so that few of those that a vertex looks into hold photons of elsewhere.
CELL_BITS_MORE = 3
MOST_CELLS = MOST_PHOTONS << CELL_BITS_MORE
PHOTON_BYTES = 2 * 4 * 8 * MOST_PHOTONS + 4 * (MOST_CELLS + 1)  # as traced and as sorted, and the cells
# The radius shrinks with samples to this power: with the bias of a disk, radius², and the variance,
# 1 / (samples radius²), their mean square falls fastest so, with samples^(-2/3).
SHRINKING = -1 / 6


@dataclass(frozen=True)
class PhotonPass:
    """One pass.

    Attributes
    ----------
    number : int
    first, samples : int
        The film's samples that see it.
    """

    number: int
    first: int
    samples: int

    def photons(self, pixels: int) -> int:
        """Return how many photons it has for a film of so many pixels, a power of two."""
        wanted = self.samples * pixels * PHOTONS_PER_SAMPLE
        return min(max(1 << max(round(wanted), 1).bit_length() - 1, LEAST_PHOTONS), MOST_PHOTONS)

    @property
    def shrinkage(self) -> float:
        """What its radius is of that of the first pass."""
        return float((self.first + 0.5 * (self.samples + 1)) ** SHRINKING)


def pass_of(sample: int) -> PhotonPass:
    """Return the pass that a sample sees."""
    if sample >= PASS_SAMPLES:
        number, first = divmod(sample, PASS_SAMPLES)[0], sample - sample % PASS_SAMPLES
        return PhotonPass(number + len(SHORT_PASSES) - 1, first, PASS_SAMPLES)
    ends = (*SHORT_PASSES[1:], PASS_SAMPLES)
    number = sum(sample >= end for end in ends)
    return PhotonPass(number, SHORT_PASSES[number], ends[number] - SHORT_PASSES[number])


def within_passes(first: int, samples: int, most: int) -> Iterator[tuple[int, int]]:
    """Yield first sample and number of the pieces of a range of samples that see one pass each, at most so long."""
    end = first + samples
    while first < end:
        seen = pass_of(first)
        count = min(most, end - first, seen.first + seen.samples - first)
        yield first, count
        first += count
