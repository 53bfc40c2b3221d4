"""Bare meshes to actors."""
