"""Meshes to pixels."""
