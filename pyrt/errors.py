"""Every error that pyrt raises on purpose.

    PyrtError            exit code 1: rendering failed
     ├─ UsageError       exit code 2: an option or argument makes no sense
     ├─ SceneError       exit code 3: the scene, or a file that it names, is invalid
     └─ DeviceError      exit code 4: no OpenCL device can run the kernels

The message is one sentence per problem: where, what was found, what was expected.
The command line prints it to stderr and exits with `exit_code`.
"""

_SHOWN = 100  # problems in a message


class PyrtError(Exception):
    """Rendering failed; base of all of pyrt's errors."""

    exit_code = 1


class UsageError(PyrtError):
    """A command-line option or function argument makes no sense."""

    exit_code = 2


class SceneError(PyrtError):
    """The scene description, or a file that it names, is invalid.

    Attributes:
        problems: one sentence per problem, each starting with its place (file and JSON path). What they quote may hold
            any characters; those that cannot be printed are escaped. The message has the first hundred.
    """

    exit_code = 3

    def __init__(self, problems: str | list[str]):
        self.problems = [_printable(text) for text in ([problems] if isinstance(problems, str) else problems)]
        left = len(self.problems) - _SHOWN
        super().__init__("\n".join(self.problems[:_SHOWN] + [f"... and {left} more problems"] * (left > 0)))


class DeviceError(PyrtError):
    """No OpenCL device can run the kernels, or the chosen one cannot hold the scene."""

    exit_code = 4


def _printable(text: str) -> str:
    return text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
