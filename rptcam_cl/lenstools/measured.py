"""What a lens does, as small results: arrays for programs, and pictures of themselves for notebooks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.core.dataclass import dataclass
from rptcam_cl.lenstools.charts import chart_svg, encoded

if TYPE_CHECKING:
    import os

    from matplotlib.figure import Figure

Array = NDArray[np.float64]

SHOWN = 40  # rows of a table in a notebook


@dataclass(frozen=True, repr=False)
class Measured:
    """A result: columns by name, all of one length, and a chart.

    Attributes
    ----------
    title : str
    columns : mapping
        Arrays by name, the unit at its end, with not-a-number where something does not exist.
    chart : callable
        Returns the chart; needs matplotlib, which nothing else here does.
    about : mapping
        Facts that are no column: where the film stands, an image as an array.
    """

    title: str
    columns: Mapping[str, Array]
    chart: Callable[[], Figure]
    about: Mapping[str, Any]

    @classmethod
    def of_rows(cls, title: str, rows: list[dict[str, Any]], chart: Callable[[], Figure], **about: Any) -> Measured:
        """Return the result of rows as the commands print them."""
        names = list(rows[0]) if rows else []
        columns = {name: np.array([np.nan if row[name] is None else row[name] for row in rows]) for name in names}
        return cls(title, columns, chart, about)

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @property
    def rows(self) -> list[dict[str, float]]:
        """The same, a mapping for each row."""
        values = {name: column.tolist() for name, column in self.columns.items()}
        return [{name: column[k] for name, column in values.items()} for k in range(len(self))]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the chart as .svg, .png or .pdf, whole or not at all.

        Raises
        ------
        InputError
            For another suffix, or without matplotlib; it says how to install it.
        StateError
            When the file cannot be written.
        """
        from pathlib import Path

        from rptcam_cl.core.atomic import check_writable, replacing
        from rptcam_cl.lenstools.charts import check_suffix

        check_suffix(Path(path))
        check_writable(path)
        data = encoded(self.chart(), Path(path))
        with replacing(path) as temporary:
            temporary.write_bytes(data)

    def __repr__(self) -> str:
        return f"<{self.title}: {len(self)} rows of {', '.join(self.columns)}>"

    def _repr_svg_(self) -> str | None:
        """Return the chart for a notebook; without matplotlib None, and the notebook shows the table."""
        from importlib.util import find_spec

        return None if find_spec("matplotlib") is None else chart_svg(self.chart())

    def _repr_html_(self) -> str:
        """Return the table for a notebook."""
        head = "".join(f"<th>{escape(name)}</th>" for name in self.columns)
        body = "".join(
            "<tr>" + "".join(f"<td>{value:.6g}</td>" for value in row.values()) + "</tr>" for row in self.rows[:SHOWN]
        )
        more = f"<p>… {len(self)} rows</p>" if len(self) > SHOWN else ""
        return f"<p>{escape(self.title)}</p><table><tr>{head}</tr>{body}</table>{more}"
