"""What is closed at the end of its `with` block."""

from types import TracebackType
from typing import Self


class Closable:
    """A class of this kind holds something: a device, a socket, a thread."""

    def close(self) -> None:
        """Gives it back."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()
