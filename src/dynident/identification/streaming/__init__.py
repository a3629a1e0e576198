"""Logs larger than memory: read in blocks, filtered in windows that overlap, reduced to triangles that merge."""
