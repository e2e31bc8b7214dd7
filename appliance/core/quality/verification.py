"""Keeps what motion has shown of each parameter, until a measurement contradicts it.

The first contradiction withdraws an OK; only naming the fault waits for more evidence. The OK returns through motion
that lies wholly after the last contradiction, so that averaging cannot hide a fault that is still partly in the window.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import isfinite

from probewatch.appliance.core.parameters import BREATHED
from probewatch.appliance.core.path.residual import Lack
from probewatch.appliance.core.quality.stationary_time import StationaryTime
from probewatch.appliance.limits import Limits
from probewatch.appliance.types import PARAMETERS, Check, Rival, VerdictKind

_ROOM = 0.8
"""Share of its limit within which a contradicted parameter must be shown. More gives an OK to a fault that lies at its
limit and wavers about it; less never gives it back to a good calibration with the sigma of an ordinary sweep, which is
.05 to .1 of the limit (tests/appliance/core/quality/test_verification.py)."""
_AS_SHARP = 1.5
"""Ratio of sigmas up to which a later measurement resolves an unconfirmed contradiction. Windows of equal length differ
by this much with the motion in them; a less precise one says nothing about what the more precise one saw."""


@dataclass(frozen=True, slots=True)
class Contradiction:
    """Holds a measurement beyond its limit by its own sigmas. until_ns: its newest motion. named: reported as a
    FAULT.
    """

    check: Check
    until_ns: int
    named: bool


@dataclass(frozen=True, slots=True)
class VerificationStatus:
    """Holds how far a calibration is verified, by everything shown so far.

    `required` holds the names of the checks that must pass before the contact closes. `verified_ns` and `expires_ns`
    are as in `Verdict`. `contradictions` holds those not yet resolved, worst first. `rivals` is as in `Verdict`, for
    contradictions that stand. `lack` is what the pictures lack for any motion to show anything.
    """

    required: tuple[str, ...]
    verified_ns: int | None = None
    expires_ns: int | None = None
    contradictions: tuple[Contradiction, ...] = ()
    rivals: tuple[Rival, ...] = ()
    lack: Lack | None = None


class Verification:
    """Records, for each parameter, when motion last showed it and when it was last contradicted. `stationary` measures
    how long the probe has rested since then, which extends the maximum ages.
    """

    def __init__(self, limits: Limits, stationary: StationaryTime) -> None:
        self._stationary = stationary
        self._confidence_sigma = limits.confidence_sigma
        self._ages_s = limits.required_age_s.ages_s
        self._shown_ns: dict[str, int] = {}
        self._contradictions: dict[str, Contradiction] = {}
        self._rivals: tuple[Rival, ...] = ()

    def restart(self) -> None:
        """Discards what was shown, because the geometry has changed. Contradictions stand until new motion resolves
        them.
        """
        self._shown_ns.clear()

    def forget(self, since_ns: int) -> None:
        """Discards what was shown by motion at or after `since_ns`, which had wrong timestamps."""
        self._shown_ns = {name: t_ns for name, t_ns in self._shown_ns.items() if t_ns < since_ns}

    def predate(self, since_ns: int) -> None:
        """Dates contradictions by motion at or after `since_ns`, which had wrong timestamps, to just before it."""
        self._contradictions = {
            name: replace(contradiction, until_ns=min(contradiction.until_ns, since_ns - 1))
            for name, contradiction in self._contradictions.items()
        }

    @property
    def contradictions(self) -> tuple[Contradiction, ...]:
        """Returns the contradictions not yet resolved, worst first."""
        return tuple(sorted(self._contradictions.values(), key=lambda contradiction: -contradiction.check.ratio))

    @property
    def doubted(self) -> bool:
        """Returns whether a contradiction stands, unless it may be a breath, which only a long window can resolve."""
        return any(one.named or name not in BREATHED for name, one in self._contradictions.items())

    def rested_ns(self, name: str) -> int:
        """Returns how long the probe has rested since this check was last shown, ns. For a latency this counts only
        while the rest lasts: rest does not show a latency, so it may have changed meanwhile.
        """
        shown_ns = self._shown_ns.get(name)
        return 0 if shown_ns is None else self._stationary.since(shown_ns, lasting=name == "latency")

    @property
    def rivals(self) -> tuple[Rival, ...]:
        """Returns the candidates accused last, as long as a contradiction of each stands and none of them is named."""
        unnamed = {name for name, contradiction in self._contradictions.items() if not contradiction.named}
        return self._rivals if unnamed.issuperset(rival.check.name for rival in self._rivals) else ()

    @property
    def last_contradiction_ns(self) -> int:
        """Returns the newest motion of any contradiction that stands; 0 without one."""
        return max((contradiction.until_ns for contradiction in self._contradictions.values()), default=0)

    @property
    def status(self) -> VerificationStatus:
        """Returns the present status: verified where motion showed every required parameter, and no parameter, required
        or not, is contradicted.
        """
        required = tuple(self._ages_s)
        if self._contradictions or not self._shown_ns.keys() >= self._ages_s.keys():
            return VerificationStatus(required, contradictions=self.contradictions, rivals=self.rivals)
        own = {name: age_s for name, age_s in self._ages_s.items() if age_s is not None}
        own_ns = (self._shown_ns[name] + self.rested_ns(name) + round(age_s * 1e9) for name, age_s in own.items())
        return VerificationStatus(required, min(self._shown_ns[name] for name in required), min(own_ns, default=None))

    def contradict(self, checks: Iterable[Check], named: frozenset[str], until_ns: int) -> None:
        """Takes the contradictions among the checks, from motion up to `until_ns`. `named` holds those that are
        reported as FAULT.
        """
        for check in checks:
            if self._beyond(check):
                self._add(check, check.name in named, until_ns)

    def contradict_over(
        self, checks: tuple[Check, ...], named: frozenset[str], start_ns: int, now_ns: int, breathing_known: bool
    ) -> None:
        """Takes the contradictions among the checks, from motion between the two times. A contradiction that may be a
        breath, of a parameter not shown since `start_ns`, excludes no motion: that motion may show that it was a
        breath.
        """
        before_ns = start_ns - 1
        barred = {name for name, standing in self._contradictions.items() if standing.until_ns > before_ns}
        moot = frozenset[str]() if breathing_known else BREATHED - self._shown_ns.keys() - named - barred
        for until_ns, barring in ((before_ns, False), (now_ns, True)):
            self.contradict((check for check in checks if (check.name in moot) is not barring), named, until_ns)

    def accuse(
        self, checks: Iterable[Check], named: frozenset[str], until_ns: int, rivals: tuple[Rival, ...] = ()
    ) -> None:
        """Takes each of the checks as a contradiction, whatever its own sigma: together they explain what no value
        within the limits explains. `rivals` are those among them between which the cause is undecided.
        """
        for check in checks:
            self._add(check, check.name in named, until_ns)
        self._rivals = rivals

    def weigh(self, checks: tuple[Check, ...], since_ns: int) -> tuple[Check, ...]:
        """Accepts the checks, measured by motion from `since_ns` on; an OK that is not accepted becomes NOT_VERIFIED.

        Each check is returned with the time by which its parameter was last shown; None where it was not.
        """
        return tuple(self._weighed(check, since_ns) for check in checks)

    def _add(self, check: Check, named: bool, until_ns: int) -> None:
        before = self._contradictions.get(check.name)
        self._contradictions[check.name] = Contradiction(
            check, until_ns, named or (before is not None and before.named)
        )
        self._shown_ns.pop(check.name, None)

    def _beyond(self, check: Check) -> bool:
        """Returns whether the value is beyond its limit by its own sigmas, even if its name waits for the latency."""
        surely = check.name in PARAMETERS and check.least_ratio(self._confidence_sigma) > 1
        return surely or check.verdict is VerdictKind.FAULT

    def _weighed(self, check: Check, since_ns: int) -> Check:
        contradiction = self._contradictions.get(check.name)
        if contradiction is not None and self._resolved(check, contradiction, since_ns):
            del self._contradictions[check.name]
            contradiction = None
        good = check.verdict is VerdictKind.OK
        if good and contradiction is None and check.shown_ns is not None:
            self._shown_ns[check.name] = max(check.shown_ns, self._shown_ns.get(check.name, check.shown_ns))
        verdict = VerdictKind.NOT_VERIFIED if good and contradiction is not None else check.verdict
        return replace(check, verdict=verdict, shown_ns=self._shown_ns.get(check.name))

    def _resolved(self, check: Check, contradiction: Contradiction, since_ns: int) -> bool:
        """Returns whether motion wholly after the contradiction resolves it: it shows the parameter with margin, or,
        for a contradiction that was never confirmed, measures it as precisely and within its limit.
        """
        if since_ns <= contradiction.until_ns or not isfinite(check.value):
            return False
        if check.verdict is VerdictKind.OK:
            return abs(check.value) + self._confidence_sigma * check.sigma <= _ROOM * check.limit
        return not contradiction.named and check.ratio <= 1.0 and check.sigma <= _AS_SHARP * contradiction.check.sigma
