import io

import numpy as np
import PIL.Image
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.development import developed_values, quantise
from rptcam_cl.imaging.image import Image, desqueezed
from rptcam_cl.scene.film import PictureSettings


@pytest.fixture
def pixels() -> np.ndarray:
    return np.random.default_rng(1).random((4, 6, 3), dtype=np.float32)


def test_array_of_an_image_is_its_film(pixels: np.ndarray) -> None:
    array = np.asarray(Image(pixels))
    assert array.dtype == np.float32
    assert np.array_equal(array, pixels)


def test_copy_of_an_image_is_a_copy(pixels: np.ndarray) -> None:
    image = Image(pixels)
    array = np.array(image)
    array[:] = 0
    assert np.array_equal(image.pixels, pixels)
    assert np.asarray(image, np.float64).dtype == np.float64


def test_size_is_columns_by_rows(pixels: np.ndarray) -> None:
    image = Image(pixels, metadata={"spp": 16})
    assert (image.width, image.height) == (6, 4)
    assert repr(image) == "<Image 6 x 4, 16 spp>"
    assert repr(Image(pixels)) == "<Image 6 x 4>"
    assert repr(Image(pixels, {"spp": 640, "spp_mean": 81.25})) == "<Image 6 x 4, 81 spp>"


@pytest.mark.parametrize("shape", [(4, 6), (4, 6, 4), (0, 6, 3), (3,)])
def test_array_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="height, width, 3"):
        Image(np.zeros(shape, np.float32))


def test_numbers_of_another_kind_are_refused(pixels: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"pixels: wrong kind of numbers \(got float64; allowed .* float32"):
        Image(pixels.astype(np.float64))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="got list"):
        Image(pixels.tolist())


def test_notebook_shows_the_developed_picture(pixels: np.ndarray) -> None:
    picture = PictureSettings(ev=1.0, tone="aces")
    with PIL.Image.open(io.BytesIO(Image(pixels, development=picture)._repr_png_())) as shown:
        assert np.array_equal(np.asarray(shown), quantise(developed_values(pixels, picture), 8))


def image_of(columns, height=3, **metadata):
    pixels = np.repeat(np.asarray(columns, np.float32)[None, :, None], height, axis=0).repeat(3, axis=2)
    return Image(np.ascontiguousarray(pixels), dict(metadata))


@pytest.mark.parametrize("factor", [1.0, 1.33, 1.36, 1.5, 2.0])
def test_light_is_kept_and_even_films_stay_even(factor):
    rng = np.random.default_rng(1)
    film = image_of(rng.random(200))
    wide = desqueezed(film, factor)
    assert (wide.width, wide.height) == (round(200 * factor), 3)
    assert wide.pixels.mean() == pytest.approx(film.pixels.mean(), rel=1e-6)
    assert desqueezed(image_of(np.full(50, 0.7)), factor).pixels == pytest.approx(0.7, rel=1e-6)


def test_factor_two_doubles_columns():
    np.testing.assert_allclose(desqueezed(image_of([1, 2, 5]), 2.0).pixels[0, :, 0], [1, 1, 2, 2, 5, 5], rtol=1e-6)


def test_edge_between_columns_is_divided_by_area():
    # columns of 2/3 of the film's width: the middle one covers half of either side
    np.testing.assert_allclose(desqueezed(image_of([0, 3]), 1.5).pixels[0, :, 0], [0, 1.5, 3], rtol=1e-6)


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e30])
def test_what_is_no_number_or_beyond_all_others_stays_where_it_is(odd):
    wide = desqueezed(image_of([0.5, odd, 0.25, 0.75]), 1.5).pixels[0, :, 0]
    np.testing.assert_array_equal(wide, np.float32([0.5, odd, odd, 0.25, 0.5, 0.75]) * [1, 0.5, 1, 1, 1, 1])


def test_ellipses_become_circles():
    """A disk that a 1.5 times squeeze has made an ellipse has equal second moments again."""
    x, y = np.meshgrid(np.arange(120) + 0.5 - 60, np.arange(180) + 0.5 - 90)
    disk = ((x * 1.5) ** 2 + y**2 <= 60**2).astype(np.float32)
    wide = desqueezed(Image(np.repeat(disk[..., None], 3, axis=2)), 1.5).pixels[..., 0]
    x, y = np.meshgrid(np.arange(180) + 0.5 - 90, np.arange(180) + 0.5 - 90)
    assert np.sum(wide * x**2) == pytest.approx(np.sum(wide * y**2), rel=2e-3)
    assert wide.sum() == pytest.approx(np.pi * 60**2, rel=2e-3)


def test_metadata_say_so_and_twice_is_refused():
    wide = desqueezed(image_of([1, 2, 3, 4], lens="a", window=[0, 0, 4, 3]), 1.36)
    assert wide.metadata == {"lens": "a", "desqueezed": 1.25}  # five columns of four
    with pytest.raises(InputError, match="desqueezed before"):
        desqueezed(wide, 2.0)
    with pytest.raises(InputError, match="out of range"):
        desqueezed(image_of([1]), 0.5)
