"""Accuracy that is added never makes the measured bias grow: through lenses, along cameras and depths of paths.

Biases are measured against the lens in float64, in pictures that share their seeds: what two biases differ by has an
interval of its own.
"""

from itertools import pairwise

import numpy as np
import pytest

from rptcam_cl.scene.load import load_scene
from rptcam_cl.studies.tradeoff_errors import (
    draws,
    error_over_pairs,
    every_seed_once,
    interval,
    over_pairs,
    pair_errors,
    spread_about,
)
from rptcam_cl.studies.tradeoff_runs import ladder, prepare, render_by_turns
from tests.device.probes import open_session

pytestmark = pytest.mark.slow

BEST = "lens: float64"
CAMERAS = ("pinhole", "thin lens", "thick lens", "full", BEST)
DEPTHS = ("depth 2", "depth 4", "full", BEST)
LARGE = 1e-4  # relMSE: a step that is meant to be seen
NOTHING = 1e-8  # relMSE, of a ten-thousandth: where a few paths that rounding sends elsewhere are all that differs


def board(even, odd, scale, **where):
    look = {"kind": "matte", "reflectance": {"kind": "checker", "even": even, "odd": odd, "scale": [scale, scale]}}
    return {"shape": "rectangle", "material": look, **where}


def room(*, near, far, half, scale):
    """Checkered boards at two distances under a lamp, in a checkered corner."""
    return [
        board(0.8, 0.2, scale, corner=[-half, -half, -far], edge_u=[2 * half, 0, 0], edge_v=[0, 2 * half, 0]),
        board([0.8, 0.4, 0.2], 0.3, scale, corner=[-half, -half / 3, -far], edge_u=[2 * half, 0, 0],
              edge_v=[0, 0, 0.9 * far]),
        board([0.2, 0.5, 0.8], 0.5, scale, corner=[-half / 3, -half / 3, -near], edge_u=[half / 3, 0, 0],
              edge_v=[0, half / 2, 0]),
        {"shape": "rectangle", "corner": [-half, half, -far], "edge_u": [2 * half, 0, 0], "edge_v": [0, 0, far],
         "material": {"kind": "emissive", "radiance": 2.0}},
    ]  # fmt: skip


SCENES = {
    "telephoto": ({"lens": "telephoto-250mm", "f_number": 5.6}, 5.0, {"near": 5, "far": 8, "half": 0.6, "scale": 12}),
    "double Gauss": ({"lens": "dgauss-50mm", "f_number": 2.8}, 1.0, {"near": 1, "far": 3, "half": 1.2, "scale": 10}),
    "portrait": ({"lens": "biotar-58mm", "f_number": 2}, 1.5, {"near": 1.5, "far": 4, "half": 1.2, "scale": 8}),
    "wide": ({"lens": "wide-22mm", "f_number": 8}, 1.0, {"near": 0.5, "far": 2, "half": 2, "scale": 8}),
}
# What the wide lens takes from the light off its axis neither knows, which errs by more than all that blur does.
UNKNOWN_TO_BOTH = {"wide": ("pinhole",)}


def scene_through(name):
    camera, distance, size = SCENES[name]
    return load_scene({
        "film": {"resolution": [96, 64], "width_mm": 36},
        "camera": {"kind": "realistic", **camera, "eye": [0, 0, 0], "target": [0, 0, -1],
                   "focus": {"distance_m": distance}},
        "spectrum": {"mode": "rgb"},
        "render": {"max_depth": 6},
        "objects": room(**size),
    })  # fmt: skip


def biases(session, scene, budget=20.0):
    """What pairs of seeds tell of the bias of each configuration against the lens in float64, by name."""
    steps = {step.name: step for step in ladder(scene)[0]}
    names = [BEST, *dict.fromkeys(name for name in CAMERAS + DEPTHS if name != BEST)]
    ready, _ = prepare([steps[name] for name in names], session, lambda name, done: None)
    pictures = render_by_turns(ready, budget, 1, lambda words, share: None)
    errors = pair_errors(pictures.pixels, pictures.samples, pictures.tiles, pictures.long)
    assert [each.configuration.name for each in ready] == names
    return {name: error.bias for name, error in zip(names, errors, strict=True)}


def growth(matrices, worse, better):
    """By how much relMSE of the bias grows from one to the other, with its interval."""
    matrix = matrices[worse] - matrices[better]
    seeds = len(matrix)
    found = over_pairs(matrix, np.concatenate([every_seed_once(seeds), draws(seeds, np.random.default_rng(7))]))
    return interval(found[0], spread_about(found[0], found[1:], error_over_pairs(matrix)), seeds)


def assert_monotone(matrices, names):
    for worse, better in pairwise(names):
        assert growth(matrices, worse, better).high >= -NOTHING, (worse, better)
    assert growth(matrices, names[0], names[-1]).low > LARGE


@pytest.fixture(scope="module", params=SCENES)
def measured(request):
    return request.param, biases(open_session(), scene_through(request.param))


def chains(name):
    return [tuple(rung for rung in CAMERAS if rung not in UNKNOWN_TO_BOTH.get(name, ())), DEPTHS]


def test_bias_never_grows_when_accuracy_is_added(measured):
    name, matrices = measured
    for names in chains(name):
        assert_monotone(matrices, names)


def test_lens_in_float32_is_not_told_from_float64(measured):
    _, matrices = measured
    assert growth(matrices, "full", BEST).high < NOTHING
    assert growth(matrices, "depth 4", "full").low > NOTHING  # which a picture hardly shows, and the measurement does


def test_rungs_that_are_swapped_are_found(measured):
    """The control: any two neighbours but the two precisions, which come to the same."""
    name, matrices = measured
    for names in chains(name):
        for one, other in pairwise(names[:-1]):
            with pytest.raises(AssertionError):
                assert_monotone(matrices | {one: matrices[other], other: matrices[one]}, names)
