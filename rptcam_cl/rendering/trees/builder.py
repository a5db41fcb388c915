"""The device's part of a build: boxes that are counted, moved and sorted by the kernels of ``kernels/build``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rptcam_cl.device import Program, Session

BINS = 16  # per axis
SWEEP = 32  # nodes of at most so many primitives are split exactly
SMALL = {"cpu": 4096, "gpu": 1024}  # primitives that one work item takes on: what a core's cache holds; many for a GPU
SMALL_FOR_SHORT_LOOPS = 64  # for a device that limits loops: sorting more might take it 65535 steps
GROUP = {"cpu": 1, "gpu": 32}  # work items per group: each has kilobytes of its own
KERNELS = ("gather", "histogram", "partition", "subtree", "leaves", "search", "reinsert")
FILES = [f"build/{name}.cl" for name in KERNELS]
MOST_VISITS = 128  # nodes that the search for one node's better place looks at; more gain less than 1 %
FACTS = {"BINS": BINS, "SWEEP": SWEEP, "DEEPEST": 127, "MOST_VISITS": MOST_VISITS}


def build_program(session: Session) -> Program:
    """Return the program of all kernels that build: a single one, whatever the tree, as compiling takes its time."""
    return session.program(FILES, FACTS, "")


class Builder:
    """The boxes of a build on its device, and what can be done to them.

    Parameters
    ----------
    session
        The device.
    lower, upper
        Corners of the boxes (n, 3), float32.
    leaf_size
        Primitives of a leaf block, a power of two.
    max_depth
        Depth that no leaf may exceed.
    """

    def __init__(
        self,
        session: Session,
        lower: NDArray[np.float32],
        upper: NDArray[np.float32],
        leaf_size: int,
        max_depth: int,
    ) -> None:
        self.leaf_size = leaf_size
        self.max_depth = max_depth
        self._session = session
        self._program = build_program(session)
        self._small = SMALL[session.kind] if session.loop_limit is None else SMALL_FOR_SHORT_LOOPS
        self._count = len(lower)
        self._shrink = np.float32(scale_of(np.concatenate([lower.min(axis=0), upper.max(axis=0)])))
        self._boxes = session.allocate(32 * self._count)
        self._spare: Any = None
        self._run("gather", self._count, 64, lower=session.upload(lower), upper=session.upload(upper))
        session.finish()

    def _run(self, kernel: str, items: int, group: int, **arguments: Any) -> None:
        """Run a kernel of the build over ``items``; all take the boxes."""
        launch = self._session.bind(self._program, kernel, boxes=self._boxes, **arguments, count=np.int32(items))
        launch.enqueue(-(-items // group) * group, group)

    def _run_heavy(self, kernel: str, items: int, **arguments: Any) -> None:
        self._run(kernel, items, GROUP[self._session.kind], **arguments)

    def is_small(self, count: NDArray[np.int64], depth: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which nodes are left to one work item: small ones, and those deep enough to need exact halves."""
        blocks = -(-count // self.leaf_size)
        return (count <= self._small) | (depth + np.ceil(np.log2(np.maximum(blocks, 1))) >= self.max_depth)

    def histogram(self, chunks: NDArray[np.int32], grids: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the bins (chunks, 3 axes, BINS, 2 corners, 4): bounds; in the last place of the first, the count."""
        shape = (len(chunks), 3, BINS, 2, 4)
        size = int(np.prod(shape))
        bins = self._session.allocate(4 * size)
        given = {"chunks": self._session.upload(chunks), "grids": self._session.upload(grids)}
        self._run_heavy("histogram", len(chunks), **given, bins=bins)
        return self._session.read(bins, np.float32, size).reshape(shape)

    def partition(self, chunks: NDArray[np.int32], splits: NDArray[np.int32]) -> NDArray[np.float32]:
        """Move chunks to the other buffer, which takes the first one's place.

        Returns
        -------
        numpy.ndarray
            Bounds of the centroids (chunks, 2 children, 2 corners, 4).
        """
        if self._spare is None:
            self._spare = self._session.allocate(32 * self._count)
        spans = self._session.allocate(64 * len(chunks))
        given = {"chunks": self._session.upload(chunks), "splits": self._session.upload(splits)}
        self._run_heavy("partition", len(chunks), sorted=self._spare, **given, spans=spans)
        self._boxes, self._spare = self._spare, self._boxes
        return self._session.read(spans, np.float32, 16 * len(chunks)).reshape(-1, 2, 2, 4)

    def build_subtrees(self, ranges: NDArray[np.int32], marks: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Sort ranges (begin, end, depth, -) into leaves and return all marks."""
        self._spare = None
        memory = self._session.allocate(self._count)
        self._session.write(memory, marks)
        self._run_heavy(
            "subtree",
            len(ranges),
            marks=memory,
            ranges=self._session.upload(ranges),
            shrink=self._shrink,
            leaf_bits=np.int32(self.leaf_size.bit_length() - 1),
            max_depth=np.int32(self.max_depth),
        )
        return self._session.read(memory, np.uint8, self._count)

    def leaves(self, starts: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Return blocks (leaves, leaf_size) and bounds (leaves, 6) of the leaves that begin at ``starts[:-1]``."""
        count = len(starts) - 1
        blocks = self._session.allocate(4 * self.leaf_size * count)
        bounds = self._session.allocate(32 * count)
        given = {"starts": self._session.upload(starts), "leaf_size": np.int32(self.leaf_size)}
        self._run("leaves", count, 64, **given, blocks=blocks, bounds=bounds)
        corners = self._session.read(bounds, np.float32, 8 * count).reshape(-1, 2, 4)[:, :, :3]
        primitives = self._session.read(blocks, np.int32, self.leaf_size * count)
        return primitives.reshape(-1, self.leaf_size), corners.reshape(-1, 6)


def scale_of(bounds: NDArray[np.float32]) -> float:
    """Return the power of two that brings a box's longest edge into [0.5, 1), as near as float32 allows."""
    longest = float((bounds[3:].astype(np.float64) - bounds[:3]).max())
    exponent = int(np.frexp(longest)[1]) if longest > 0.0 else 0
    return float(np.ldexp(1.0, min(max(-exponent, -126), 126)))
