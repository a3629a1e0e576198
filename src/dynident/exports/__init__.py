"""Models and motions as files of other programs, each loaded again as proof."""
