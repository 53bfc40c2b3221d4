"""Tensor maths, no people."""
