import io

import numpy as np
import PIL.Image
import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.imaging.development import developed_values, quantise
from rptcam_cl.imaging.image import Image
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
