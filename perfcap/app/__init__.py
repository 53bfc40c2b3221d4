"""The commands: files in, files out, one line for every mistake."""
