"""Generates the table in docs/method.md of what each cause resets in the evidence, from `RESETS`.
`python -m probewatch.tools.development.manual` writes it.
"""

from pathlib import Path

from probewatch.appliance.core.quality.resets import RESETS, Cause
from probewatch.tools.development.markdown import table
from probewatch.tools.development.page_blocks import PageBlocks

PAGE = Path(__file__).parents[2] / "docs/method.md"


def _resets() -> str:
    rows = [(state, *(effects[cause] for cause in Cause)) for state, effects in RESETS.items()]
    return "\n".join(table(("state of the evidence", *Cause), rows))


BLOCKS = PageBlocks("resets", lambda name: {"evidence": _resets}[name]())


def written() -> dict[Path, str]:
    """Returns the path and content of the page."""
    return {PAGE: BLOCKS.page(PAGE.read_text(encoding="utf-8"))}
