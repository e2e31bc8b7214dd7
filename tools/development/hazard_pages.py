"""What docs/alarms.md says of each hazard: its limit, what to do, and what the study has measured."""

from statistics import median

from appliance.configuration.config import SupervisorTimes
from appliance.core.parameters import QUANTITIES
from appliance.limits import Limits
from appliance.supervision.alarms import HAZARDS
from appliance.supervision.fault_row import FaultRow
from appliance.types import Fault
from tools.development.evidence_figures import Figures, Found, of_fault
from tools.development.markdown import table
from tools.development.slips import slip_page
from tools.study.summary import Share

_HEAD = """## Measured

Simulated hazards, all kinds of a class together, by when they happen: runs with a FAULT (95 %) and its delay, median
(least to most). In every run the first name was right, unless the cell says otherwise. A share of few runs says little:
read its interval. [evidence.md](evidence.md) has each kind with its runs, seeds and commits. The study simulates no
other class.
"""


def measured(figures: Figures) -> list[str]:
    """Lines of Markdown: what the study has found of each class, and the slips."""
    seen = {fault: of_fault(figures.found, fault) for fault in HAZARDS}
    manners = list(dict.fromkeys(_when(one) for found in seen.values() for one in found))
    rows = (
        (f"`{fault}`", *(_manner([one for one in found if _when(one) == manner]) for manner in manners))
        for fault, found in seen.items()
        if found
    )
    return [*_HEAD.splitlines(), "", *table(("class", *manners), rows), *slip_page()]


def remedies(row: FaultRow) -> str:
    """What the operator does, also once a recalibration is requested."""
    return f"{row.remedy}; once a recalibration is requested: {row.requested}" if row.requested else row.remedy


def limit(fault: Fault) -> str:
    """Keys of the configuration with their defaults."""
    defaults = {**Limits().model_dump(), **SupervisorTimes().model_dump()}
    measured = [QUANTITIES[fault].limit_key] if fault in QUANTITIES else []
    return ", ".join(f"`{name}` {defaults[name]:.4g}" for name in (*measured, *HAZARDS[fault].limits)) or "–"


def _when(one: Found) -> str:
    return one.hazard.rpartition("@")[2]


def _manner(seen: list[Found]) -> str:
    delays_s = sorted(delay_s for one in seen for delay_s in one.fault_s)
    runs, named = sum(one.runs for one in seen), sum(one.named for one in seen)
    if not runs:
        return "–"
    told = str(Share(len(delays_s), runs))
    if delays_s:
        told += f"; {median(delays_s):.2f} s ({delays_s[0]:.2f} to {delays_s[-1]:.2f})"
    return told if named == len(delays_s) else f"{told}; {named} named rightly first"
