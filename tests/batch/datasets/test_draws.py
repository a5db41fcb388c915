"""What distributions draw: their moments against closed forms, their ends, and that a frame stands for itself."""

import math
from typing import Any

import numpy as np
import pytest

from rptcam_cl.batch.dataset import DistributionError, distribution, seed_of_frame, values_of_frame

FRAMES = 4000


def drawn(described: Any, frames: int = FRAMES) -> np.ndarray:
    law = {"key": distribution(described)}
    return np.array([values_of_frame(law, 3, frame)["key"] for frame in range(frames)])


@pytest.mark.parametrize(
    "described, mean, sd",
    [
        ({"uniform": [2, 6]}, 4.0, 4 / math.sqrt(12)),
        ({"log_uniform": [1, math.e]}, math.e - 1, math.sqrt((math.e**2 - 1) / 2 - (math.e - 1) ** 2)),
        ({"integer": [1, 6]}, 3.5, math.sqrt(35 / 12)),
        ({"normal": {"mean": 5, "sd": 2}}, 5.0, 2.0),
        # The half of a normal distribution: its mean is sd sqrt(2 / pi), its variance sd² (1 - 2 / pi).
        ({"normal": {"mean": 0, "sd": 1, "min": 0}}, math.sqrt(2 / math.pi), math.sqrt(1 - 2 / math.pi)),
        ({"choice": [0, 1], "weights": [1, 3]}, 0.75, math.sqrt(3) / 4),
    ],
)
def test_mean_and_spread_are_those_of_the_distribution(described: Any, mean: float, sd: float) -> None:
    values = drawn(described)
    assert abs(values.mean() - mean) < 4 * sd / math.sqrt(FRAMES)
    assert values.std() == pytest.approx(sd, rel=0.05)


def test_values_stay_within_their_ends() -> None:
    assert set(drawn({"integer": [-1, 1]}).tolist()) == {-1, 0, 1}
    values = drawn({"normal": {"mean": [0, 10], "sd": [1, 2], "min": [-0.5, 9], "max": [1, 40]}}, 500)
    assert values.min(axis=0).tolist() >= [-0.5, 9] and values[:, 0].max() <= 1


def test_numbers_of_a_list_are_drawn_each_by_itself() -> None:
    values = drawn({"uniform": [[0, 0], [1, 1]]})
    assert abs(np.corrcoef(values.T)[0, 1]) < 4 / math.sqrt(FRAMES)


def test_tuples_are_lists() -> None:
    for described in ({"uniform": ((0, 0, 1), (1, 2, 3))}, {"uniform": [(0, 0, 1), [1, 2, 3]]}):
        found = distribution(described)
        assert found == distribution({"uniform": [[0, 0, 1], [1, 2, 3]]}) and list(found.ends) == [[0, 0, 1], [1, 2, 3]]
    with pytest.raises(DistributionError, match="different lengths"):
        distribution({"uniform": (0, (1,))})


def test_grids_give_all_combinations_the_last_changing_first() -> None:
    vary = {"a": distribution({"grid": [1, 2]}), "b": distribution({"grid": ["x", "y", "z"]})}
    found = ["{a}{b}".format(**values_of_frame(vary, 0, frame)) for frame in range(7)]
    assert found == ["1x", "1y", "1z", "2x", "2y", "2z", "1x"]


def test_a_key_draws_the_same_beside_others_and_another_in_another_frame_and_seed() -> None:
    one = {"a": distribution({"uniform": [0, 1]})}
    two = {"b": distribution({"uniform": [0, 1]}), **one}
    first = values_of_frame(one, 5, 517)["a"]
    assert values_of_frame(two, 5, 517) == {"a": first, "b": pytest.approx(values_of_frame(two, 5, 517)["b"])}
    others = [values_of_frame(one, 6, 517)["a"], values_of_frame(one, 5, 518)["a"], values_of_frame(two, 5, 517)["b"]]
    assert first not in others and len(set(others)) == 3
    assert seed_of_frame(5, 517) not in {seed_of_frame(5, 518), seed_of_frame(6, 517)}


@pytest.mark.parametrize(
    "described, words",
    [
        (4, "is no distribution (got 4)"),
        ({}, "needs exactly one kind"),
        ({"uniform": [0, 1], "grid": [1]}, "needs exactly one kind"),
        ({"uniform": [0, 1], "weights": [1]}, "unknown key weights"),
        ({"uniform": [1, 0]}, "the wrong way round"),
        ({"uniform": [[0, 1], [1]]}, "different lengths"),
        ({"uniform": 3}, "has no two ends"),
        ({"uniform": [0, float("nan")]}, "is no finite number"),
        ({"log_uniform": [0, 1]}, "reaches 0"),
        ({"integer": [0, 1.5]}, "no whole number"),
        ({"choice": []}, "has no list of values"),
        ({"choice": [1, 2], "weights": [1]}, "do not weigh its 2 values"),
        ({"choice": [1, 2], "weights": [0, 0]}, "do not weigh"),
        ({"normal": {"mean": 1}}, "is no normal distribution"),
        ({"normal": {"mean": 1, "sd": 0}}, "must be above 0"),
        ({"normal": {"mean": 0, "sd": 1, "min": 50}}, "leaves nothing between"),
    ],
)
def test_what_is_no_distribution_is_refused(described: Any, words: str) -> None:
    with pytest.raises(DistributionError, match=words.replace("(", r"\(").replace(")", r"\)")):
        distribution(described)
