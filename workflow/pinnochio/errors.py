"""The one error for input that a user can mend."""


class InputError(ValueError):
    """Bad input: names the case, the file, the problem and the remedy.

    >>> str(InputError("P03", "plan.json", "rotation of 'lefort1' is not a rotation", "store R with R'R = I"))
    "case 'P03': plan.json: rotation of 'lefort1' is not a rotation. Remedy: store R with R'R = I."
    """

    def __init__(self, case: str, file: object, problem: str, remedy: str):
        super().__init__(f"case {case!r}: {file}: {problem}. Remedy: {remedy}.")
        self.case, self.file, self.problem, self.remedy = case, str(file), problem, remedy
