"""Contact sheets: every picture at its place, as it is developed, above its own label."""

import numpy as np
import pytest
from PIL import Image as Pillow

from rptcam_cl.api.combined import GAP_PX, PAPER, TEXT_PX, WIDTH_PX, contact_sheet
from rptcam_cl.imaging.development import quantise
from rptcam_cl.imaging.image import Image


def even(red: float, green: float, blue: float, width: int = 200, height: int = 20) -> Image:
    return Image(np.full((height, width, 3), (red, green, blue), np.float32), {}, {})


def rows_with_ink(pixels: np.ndarray) -> np.ndarray:
    return np.flatnonzero((pixels != PAPER).any(axis=(1, 2)))


def test_pictures_stand_row_after_row_as_they_are_developed() -> None:
    pictures = [even(0.5, 0, 0), even(0, 0.2, 0), even(0, 0, 0.4), even(0.6, 0.6, 0, width=100, height=8)]
    sheet = np.asarray(contact_sheet([(f"number {k}", image) for k, image in enumerate(pictures)], 3))
    across, down = 200 + GAP_PX, 20 + 2 * TEXT_PX + GAP_PX
    assert sheet.shape == (2 * down + GAP_PX, 3 * across + GAP_PX, 3)
    for k, image in enumerate(pictures):
        left, top = GAP_PX + k % 3 * across + (200 - image.width) // 2, GAP_PX + k // 3 * down
        shown = sheet[top : top + image.height, left : left + image.width]
        np.testing.assert_array_equal(shown, quantise(image.developed(), 8))
        cell = sheet[top : top + down - GAP_PX, GAP_PX + k % 3 * across :][:, :200]
        below = rows_with_ink(cell[20:])
        assert below.min() > 0 and below.max() < 2 * TEXT_PX  # its label, in its cell
    for bare in (sheet[:GAP_PX], sheet[:, :GAP_PX], sheet[down:, GAP_PX + across :]):
        assert (bare == PAPER).all()


def test_large_pictures_are_averaged_to_the_width_of_a_sheet() -> None:
    noise = np.random.default_rng(3).uniform(0, 1, (60, 2 * WIDTH_PX, 3)).astype(np.float32)
    image = Image(noise, {}, {})
    sheet = np.asarray(contact_sheet([("", image)], 1))
    shown = sheet[GAP_PX : GAP_PX + 30, GAP_PX : GAP_PX + WIDTH_PX].astype(float)
    codes = np.asarray(quantise(image.developed(), 8), float).reshape(30, 2, WIDTH_PX, 2, 3).mean(axis=(1, 3))
    assert np.abs(shown - codes).max() <= 1.0


def test_lines_of_a_label_stand_one_below_the_other_in_the_middle_and_long_ones_are_cut() -> None:
    sheet = np.asarray(contact_sheet([("A\nB\n" + 60 * "M", even(0, 0, 0)), ("", even(0, 0, 0))], 2))
    text = sheet[GAP_PX + 20 : -GAP_PX, GAP_PX : GAP_PX + 200]
    for number in (0, 1):
        line = text[number * TEXT_PX + 3 : (number + 1) * TEXT_PX + 3]
        columns = np.flatnonzero((line != PAPER).any(axis=(0, 2)))
        assert (columns.min() + columns.max()) / 2 == pytest.approx(99.5, abs=1.5)
        assert columns.max() - columns.min() < 20
    last = text[2 * TEXT_PX + 3 :]
    columns = np.flatnonzero((last != PAPER).any(axis=(0, 2)))
    assert 150 < columns.max() - columns.min() < 200  # shortened to the width of the picture, no more
    assert (sheet[GAP_PX + 20 :, 200 + 2 * GAP_PX :] == PAPER).all()


def test_a_sheet_is_wide_enough_for_the_labels_of_small_pictures() -> None:
    sheet = contact_sheet([("a", even(0.5, 0.5, 0.5, width=12, height=8))], 1)
    assert isinstance(sheet, Pillow.Image) and sheet.width == 160 + 2 * GAP_PX
    pixels = np.asarray(sheet)
    columns = np.flatnonzero((pixels[GAP_PX : GAP_PX + 8] != PAPER).any(axis=(0, 2)))
    assert (columns.min(), len(columns)) == (GAP_PX + 74, 12)
