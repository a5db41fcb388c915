"""Mesh files that a test writes and reads back."""

from collections.abc import Callable
from pathlib import Path

import pytest

from rptcam_cl.core.errors import InputError
from rptcam_cl.scene.assets.mesh import MeshContents
from rptcam_cl.scene.meshes import read_mesh_file

Read = Callable[..., MeshContents]


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Write a mesh file, by its name and content, and return what it holds; further files lie beside it."""

    def read_content(name: str, content: str | bytes) -> MeshContents:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())

        def find(reference: Path) -> Path:
            if not (tmp_path / reference).is_file():
                raise InputError("no such file")
            return tmp_path / reference

        return read_mesh_file(path, find)

    return read_content
