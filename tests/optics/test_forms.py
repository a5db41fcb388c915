"""Kinds of surface with numbers of their own: each stands for itself, and what cannot say one refuses it."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.core.records import SurfaceKind
from rptcam_cl.optics.files import native
from rptcam_cl.optics.files.export import codev_text, pbrt_text, zemax_text
from rptcam_cl.optics.library import load_lens
from rptcam_cl.optics.shapes import FORMS, Biconic, Form


@dataclass(frozen=True)
class Bump(Form):
    """A kind that no other program knows."""

    kind = SurfaceKind.BICONIC
    description = "a bump"
    keys: ClassVar = {}

    @classmethod
    def read(cls, fields: Any, scale: float) -> None:
        return None

    def written(self) -> dict[str, Any]:
        return {}


def test_every_kind_has_its_own_number() -> None:
    assert len({form.kind for form in FORMS}) == len(FORMS)
    assert all(form.kind > SurfaceKind.ASPHERE for form in FORMS)


def test_a_surface_of_two_kinds_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "FORMS", (Biconic, Biconic))
    row = {"radius": 50.0, "radius_x": 40.0, "diameter": 10.0}
    with pytest.raises(InputError, match=r"surfaces\[0\]: is of two curvatures and of two curvatures: leave"):
        load_lens({"surfaces": [row]})


@pytest.mark.parametrize("write", [zemax_text, codev_text, pbrt_text])
def test_a_kind_that_a_format_does_not_know_is_refused_by_it(write: Any) -> None:
    lens = load_lens("plano-convex-100mm")
    bumpy = replace(lens, surfaces=(replace(lens.surfaces[0], form=Bump()), *lens.surfaces[1:]))
    with pytest.raises(InputError, match="a bump"):
        write(bumpy)
