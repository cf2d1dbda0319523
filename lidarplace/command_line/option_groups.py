"""Options that several commands share, as dataclasses: one parameter of a command each."""

import inspect
from collections.abc import Callable
from dataclasses import is_dataclass
from functools import wraps
from typing import Any


def with_option_group(*left_out: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Replace the parameter of a command that is a dataclass by the options in its fields.

    Fields are annotated and have defaults as typer's options have; they follow the other options.
    Those `left_out` keep their defaults."""

    def decorated(command: Callable[..., None]) -> Callable[..., None]:
        parameters = dict(inspect.signature(command, eval_str=True).parameters)
        (name,) = [
            name for name, parameter in parameters.items() if is_dataclass(parameter.annotation)
        ]
        group: Any = parameters.pop(name).annotation
        fields = inspect.signature(group, eval_str=True).parameters
        options = {field: option for field, option in fields.items() if field not in left_out}

        @wraps(command)
        def call(**values: Any) -> None:
            chosen = {option: values.pop(option) for option in options}
            command(**values, **{name: group(**chosen)})

        signature = inspect.Signature([*parameters.values(), *options.values()])
        call.__signature__ = signature  # type: ignore[attr-defined]
        call.__annotations__ = {
            parameter.name: parameter.annotation for parameter in signature.parameters.values()
        }
        return call

    return decorated
