"""A record that host and device share: one declaration, the numpy dtype and the OpenCL typedef come from it.

Members are ``float``, ``int``, ``uint``, ``float4``, ``uint2``, ``real`` (float or double, with arrays of it), and
records of ``float`` and ``int``. Members of 16 bytes stand on multiples of 16, and a record that stands in arrays is a
multiple of 16 bytes long, so that no compiler pads it. A device test checks this.
"""

from __future__ import annotations

import re
from functools import cache

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass

_MEMBER = re.compile(r"(\w+)(?:\[(\d+)\])?")
_NUMPY_TYPE: dict[str, tuple[str, tuple[int, ...]]] = {
    "float": ("<f4", ()),
    "int": ("<i4", ()),
    "uint": ("<u4", ()),
    "float4": ("<f4", (4,)),
    "uint2": ("<u4", (2,)),
}


@dataclass(frozen=True)
class Record:
    """A struct of the device: name and ``(type, member)`` pairs in order; of a union the members lie upon each other.

    A type is one of OpenCL C or a record that stands before.
    """

    name: str
    members: tuple[tuple[str | Record, str], ...]
    is_union: bool = False

    @cache  # noqa: B019 -- records are declared once
    def dtype_of(self, real: str) -> np.dtype[np.void]:
        """Return the numpy structured type with the same layout; ``real`` is the numpy type of ``real`` members."""
        names, formats = [], []
        for kind, member in self.members:
            name, length = _split(member)
            names.append(name)
            if isinstance(kind, Record):
                formats.append(np.dtype((kind.dtype_of(real), length)))
            else:
                scalar, shape = (real, ()) if kind == "real" else _NUMPY_TYPE[kind]
                formats.append(np.dtype((scalar, shape + length)))
        if self.is_union:
            return np.dtype({"names": names, "formats": formats, "offsets": [0] * len(names)})
        return np.dtype({"names": names, "formats": formats})

    @property
    def dtype(self) -> np.dtype[np.void]:
        """The numpy structured type with the same layout, ``real`` being float32."""
        return self.dtype_of("<f4")

    @property
    def typedef(self) -> str:
        """The OpenCL C declaration."""
        types = [kind.name if isinstance(kind, Record) else kind for kind, _ in self.members]
        body = " ".join(f"{kind} {member};" for kind, (_, member) in zip(types, self.members, strict=True))
        return f"typedef {'union' if self.is_union else 'struct'} {{ {body} }} {self.name};"

    def zeros(self, count: int, real: str = "<f4") -> NDArray[np.void]:
        """An array of ``count`` (at least one, as OpenCL has no empty buffers) zeroed records."""
        return np.zeros(max(count, 1), self.dtype_of(real))


def _split(member: str) -> tuple[str, tuple[int, ...]]:
    match = _MEMBER.fullmatch(member)
    assert match is not None
    return match[1], (int(match[2]),) if match[2] else ()
