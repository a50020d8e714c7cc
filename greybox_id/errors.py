"""What went wrong, as a sentence.

Every error a user can cause is a `GreyboxError`. Its text says what is wrong, where (file, column,
row) and what to do about it; the command line prints it and exits with 2, without a traceback.
"""


class GreyboxError(Exception):
    """Base of all errors that a user can cause and mend."""


class BadInput(GreyboxError):
    """A file, a column map, a setting or a value that cannot be used."""


class BadModel(GreyboxError):
    """A model whose equations cannot be traced, or that does not fit the recording it meets."""
