"""Errors that a user can mend: bad input, and a disk that cannot be written."""

from collections.abc import Callable

Refuse = Callable[..., None]  # refuse(problem, remedy, file=...) raises InputError


def printable(text: str) -> str:
    """The text with what is no UTF-8, as in names of files from other systems, in numbers."""
    return text.encode("utf-8", "backslashreplace").decode()


class InputError(ValueError):
    """Bad input: names the case, the file, the problem and the remedy.

    >>> str(InputError("P03", "plan.json", "rotation of 'lefort1' is not a rotation", "store R with R'R = I"))
    "case 'P03': plan.json: rotation of 'lefort1' is not a rotation. Remedy: store R with R'R = I."
    """

    def __init__(self, case: str, file: object, problem: str, remedy: str):
        super().__init__(printable(f"case {case!r}: {file}: {problem}. Remedy: {remedy}."))
        self.case, self.file, self.problem, self.remedy = case, str(file), problem, remedy

    def __reduce__(self):
        return InputError, (self.case, self.file, self.problem, self.remedy)  # from another process


# Of files that the study has made.
REMEDY = "delete it and run the same command again; of an archive, copy it again"


def refusal(case: str, file: object, always: str = "") -> Refuse:
    """refuse(problem, remedy), which raises the InputError of a case and a file; of another file by file=...

    always: the remedy, whatever the problem.
    """

    def refuse(problem: str, remedy: str, file: object = file) -> None:
        raise InputError(case, file, problem, always or remedy)

    return refuse


def damaged(file: object, error: BaseException) -> InputError:
    """That a file of the study's own cannot be read, by what a library says of it."""
    reason = (str(error).strip() or type(error).__name__).splitlines()[-1]
    return InputError("-", file, f"it cannot be read ({reason[:160]})", REMEDY)


class StorageError(OSError):
    """A file or folder that cannot be written: names it, the problem and the remedy.

    >>> str(StorageError("results", "read-only file system", "make it writable"))
    'results: read-only file system. Remedy: make it writable.'
    """

    def __init__(self, file: object, problem: str, remedy: str):
        super().__init__(f"{file}: {problem}. Remedy: {remedy}.")
        self._parts = file, problem, remedy

    def __reduce__(self):
        return StorageError, self._parts
