"""Merges digests to the same bits in whatever order they come: the shape of the tree is that of their positions.

Positions 0 to n - 1 are cut after the largest power of two below n, and so are both parts: the tree of Merkle's hashes
(RFC 6962, section 2.1). A block of 2^k positions that begins at a multiple of 2^k is a node of it, so it may be merged
anywhere; that holds for the last block too, if it is shorter.
"""

from __future__ import annotations

from dynident.identification.streaming.digest import Digest


class MergeTree:
    """Digests that have come so far, merged as far as they can be: few stay where they come in order.

    A position may be empty (None): then its neighbour takes the place of both.
    """

    def __init__(self) -> None:
        self._nodes: dict[tuple[int, int], Digest | None] = {}

    def add(self, first: int, size: int, digest: Digest | None) -> None:
        """Take the digest of a block.

        Args:
            first: Its first position, a multiple of ``size``.
            size: Positions of a block, a power of two; the last block may have fewer.
            digest: What is at these positions; None for nothing.

        Raises:
            ValueError: These positions have been taken, or begin at no multiple of the size.
        """
        level = size.bit_length() - 1
        index, beyond = divmod(first, size)
        if beyond or size != 1 << level:
            raise ValueError(f"positions {first} to {first + size - 1} are no block of the tree")
        if any((up, index >> (up - level)) in self._nodes for up in range(level, level + 64)):
            raise ValueError(f"position {first} has been taken")
        while (other := (level, index ^ 1)) in self._nodes:
            neighbour = self._nodes.pop(other)
            digest = _pair(neighbour, digest) if index % 2 else _pair(digest, neighbour)
            level, index = level + 1, index // 2
        self._nodes[level, index] = digest

    def merged(self) -> Digest | None:
        """Return all that has come as one; None where all positions are empty."""
        found: Digest | None = None
        for level, index in sorted(self._nodes, key=lambda node: node[1] << node[0], reverse=True):
            found = _pair(self._nodes[level, index], found)
        return found


def _pair(first: Digest | None, second: Digest | None) -> Digest | None:
    if first is None or second is None:
        return first or second
    return first.merged(second)
