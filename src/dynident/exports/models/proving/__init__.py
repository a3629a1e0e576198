"""Proofs: files loaded again by the engines that read them."""
