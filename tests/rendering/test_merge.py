"""Parts of a render that were made apart come to the picture of one run; what does not belong together is refused."""

import contextlib
import copy
import json
import random
import warnings
from pathlib import Path

import numpy as np
import pytest

import rptcam_cl
from rptcam_cl.api.job import RenderJob
from rptcam_cl.api.options import RenderOptions
from rptcam_cl.core.errors import InputError, StateError
from rptcam_cl.rendering import checkpoint
from rptcam_cl.rendering.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from rptcam_cl.rendering.film import FilmLayout
from rptcam_cl.rendering.several import FilmPart
from tests.rendering.test_determinism import LENS
from tests.rendering.test_world import still_life
from tests.support.cases import slow

SIZE, SPP = (50, 37), 12
OPTIONS = {"size": SIZE, "seed": 3, "layers": ["depth", "object_id", "samples", "position"]}


def scene():
    return still_life() | {"camera": LENS, "picture": {"ev": 1}}


@pytest.fixture(scope="module")
def whole():
    return rptcam_cl.render(scene(), spp=SPP, **OPTIONS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three parts by tiles, and two ranges of samples."""
    folder = tmp_path_factory.mktemp("parts")
    for number in (1, 2, 3):
        rptcam_cl.render(scene(), spp=SPP, part=f"{number}/3", checkpoint=folder / f"{number}.rpck", **OPTIONS)
    for first, end in ((0, 5), (5, SPP)):
        rptcam_cl.render(scene(), samples=(first, end), checkpoint=folder / f"from{first}.rpck", **OPTIONS)
    return folder


def parts(folder: Path, *names: object) -> list[Path]:
    return [folder / f"{name}.rpck" for name in names]


@pytest.mark.parametrize("count", [1, 2, 3, 7, 35])
def test_parts_share_all_tiles_evenly(count):
    tiles = [FilmPart(number, count).tiles(35) for number in range(1, count + 1)]
    assert sorted(np.concatenate(tiles)) == list(range(35))
    assert {len(each) for each in tiles} <= {35 // count, -(-35 // count)}


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 1, 2)])
def test_files_of_merged_parts_are_those_of_one_run_to_the_byte(order, whole, folder, tmp_path):
    merged = rptcam_cl.merge(parts(folder, *order))
    for suffix in (".exr", ".png", ".npz"):
        whole.save(tmp_path / f"whole{suffix}")
        merged.save(tmp_path / f"merged{suffix}")
    for suffix in (".exr", ".png"):  # an archive has times in it
        assert (tmp_path / f"merged{suffix}").read_bytes() == (tmp_path / f"whole{suffix}").read_bytes()
    archives = [np.load(tmp_path / f"{name}.npz") for name in ("merged", "whole")]
    assert json.loads(str(archives[0]["metadata"])) == json.loads(str(archives[1]["metadata"]))
    for name in archives[1]:
        np.testing.assert_array_equal(archives[0][name], archives[1][name])
    assert merged.stats["lens"] == whole.stats["lens"]
    assert merged.stats["samples"] == whole.stats["samples"]


@pytest.mark.parametrize("exposure", [slow("relative"), "auto"])
def test_parts_that_jobs_make_one_after_the_other_come_to_the_picture_of_one_run(exposure, whole, tmp_path):
    """As workers of a cluster do; what the first has measured the second takes over."""
    given = scene() | {"exposure": exposure}
    if exposure == "auto":
        whole = rptcam_cl.render(given, spp=SPP, **OPTIONS)
    options = RenderOptions(spp=SPP, **OPTIONS)
    first = RenderJob.prepare_parts(given, options)
    second = RenderJob.prepare_parts(given, options, first.findings)
    assert first.findings == second.findings == {
        "focus": None, "metered_cd_m2": None if exposure == "relative" else whole.metadata["metered_cd_m2"],
    }  # fmt: skip
    for number, job in ((2, first), (1, first), (3, second)):
        content, seconds = job.part(FilmPart(number, 3))
        assert seconds > 0
        (tmp_path / f"{number}.rpck").write_bytes(content)
    merged = rptcam_cl.merge(parts(tmp_path, 1, 2, 3))
    np.testing.assert_array_equal(merged.pixels, whole.pixels)
    for name in whole.layers:
        np.testing.assert_array_equal(merged[name], whole[name])
    assert merged.metadata == json.loads(json.dumps(whole.metadata))
    assert (merged.stats["lens"], merged.stats["samples"]) == (whole.stats["lens"], whole.stats["samples"])


@pytest.mark.parametrize(
    ("render", "message"),
    [({"noise": 0.1}, "a noise target needs the whole film"), ({"layers": ["variance"]}, "the layer variance needs")],
)
def test_scene_that_cannot_be_divided_is_refused(render, message, tmp_path):
    given = scene() | {"render": render}
    with pytest.raises(InputError, match=rf"^part: {message}"):
        rptcam_cl.render(given, size=SIZE, part="1/2", checkpoint=tmp_path / "a.rpck")
    with pytest.raises(InputError, match=rf"^part: {message}"):
        RenderJob.prepare_parts(given, RenderOptions(size=SIZE))
    assert not list(tmp_path.iterdir())


def test_ranges_of_samples_differ_by_the_rounding_of_float32_alone(whole, folder):
    merged = rptcam_cl.merge(parts(folder, "from5", "from0"))
    np.testing.assert_allclose(merged.pixels, whole.pixels, rtol=2.5e-7, atol=1e-30)  # two units in the last place
    assert np.mean(merged.pixels != whole.pixels) < 0.2
    np.testing.assert_array_equal(merged["object_id"], whole["object_id"])
    np.testing.assert_allclose(merged["depth"], whole["depth"], rtol=2.5e-7)
    assert merged.stats["lens"] == whole.stats["lens"]


@pytest.mark.parametrize("spectrum", ["rgb", slow("spectral")])
def test_ranges_of_samples_differ_by_two_units_of_the_largest_channel_also_in_spectral_scenes(spectrum, tmp_path):
    words = {"scene": rptcam_cl.load_scene(scene(), [f"spectrum={spectrum}"]), "size": (24, 16)}
    files = [tmp_path / f"{first}.rpck" for first in (0, 1, 3, 9)]
    for file, samples in zip(files, ((0, 1), (1, 3), (3, 9), (9, 24)), strict=True):
        rptcam_cl.render(samples=samples, checkpoint=file, **words)
    merged, whole = rptcam_cl.merge(files).pixels, rptcam_cl.render(spp=24, **words).pixels
    away = np.abs(merged.astype(np.float64) - whole)
    assert (away <= 2 * np.spacing(np.abs(whole).max(axis=2, keepdims=True))).all()
    assert 0.01 < np.mean(away > 0) < 0.2


@pytest.mark.parametrize("array", ["film", "layers"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_part_with_what_is_no_number_is_named(array, value, folder, tmp_path, recwarn):
    rptcam_cl.merge(parts(folder, 1, 2, 3))
    assert not recwarn.list
    saved = read_checkpoint(folder / "2.rpck")
    planes = saved.arrays[array].copy()
    planes[1, [3, 70]] = value
    bad = tmp_path / "2.rpck"
    write_checkpoint(bad, saved.facts, saved.arrays | {array: planes})
    with pytest.warns(UserWarning, match=rf"{bad}: 2 pixels of its film hold no finite numbers"):
        merged = rptcam_cl.merge([*parts(folder, 1, 3), bad])
    if array == "film":
        assert (~np.isfinite(merged.pixels)).any(axis=2).sum() == 2
    with pytest.warns(UserWarning, match=rf"{bad}: 2 pixels"):
        rptcam_cl.render(scene(), spp=SPP, part="2/3", checkpoint=bad, resume=True, **OPTIONS)


def test_merged_state_goes_on_to_the_bits_of_one_run(folder, tmp_path):
    state = tmp_path / "all.rpck"
    rptcam_cl.merge(parts(folder, 1, 2, 3), checkpoint=state)
    more = rptcam_cl.render(scene(), spp=SPP + 5, checkpoint=state, resume=True, **OPTIONS)
    assert more.stats["resumed_from"] == SPP
    np.testing.assert_array_equal(more.pixels, rptcam_cl.render(scene(), spp=SPP + 5, **OPTIONS).pixels)


def test_part_that_was_interrupted_is_named_and_goes_on(whole, folder, tmp_path):
    again, calls = tmp_path / "2.rpck", iter(range(2))
    options = OPTIONS | {"spp": SPP, "part": "2/3", "checkpoint": again, "wave_size": 1}
    stopped = rptcam_cl.render(scene(), should_stop=lambda: next(calls, None) is None, **options)
    assert 0 < stopped.stats["spp"] < SPP
    files = [*parts(folder, 1, 3), again]
    with pytest.raises(StateError, match=rf"gaps: samples {stopped.stats['spp']}:{SPP} of part 2/3 "):
        rptcam_cl.merge(files)
    with pytest.raises(StateError, match="its part is part 2/3, and this render's part 1/3"):
        rptcam_cl.render(scene(), resume=True, **(options | {"part": "1/3"}))
    rptcam_cl.render(scene(), resume=True, **options)
    np.testing.assert_array_equal(rptcam_cl.merge(files).pixels, whole.pixels)


GAPS = {
    "a part": ((1, 3), "gaps: samples 0:12 of part 2/3"),
    "the first samples": (("from5",), "gaps: samples 0:5 of the whole film"),
    "the last samples": (("from0", 1, 3), "overlaps"),
    "the same twice": ((1, 2, 3, 2), r"2\.rpck \(part 2/3\): overlaps .*2\.rpck \(part 2/3\)"),
    "tiles and samples": (("from0", 1), r"overlaps .* both have the same samples of 11 tiles"),
}


@pytest.mark.parametrize("what", GAPS)
def test_gaps_and_overlaps_are_refused_by_name(what, folder):
    names, message = GAPS[what]
    with pytest.raises(StateError, match=message):
        rptcam_cl.merge(parts(folder, *names))


def changed(path: Path, to: Path, **facts: object) -> Path:
    saved = read_checkpoint(path)
    write_checkpoint(to, saved.facts | facts, saved.arrays)
    return to


OTHERS = {
    "version": ({"version": "0.0.1"}, r"the version is .* there and 0\.0\.1 here"),
    "seed": ({"seed": 4}, "the seed is 3 there and 4 here"),
    "resolution": ({"resolution": [64, 64]}, "the resolution is"),
    "scene": ({"scene": "ab"}, "the scene is another"),
    "lens": (
        {"scene": "ab", "picture": {"metadata": {"lens": "triplet"}, "clamp": None}},
        "the lens is .* there and triplet here",
    ),
    "picture": (
        {"picture": {"metadata": {"picture_hash": "ab"}, "clamp": None}},
        "what follows the film is another",
    ),
    "light": ({"metered_cd_m2": 3.0}, "auto exposure differs .*rptcam settle"),
    "no picture": ({"picture": {}}, "by a version that could not merge"),
    "diffraction": ({"picture": {"metadata": {"diffraction": {"on": True}}}}, "could not merge diffraction"),
    "noise": ({"noise": 0.1}, "a render with a noise target .* cannot be merged"),
    "part": ({"part": [4, 3, 0, None]}, "damaged: part"),
}


@pytest.mark.parametrize("other", OTHERS)
def test_parts_of_another_render_are_refused(other, folder, tmp_path):
    facts, message = OTHERS[other]
    stranger = changed(folder / "2.rpck", tmp_path / "2.rpck", **facts)
    with pytest.raises(StateError, match=message) as refusal:
        rptcam_cl.merge([folder / "1.rpck", stranger])
    assert str(stranger) in str(refusal.value)


@pytest.mark.parametrize("what", ["code", "numpy", "driver", None])
def test_parts_and_states_of_other_code_or_drivers_are_refused_or_named(what, folder, tmp_path):
    [maker] = read_checkpoint(folder / "2.rpck").facts["made_by"]
    made_by = None if what is None else [maker | {what: "another"}]
    stranger = changed(folder / "2.rpck", tmp_path / "2.rpck", made_by=made_by)
    others = parts(folder, 1, 3)
    message = "says nothing of the code" if what is None else f"its {what} is another, and that of "
    with pytest.raises(StateError, match=f"{stranger}: {message}.*--allow-mixed"):
        rptcam_cl.merge([others[0], stranger, others[1]])
    with pytest.raises(StateError, match=message):
        rptcam_cl.render(scene(), spp=SPP, part="2/3", checkpoint=stranger, resume=True, **OPTIONS)
    with pytest.warns(UserWarning, match=message):
        mixed = rptcam_cl.merge([others[0], stranger, others[1]], checkpoint=tmp_path / "all.rpck", allow_mixed=True)
    assert mixed.metadata["made_by"] == maker
    assert [each == maker for each in mixed.metadata["mixed"]] == [True, False]
    go_on = OPTIONS | {"spp": SPP + 1, "checkpoint": tmp_path / "all.rpck", "resume": True}
    with pytest.raises(StateError, match=r"all\.rpck: "):
        rptcam_cl.render(scene(), **go_on)
    with pytest.warns(UserWarning):
        more = rptcam_cl.render(scene(), allow_mixed=True, **go_on)
    assert len(more.metadata["mixed"]) == 2 and more.metadata["made_by"] == maker


def test_file_that_is_no_part_is_not_to_be_removed(tmp_path):
    (tmp_path / "scene.yaml").write_text("film: {}")
    with pytest.raises(StateError, match=r"scene\.yaml: is not a saved render$"):
        rptcam_cl.merge([tmp_path / "scene.yaml"])


ODD = [None, {}, "x", 1.5, -1, True, 10**12, ["x"], [[1, 2], [3]], {"a": 1}]


def every_place(data, path=()):
    """Yield the keys that lead to everything in facts, lists by their first element."""
    found = data.items() if isinstance(data, dict) else enumerate(data[:1]) if isinstance(data, list) else ()
    for key, value in found:
        yield (*path, key)
        yield from every_place(value, (*path, key))


def test_sealed_files_with_anything_in_place_of_a_fact_or_an_array_are_refused_or_merged(folder, tmp_path, monkeypatch):
    """Whoever makes a file seals it, too: odd facts and arrays end in one error that names the file."""
    saved, refused, chances = read_checkpoint(folder / "1.rpck"), 0, random.Random(6)
    monkeypatch.setattr("os.fsync", lambda descriptor: None)  # most of the time of a thousand files

    def merge_with(facts, arrays):
        nonlocal refused
        write_checkpoint(tmp_path / "odd.rpck", facts, arrays)
        with warnings.catch_warnings(), contextlib.suppress(StateError):
            warnings.simplefilter("ignore")
            refused += 1
            rptcam_cl.merge([tmp_path / "odd.rpck", *parts(folder, 2, 3)])
            refused -= 1

    places = [place for place in every_place(saved.facts) if "metadata" not in place[:-2]]
    for *path, last in places:
        for value in (..., *chances.sample(ODD, 3)):
            facts = copy.deepcopy(saved.facts)
            target = facts
            for key in path:
                target = target[key]
            if value is ...:
                del target[last]
            else:
                target[last] = value
            merge_with(facts, saved.arrays)
    for name, array in saved.arrays.items():
        merge_with(saved.facts, {other: each for other, each in saved.arrays.items() if other != name})
        for odd in (array[:0], array[..., :1], array.ravel(), array.astype(np.float64), array[None]):
            merge_with(saved.facts, saved.arrays | {name: odd})
    assert len(places) > 60 and refused > 130


def test_array_of_another_size_is_refused(folder, tmp_path):
    saved = read_checkpoint(folder / "1.rpck")
    write_checkpoint(tmp_path / "1.rpck", saved.facts, saved.arrays | {"film": np.zeros((6, 64), np.float32)})
    with pytest.raises(StateError, match="damaged: its array film does not fit"):
        rptcam_cl.merge([tmp_path / "1.rpck", *parts(folder, 2, 3)])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"part": "0/3"}, "part: is none"),
        ({"part": "4/3"}, "part: is none"),
        ({"part": "1/99"}, "fewer tiles of 8 x 8 pixels than parts .* at most 35 parts"),
        ({"samples": (5, 5)}, "samples: are out of range"),
        ({"samples": (0, 5), "spp": 4}, "spp: does not go with samples"),
        ({"part": "1/3", "noise": 0.1}, "noise: needs the whole film"),
        ({"part": "1/3", "seconds": 1}, "seconds: needs the whole film"),
        ({"part": "1/3", "layers": ["variance"]}, "the layer variance needs the whole film"),
    ],
)
def test_parts_that_there_are_not_are_refused_before_any_work(options, message, monkeypatch):
    monkeypatch.setattr("rptcam_cl.api.job.open_sessions", None)
    with pytest.raises(InputError, match=message):
        rptcam_cl.render(scene(), size=SIZE, **options)


def test_whole_that_is_one_of_its_parts_is_refused(folder):
    with pytest.raises(InputError, match="is an input"):
        rptcam_cl.merge(parts(folder, 1, 2, 3), checkpoint=folder / "1.rpck")
    with pytest.raises(InputError, match="there are none"):
        rptcam_cl.merge([])


def test_compensated_sums_keep_what_float32_alone_would_lose():
    layout = FilmLayout.of(rptcam_cl.load_scene(scene() | {"film": {"resolution": [8, 8]}}).film)
    rng = np.random.default_rng(5)
    exact = rng.uniform(0, 1, (2, 3, layout.pixels)) * 1e4
    saved = []
    for index, sums in enumerate(exact):
        high = sums.astype(np.float32)
        planes = np.concatenate([high, (high - sums).astype(np.float32)])
        arrays = {"film": planes, "counts": np.zeros(3, np.uint64)}
        part = FilmPart(1, 1, 4 * index, 4 * index + 4)
        facts = {"layers": [], "picture": {"clamp": None}, "part": part.facts(), "done": part.end}
        saved.append(Checkpoint(Path("a"), facts, arrays))
    film = checkpoint.merge_arrays(saved, layout)["film"].astype(np.float64)[:, :64]
    np.testing.assert_allclose(film[:3] - film[3:], exact.sum(axis=0)[:, :64], rtol=1e-14)
