"""The exceptions of ngspring.

Two kinds: what the user's input got wrong (`NgspringError`, a `ValueError`), and an analysis that
could not be followed although the input was in order (`ConvergenceError`, a `RuntimeError`).
"""


class NgspringError(ValueError):
    """Something in the user's input is wrong; the message is one line that says what."""


class ProblemError(NgspringError):
    """A spring problem, or a file that describes one, is not valid."""


class DesignFileError(NgspringError):
    """A file that should hold a design cannot be read, or does not fit the problem."""


class RunFolderError(NgspringError):
    """A run folder is missing, incomplete, or belongs to another problem."""


class ConvergenceError(RuntimeError):
    """An analysis or an evolution could not be followed to its end."""


class OutlineError(NgspringError):
    """A design has no outline to build: grey, empty, full, or not joined to both loaded sides."""


class ExportError(NgspringError):
    """A part cannot be written in the wanted format."""
