"""The one exception that a user may see: a plain sentence that says what is wrong, where, and how to mend it."""


class PaveTwinError(Exception):
    """Something the user can mend. The command line prints the message as one line and exits with code 2."""


class Interrupted(PaveTwinError):
    """The user stopped the run. Exit code 130."""
