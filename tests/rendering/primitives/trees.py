"""Scenes with the tree over primitives or without, however many there are."""

import pytest

from rptcam_cl.rendering import culling as trees


def with_tree(monkeypatch: pytest.MonkeyPatch, wanted: bool) -> None:
    """Make scenes get a tree over their primitives however few they are, or never."""
    monkeypatch.setattr(trees, "BREAK_EVEN", 0 if wanted else 1 << 30)
