"""Checks whether there are known vulnerabilities in what a cart runs: `python -m
probewatch.tools.development.vulnerabilities PIP_AUDIT LOCK`.

pip-audit ends well also where it has reached no database and looked nothing up; that is reported as "NOT CHECKED" here.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

FOUND, NOT_CHECKED = 1, 2
"""Exit codes beside 0; the second is no verdict."""
_TIMEOUT_S = 300
"""Seconds for about thirty packages, one query each."""


def main(pip_audit: str, lock: Path) -> int:
    """Prints what was found, or that nothing could be; returns the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        options = ["--strict", "--no-deps", "--disable-pip", "--require-hashes", "--progress-spinner=off"]
        command = [pip_audit, *options, "-r", str(lock), "--format=json", "--output", str(report)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=_TIMEOUT_S)
        except (OSError, subprocess.TimeoutExpired) as error:
            return _not_checked(str(error))
        if not report.exists():
            return _not_checked(done.stderr.strip().rpartition("\n")[2] or f"pip-audit ended with {done.returncode}")
        return judged(report.read_text(), _locked(lock))


def judged(report: str, locked: int) -> int:
    """Prints what a report shows and returns the exit code. report: that of pip-audit, JSON. locked: number of packages
    that it had to look up.
    """
    try:
        parts = json.loads(report)["dependencies"]
        skipped = [str(part["name"]) for part in parts if "skip_reason" in part]
        known = [(part["name"], part["version"], one) for part in parts for one in part.get("vulns", [])]
    except (ValueError, KeyError, TypeError):
        return _not_checked("what pip-audit wrote cannot be read")
    for name, version, one in known:
        fixed = ", ".join(one.get("fix_versions", [])) or "no version yet"
        print(f"{name} {version}: {one.get('id')}, fixed in {fixed}")
    if skipped or len(parts) < locked:
        return _not_checked(f"of {locked} packages {len(parts) - len(skipped)} were looked up")
    print(f"{len(parts)} packages looked up, {len(known)} known vulnerabilities")
    return FOUND if known else 0


def _locked(lock: Path) -> int:
    """Returns the number of packages of the lock file that this interpreter would get; others are for other systems."""
    lines = [line for line in lock.read_text().splitlines() if "==" in line and not line.startswith((" ", "#"))]
    return sum(";" not in line for line in lines)


def _not_checked(why: str) -> int:
    print(f"NOT CHECKED: {why}. This says nothing about vulnerabilities.", file=sys.stderr)
    return NOT_CHECKED


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2])))
