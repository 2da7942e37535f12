"""The exception for unusable input."""


class InputError(Exception):
    """Unusable input: a file, a column, a key or an option.

    The message is one sentence that names the file, the column or key, what was found and what was
    expected (with the valid choices where there are some). The command line prints it alone and exits
    with status 2; any other exception that reaches the command line is a defect of the package.
    """
