"""The one exception users see for bad input."""


class InputError(ValueError):
    """A file, argument or array that cannot be used.

    The message is one line: what it is about (a path, an argument), what was found, what was
    expected, and what to do. The command line prints it as it is and exits with code 2.
    """
