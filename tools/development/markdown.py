"""What the pages of docs/ are made of."""

from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Lines of a Markdown table, with an empty one after it."""
    return [*(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)), ""]


def shared_aside(head: Sequence[str], rows: Iterable[Sequence[str]], names: Sequence[str]) -> list[str]:
    """The same table, without those columns of these names that say the same in every one of its rows, if it has two
    or more; a sentence before it says that instead.
    """
    lines = [tuple(row) for row in rows]
    alike = {
        at for at, name in enumerate(head) if name in names and len(lines) > 1 and len({row[at] for row in lines}) == 1
    }
    told = "; ".join(f"{head[at]}: {lines[0][at]}" for at in sorted(alike))
    left = [[cell for at, cell in enumerate(row) if at not in alike] for row in (head, *lines)]
    return [*([f"In all rows {told}.", ""] if told else ()), *table(left[0], left[1:])]
