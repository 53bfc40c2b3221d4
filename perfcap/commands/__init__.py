"""What the program can be asked for: the options of each command, and nothing that runs it."""
