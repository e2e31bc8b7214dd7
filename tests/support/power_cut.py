"""What a power cut can leave of a folder, at every step of what is done to it.

The work is done to a real folder, and looked at before and after each call that changes one. What a cut may leave is
more than a file system does on its own: of what no fsync has made durable, each change of a name is there or not,
whatever the order, and each file is as it last was durable, or half of what was written, or all of it; with what both
begin with, as where one appends.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import chain, combinations, product, takewhile
from pathlib import Path
from typing import Any

import pytest

Image = Mapping[str, bytes | None]
"""Name relative to the folder → content; None is a folder."""
_Names = dict[str, int]
_Change = dict[str, int | None]
"""Names that one call changed → inode; None where the name went."""
_CALLS = ("open", "replace", "rename", "link", "mkdir", "unlink", "rmdir", "truncate", "fsync", "fdatasync")


def restored(image: Image, folder: Path) -> None:
    """The image as a new folder."""
    folder.mkdir()
    for name, content in sorted(image.items()):
        if content is None:
            (folder / name).mkdir()
        else:
            (folder / name).write_bytes(content)


class Disk:
    """A folder whose present content is durable. cuts: everything that a cut could have left since, in order and each
    once. final: everything that a cut can leave once the work is done.
    """

    def __init__(self, folder: Path) -> None:
        self._root = folder
        self._linked = folder.with_name(f"{folder.name}-linked")
        """A second name for every file: an inode in use is never given to another."""
        self._linked.mkdir()
        self._names: dict[int, _Names] = {}
        self._contents: dict[int, bytes] = {}
        self._changes: dict[int, list[_Change]] = {}
        self._look()
        self._changes.clear()
        self._durable_names, self._durable_contents = dict(self._names), dict(self._contents)
        self.cuts: list[Image] = []
        self.final: list[Image] = []

    def left_now(self) -> list[Image]:
        """Everything that a cut at this moment can leave."""
        self._look()
        folders = [inode for inode, changes in self._changes.items() if changes]
        files = [inode for inode, now in self._contents.items() if now != self._durable_contents.get(inode)]
        images = []
        for names in product(*(_subsets(self._changes[inode]) for inode in folders)):
            for contents in product(*(self._torn(inode) for inode in files)):
                images.append(
                    self._image(dict(zip(folders, names, strict=True)), dict(zip(files, contents, strict=True)))
                )
        return images

    def note(self) -> None:
        """Add what a cut at this moment can leave."""
        self.cuts += [image for image in self.left_now() if image not in self.cuts]

    def synchronised(self, inode: int) -> None:
        """That file or folder is durable as it is."""
        self._look()
        if inode in self._names:
            self._durable_names[inode] = self._names[inode]
            self._changes[inode] = []
        elif inode in self._contents:
            self._durable_contents[inode] = self._contents[inode]

    def _look(self) -> None:
        for folder, _, files in os.walk(self._root):
            inode = self._inode(Path(folder))
            now = {one.name: self._inode(Path(one.path)) for one in os.scandir(folder)}
            before = self._names.get(inode, {})
            changed: _Change = {name: now.get(name) for name in {**before, **now} if before.get(name) != now.get(name)}
            if changed:
                self._changes.setdefault(inode, []).append(changed)
            self._names[inode] = now
            for name in files:
                self._contents[now[name]] = (Path(folder) / name).read_bytes()

    def _inode(self, path: Path) -> int:
        inode = path.stat().st_ino
        second = self._linked / str(inode)
        if path.is_file() and not second.exists():
            _LINK(path, second)
        return inode

    def _torn(self, inode: int) -> list[bytes]:
        now, durable = self._contents[inode], self._durable_contents.get(inode, b"")
        same = takewhile(lambda pair: pair[0] == pair[1], zip(now, durable, strict=False))
        kept = sum(1 for _ in same)
        return [durable, now[: kept + (len(now) - kept) // 2], now]

    def _image(self, changes: dict[int, tuple[_Change, ...]], contents: dict[int, bytes]) -> Image:
        image: dict[str, bytes | None] = {}

        def fill(inode: int, place: str) -> None:
            names: _Change = dict(self._durable_names.get(inode, {}))
            for change in changes.get(inode, ()):
                names |= change
            for name, found in names.items():
                if found is None:
                    continue
                is_folder = found in self._names
                image[place + name] = None if is_folder else contents.get(found, self._durable_contents.get(found, b""))
                if is_folder:
                    fill(found, f"{place}{name}/")

        fill(self._root.stat().st_ino, "")
        return image


_LINK = os.link


def _subsets(changes: list[_Change]) -> list[tuple[_Change, ...]]:
    return list(chain.from_iterable(combinations(changes, count) for count in range(len(changes) + 1)))


@contextmanager
def recorded(folder: Path) -> Iterator[Disk]:
    """Everything that is done to the folder by this process meanwhile; each call does what it always does."""
    disk = Disk(folder)
    with pytest.MonkeyPatch.context() as patch:
        for name in _CALLS:
            patch.setattr(os, name, _watched(disk, name, getattr(os, name)))
        yield disk
    disk.final = disk.left_now()


def _watched(disk: Disk, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
    def call(*arguments: Any, **options: Any) -> Any:
        disk.note()
        result = real(*arguments, **options)
        if name in ("fsync", "fdatasync"):
            disk.synchronised(os.fstat(arguments[0]).st_ino)
        disk.note()
        return result

    return call
