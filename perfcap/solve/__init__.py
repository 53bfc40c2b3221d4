"""Optimisation that has never heard of bodies."""
