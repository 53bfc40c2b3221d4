"""One file, one term, one equation."""
