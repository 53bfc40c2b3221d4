"""Errors of results against truth."""
