"""Makes the parts of the pages of docs/."""

from collections import Counter
from collections.abc import Iterable, Sequence


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Returns the lines of a Markdown table, with an empty one after it."""
    return [*(f"| {' | '.join(row)} |" for row in (head, ["---"] * len(head), *rows)), ""]


def shared_aside(head: Sequence[str], rows: Iterable[Sequence[str]], names: Sequence[str]) -> list[str]:
    """Returns the lines of such a table, with what most of its rows have in the columns of these names stated in a
    sentence before it. A cell with anything else stays; a column without any is left out.
    """
    lines = [tuple(row) for row in rows]
    usual: dict[int, str] = {}
    for at in (at for at, name in enumerate(head) if name in names):
        cell, count = Counter(row[at] for row in lines).most_common(1)[0] if lines else ("", 0)
        usual |= {at: cell} if count > 1 and 2 * count >= len(lines) else {}
    told = "; ".join(f"{head[at]}: {cell}" for at, cell in usual.items())
    shown = [at for at in range(len(head)) if at not in usual or any(row[at] != usual[at] for row in lines)]
    left = [["" if row[at] == usual.get(at) else row[at] for at in shown] for row in lines]
    return [*([f"Unless a row says otherwise, {told}.", ""] if told else ()), *table([head[at] for at in shown], left)]
