"""Readers of recordings with truth, in the layouts they are published in."""
