"""`python -m tests.rules.changed PART`: whether files that a part of the gate is about differ from what landed last.

Exit code 0: they do, or it is not known what landed; 3: they do not. What landed last passed this gate:
PROBEWATCH_GATE_BASE names that commit; without it, origin/main is it where it comes before the commit that is checked
out. A part that did not run for that one either was about the same files when it last ran.
"""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
BASE, LANDED = "PROBEWATCH_GATE_BASE", "origin/main"
_OF_ALL = (
    *("pyproject.toml", "Makefile", ".ci/run", "requirements-dev.lock", "tests/rules/changed.py"),
    "tools/development/package",
)
ABOUT = {
    "mutation": (
        *("appliance/supervision", "appliance/limits.py", "appliance/types.py", "appliance/service/host"),
        *(
            "drivers/closable.py",
            "drivers/errors.py",
            "drivers/printable.py",
            "drivers/rigid.py",
            "drivers/samples.py",
            "drivers/suggestion.py",
        ),
        *("tests/appliance/supervision", "tests/conftest.py", "tests/rules", "tests/support/supervised.py"),
    ),
    "deb": (
        *("systemd", "config", "requirements.lock", "README.md", "LICENSE", "tests/systemd"),
        *("tools/cli.py", "tools/commands", "tools/german", "tools/shared", "tools/development/compile_core.py"),
        *("appliance/core/registration", "tools/page/files"),  # what is no module, and a wheel may lack
    ),
    "pythons": ("appliance", "drivers", "tools", "tests"),
}
"""Part → paths, as git matches them. test_changed.py compares those of the mutation with what its tests import."""
RUN, LEAVE_OUT = 0, 3


class UnknownCommitError(Exception):
    """PROBEWATCH_GATE_BASE names none."""


def git(folder: Path, *command: str) -> str | None:
    """What git prints; None where it fails or there is none."""
    try:
        done = subprocess.run(["git", "-C", folder, *command], capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


def landed(folder: Path) -> str:
    """What landed last; empty where it is not known. Raises UnknownCommitError."""
    if base := os.environ.get(BASE, ""):
        if not git(folder, "rev-parse", "--verify", "--quiet", f"{base}^{{commit}}"):
            raise UnknownCommitError(f"{BASE} is {base!r}, which is no commit of {folder}: fetch it, or leave it empty")
        return base
    before = git(folder, "rev-list", "--max-count=1", f"{LANDED}..HEAD", "--")
    forked = git(folder, "rev-list", "--max-count=1", f"HEAD..{LANDED}", "--")
    return LANDED if before and not forked else ""


def differing(folder: Path, base: str, *paths: str) -> list[str] | None:
    """Those of the files under these paths that differ from a commit; None where git does not tell."""
    files = git(folder, "diff", "--name-only", base, "--", *paths)
    return None if files is None else files.splitlines()


def judged(part: str, folder: Path) -> tuple[int, str]:
    """(exit code, why). Raises UnknownCommitError."""
    if not (base := landed(folder)):
        return RUN, f"{part} runs: what landed last is not known ({BASE} is not set, {LANDED} is no commit before this)"
    files = differing(folder, base, *_OF_ALL, *ABOUT[part])
    if files is None:
        return RUN, f"{part} runs: git does not tell what differs from {base}"
    if not files:
        return LEAVE_OUT, f"LEFT OUT: {part}, as no file that it is about differs from {base}, which passed"
    more = f" and {len(files) - 1} more differ" if files[1:] else " differs"
    return RUN, f"{part} runs: {files[0]}{more} from {base}"


def main(part: str) -> int:
    try:
        code, why = judged(part, ROOT)
    except UnknownCommitError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"\n{why}", flush=True)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
