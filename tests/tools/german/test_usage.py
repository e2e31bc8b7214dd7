"""The German of refused command lines is that of texts which click or a command says, with the same fields."""

import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from probewatch.tools.cli import probewatch
from probewatch.tools.german.usage import GERMAN_OF_USAGE, usage_text
from tests.support.german import other_fields

TOOLS = Path(__file__).parents[3] / "tools"
FOLDERS = (
    TOOLS / "commands",
    TOOLS / "shared",
    TOOLS / "recalibration",
    TOOLS / "simulators",
    TOOLS.parent / "drivers/twins",
    Path(click.__file__).parent,
)


def sources() -> Iterator[str]:
    for folder in FOLDERS:
        for file in folder.glob("*.py"):
            yield file.read_text(encoding="utf-8")


def test_each_text_has_the_same_fields() -> None:
    assert other_fields(GERMAN_OF_USAGE) == []


def test_nothing_is_translated_that_nobody_says() -> None:
    """Click puts a kind and a type of number into its own."""
    said = " ".join(re.sub(r'"\s*\n?\s*f?"', "", source) for source in sources()).replace("Choose from:\\n", "")
    for english in GERMAN_OF_USAGE:
        bare = re.sub(r"^(?:File|Directory|Path) |(?<=a valid )[a-z ]+\.$", "", english)
        split = re.split(r"{\w+}(?: is not )?|[:,;?]|\. |(?= Use )", bare)
        pieces = [one.strip(" .?()") for one in split if re.search("[a-z]{3}", one)]
        assert all(piece in said for piece in pieces), english


@pytest.mark.parametrize(
    "words",
    [
        ["study", "--sessions", "dream"],
        ["study", "--profiles", "x"],
        ["study", "--noise-mm", "9"],
        ["study", "--probe", "Stylus"],
        ["study", "--hazards", "latency=450@sudden", "--duration", "5", "--sessions", "hold", "--tissues", "still"],
        ["fleet", "--prometheus", "http://x", "--over", "soon"],
        ["fleet", "--prometheus", "http://x", "--job", '"'],
        ["simulate", "cart", "--unconfigured"],
        ["page", "--host", "https://x"],
    ],
)
def test_a_german_cart_refuses_these_command_lines_in_german(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(probewatch, words, standalone_mode=False)
    assert isinstance(result.exception, click.UsageError), result.output
    assert usage_text(result.exception.format_message()) is not None, result.exception.format_message()


def test_a_text_is_german_whole_or_not_at_all() -> None:
    assert usage_text("Invalid value for '--x': 'y' is not a valid integer.") == (
        "Ungültiger Wert für '--x': 'y' ist keine ganze Zahl."
    )
    assert usage_text("Invalid value for '--x': it is odd") is None
    ahead = (
        "the month 2999-01 has not begun: it is 2026-01-01 08:00 UTC by this computer's clock. Give a day that has been"
    )
    assert str(usage_text(f"Invalid value for '--of': {ahead}")).startswith(
        "Ungültiger Wert für '--of': 2999-01 (Monat) hat nicht begonnen: es ist 2026-01-01 08:00 UTC nach der Uhr "
    )
    assert usage_text("Missing option '--to'. Choose from:\n\ta,\n\tb") == "Die Option '--to' fehlt. Möglich: a, b"
    assert usage_text("No such option '--x'. Did you mean 'a' or 'b'?") == (
        "Die Option '--x' gibt es nicht. Gemeint 'a' oder 'b'?"
    )
