"""Errors that a user can act on: one sentence with what, got, wanted and what to do."""

LONGEST_CHARACTERS = 1200
SHOWN_CHARACTERS = 500
"""Of either end of a longer sentence: what it quotes from a file can be of any length."""


class ElfslamError(Exception):
    """Base of every error that is meant to be read by a user (exit code 2).

    `argument` names the argument of a call that would help; a command says by which option.
    """

    def __init__(self, *said: object, argument: str = "") -> None:
        super().__init__(*said)
        self.argument = argument

    def __str__(self) -> str:
        said = super().__str__()
        if len(said) <= LONGEST_CHARACTERS:
            return said
        return f"{said[:SHOWN_CHARACTERS]} ... {said[-SHOWN_CHARACTERS:]}"


class InputError(ElfslamError):
    """Input that cannot be used: a file, a recording, a value of the wrong shape."""

    choices: tuple[str, ...] = ()
    """What there is to choose from, where one is to be named."""


class ParameterError(ElfslamError):
    """A parameter that does not exist or has a value of the wrong type or range."""


class StoreError(ElfslamError):
    """Something on disk that cannot be read back or must not be overwritten."""


class WorkerError(ElfslamError):
    """Work that was given to others and that they cannot do: they died, or are another version."""


class NoAnswerError(ElfslamError):
    """The input was fine, but the world gave no answer (exit code 1)."""
