"""The one error that means: what came from outside is not usable."""


class InputError(ValueError):
    """Bad input: says what is wrong, where, and what is allowed.

    Commands and nodes print its message without a traceback and exit with status 2.
    """


def check_range(
    name: str,
    value: float,
    low: float,
    high: float,
    *,
    low_open: bool = False,
    high_open: bool = False,
) -> None:
    """Raise unless `value` lies between `low` and `high` (ends included unless open).

    Raises
    ------
    InputError
        Naming the field, the value and the range.
    """
    above = value > low if low_open else value >= low
    below = value < high if high_open else value <= high
    if not (above and below):  # also true for NaN
        left, right = "(" if low_open else "[", ")" if high_open else "]"
        raise InputError(f"{name} is {value!r}; allowed: {left}{low}, {high}{right}")


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Raise unless `value` is one of `choices`.

    Raises
    ------
    InputError
        Naming the field, the value and the choices.
    """
    if value not in choices:
        raise InputError(f"{name} is {value!r}; allowed: {', '.join(choices)}")
