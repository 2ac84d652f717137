"""Errors that a person can mend: one line that says what is wrong, where, and what to do."""


class InputError(Exception):
    """Bad input from outside (configuration, recording, machine): the message is one line for a person.

    Stage commands print it without a traceback and exit with code 1.
    """
