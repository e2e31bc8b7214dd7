"""Provides the base class of objects that are closed at the end of their `with` block."""

from types import TracebackType
from typing import Self


class Closable:
    """Holds a resource, such as a device, a socket or a thread, until the end of its `with` block."""

    def close(self) -> None:
        """Releases the resource."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()
