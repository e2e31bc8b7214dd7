"""The page of a period: what stands on it, what it refuses, and its signature."""

import json
import re
import shutil
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from click.testing import CliRunner

from probewatch.appliance.storage.alarm_chain import read_log
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.reference_store import Entry, History, sha256_of, write_history
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.commands.report import command
from probewatch.tools.report.period import last_period, limits_text, period, summary
from tests.appliance.configuration.test_config import GOOD
from tests.tools.report.test_period import MONTH, NOW, START, logged, state


@pytest.fixture
def cart(tmp_path: Path) -> Path:
    """Its configuration; the log lies in alarms, with two self-tests."""
    folder = logged(tmp_path / "alarms", MONTH)
    kept = folder / "self-tests"
    kept.mkdir()
    for name, passed in (("a", True), ("b", False)):
        item = {"name": "disk", "green": passed}
        record = {"utc": "2026-01-05T07:00:00+00:00", "passed": passed, "operator": "anna", "items": [item]}
        (kept / f"{name}.json").write_text(json.dumps(record))
    config = tmp_path / "probewatch.toml"
    config.write_text(f'{GOOD}[alarm]\nfolder = "{folder}"\n')
    return config


def made(cart: Path, *options: str, code: int = 0, of: str | None = "2026-01-15") -> str:
    arguments = ["--config", str(cart), "--folder", str(cart.parent), *([] if of is None else ["--of", of]), *options]
    result = CliRunner().invoke(command, arguments, catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


def body(cart: Path, name: str) -> str:
    """Of the page of that period, as text without markup."""
    (page,) = cart.parent.glob(f"*-{name}.html")
    return re.sub(r"<[^>]+>", " ", page.read_text().split("</style>")[-1])


def test_the_page_holds_everything_and_loads_nothing(cart: Path) -> None:
    made(cart)
    (page,) = cart.parent.glob("*-2026-01.html")
    text = page.read_text()
    assert "mirrored &amp; &lt;b&gt;" in text, "what the log says is text, never markup"
    assert not re.search(r"(src|href)=[\"']?(?!data:)", text)
    for words in ("verified in", "tracker-lost", "recalibration", "anna", "failed", "is whole"):
        assert words in text, words


def test_a_damaged_record_of_a_self_test_is_told_and_ends_as_a_damaged_log_does(cart: Path) -> None:
    """The page had it in red; the terminal, and the unit that writes the report each month, had nothing."""
    (cart.parent / "alarms" / "self-tests" / "c.json").write_text("[]")
    assert "a record of a self-test is damaged, as the top of the report says" in made(cart, code=65)
    assert "c.json cannot be read" in body(cart, "2026-01")


def test_the_axes_of_a_page_are_those_of_its_period(cart: Path) -> None:
    """A day had an axis from 0.6 to 1.4, "day of the day"."""
    heads = {"day": ("2026-01-02", "hour of the day, UTC"), "week": ("2026-W01", "day of the week, 1 is Monday")}
    for kind, (name, axis) in {**heads, "month": ("2026-01", "day of the month")}.items():
        made(cart, "--period", kind, of="2026-01-02")
        (page,) = cart.parent.glob(f"*-{name}.html")
        said = page.read_text()
        assert axis in said
        ticks = re.findall(r'<text class="tick" [^>]*>([^<]*)</text>', said)
        assert ticks
        assert all(tick.isdecimal() for tick in ticks), ticks
        assert '<rect class="a"' in said, "a day on which it ran alone has a bar; a line of one point is none"


def test_the_trend_stands_in_the_report(cart: Path) -> None:
    """The help promised it."""
    made(cart)
    assert "The service has noted no estimates" in body(cart, "2026-01")
    drifting = [
        (24.0 * 25 + hour, "estimate", {"reference": 2, "checks": {"scale-axial": [value, 0.1, 5.0]}})
        for hour, value in enumerate([0.0] * 13 + [2.0] * 13)
    ]
    logged(cart.parent / "alarms", drifting)
    made(cart)
    told = " ".join(body(cart, "2026-01").split())
    assert "Of reference 2, until the end of the period. parameter estimates now limit" in told
    assert "scale-axial 26" in told
    assert "moving" in told
    assert made(cart, of="2026-01-15")
    made(cart, of="2025-12-15")
    assert "scale-axial" not in body(cart, "2025-12"), "what came later is not of it"


def test_a_cart_that_never_ran_is_not_green(cart: Path) -> None:
    made(cart, "--of", "2025-06-15")
    (page,) = cart.parent.glob("*-2025-06.html")
    body = page.read_text().split("</style>")[-1]
    assert "The service did not run" in body
    assert 'class="good"' not in body


def reference(number: int, utc: str) -> Entry:
    made_of = {"file": "/etc/probewatch/probe.toml", "sha256": sha256_of(b"%d" % number), "image_size_px": (640, 480)}
    return Entry(
        number=number, origin="configuration", utc=utc, software="1", probe="Probe", simulated=False, **made_of
    )


def test_the_calibration_in_force_is_told_though_it_came_in_force_before(cart: Path) -> None:
    """The first one of a cart comes in force without a word in the log."""
    entries = tuple(reference(n, f"{utc}T08:00:00+00:00") for n, utc in ((1, "2025-12-24"), (2, "2026-02-01")))
    contents = {one.sha256: b"%d" % one.number for one in entries}
    write_history(cart.parent / "alarms", History(entries=entries), contents)
    months = (("2026-01", [1]), ("2026-02", [1, 2]), ("2025-11", []))
    for name, told in months:
        made(cart, "--of", f"{name}-15")
        (page,) = cart.parent.glob(f"*-{name}.html")
        assert [
            int(number) for number in re.findall(r"<td class=\"figure\">(\d+)</td><td>20", page.read_text())
        ] == told


def test_a_store_without_the_reference_that_the_log_names_is_not_none_in_force(cart: Path) -> None:
    """Its folder was removed: the report said green that none was in force."""
    alarms, kept = cart.parent / "alarms", reference(1, "2025-12-24T08:00:00+00:00")
    named = {"number": 1, "sha256": kept.sha256, "file": "probe.toml", "origin": "configuration"}
    logged(alarms, [(31 * 24 + 6, "started", {"software": "probewatch 2", "reference": named})])
    told = made(cart, code=65)
    assert f"the alarm log names reference 1, SHA-256 {kept.sha256[:12]}…, which the store does not hold" in told
    assert "The store of references is DAMAGED" in body(cart, "2026-01")
    assert "None was in force" not in body(cart, "2026-01")
    write_history(alarms, History(entries=(kept,)), {kept.sha256: b"1"})
    made(cart)


def test_a_reference_that_is_being_written_is_no_damage(cart: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A service logs it first; a report made between both said that the store is damaged."""
    alarms, kept = cart.parent / "alarms", reference(1, "2025-12-24T08:00:00+00:00")
    named = {"number": 1, "sha256": kept.sha256, "file": "probe.toml", "origin": "configuration"}
    logged(alarms, [(31 * 24 + 6, "started", {"software": "probewatch 2", "reference": named})])
    looks = iter([lambda: None, lambda: write_history(alarms, History(entries=(kept,)), {kept.sha256: b"1"})])
    monkeypatch.setattr("probewatch.tools.commands.report.time.sleep", lambda _: next(looks)())
    monkeypatch.setattr("probewatch.tools.commands.report.is_running", lambda _: True)
    assert "damaged" not in made(cart)
    assert "DAMAGED" not in body(cart, "2026-01")
    assert next(looks, None) is None, "it was read again until it was there"


def test_each_calibration_is_told_with_the_time_for_which_it_was_in_force(cart: Path) -> None:
    entries = tuple(reference(n, f"{utc}T08:00:00+00:00") for n, utc in ((1, "2025-12-24"), (2, "2026-01-20")))
    contents = {one.sha256: b"%d" % one.number for one in entries}
    write_history(cart.parent / "alarms", History(entries=entries), contents)
    made(cart)
    told = " ".join(body(cart, "2026-01").split())
    assert "1 2025-12-24 08:00 2026-01-20 08:00 never configuration probe.toml" in told
    assert "2 2026-01-20 08:00 still in force never configuration probe.toml" in told
    assert "/etc/probewatch" not in told, "a name tells the file; the path is the cart's own"


def test_the_limits_that_an_ok_was_held_to_are_told_with_their_time(tmp_path: Path) -> None:
    clinical, tighter = {"profile": "clinical", "beside": {}}, {"profile": "clinical", "beside": {"scale_percent": 2.0}}
    entries = [
        (-5.0, "started", {"software": "probewatch 1"}),
        (3.0, "started", {"software": "probewatch 2", "limits": clinical}),
        (9.0, "started", {"software": "probewatch 2", "limits": clinical}),
        (20.0, "reloaded", {"file": "/etc/p.toml", "limits": tighter}),
        (21.0, "reloaded", {"file": "/etc/p.toml", "limits": 7}),
    ]
    found = summary(period("month", START), read_log(logged(tmp_path, entries)), [], NOW)
    assert [limits_text(entry) for entry in found.limits] == ["", "clinical", "clinical, but for scale_percent 2", ""]
    assert limits_text(found.limits[2], "de") == "clinical, außer scale_percent 2"


def test_a_first_calibration_is_not_said_to_have_come_in_force_never(cart: Path) -> None:
    """The log has no entry of its own for it: "None came in force" stood below the row that says when it did."""
    kept = reference(1, "2026-02-03T08:00:00+00:00")
    write_history(cart.parent / "alarms", History(entries=(kept,)), {kept.sha256: b"1"})
    made(cart, "--of", "2026-02-15")
    (page,) = cart.parent.glob("*-2026-02.html")
    told = page.read_text()
    assert '<td class="figure">1</td><td>2026-02-03 08:00</td>' in told
    assert "None came in force" not in told
    assert "none took the place of another" in told


@pytest.mark.parametrize("damage", ["history", "content", "missing"])
def test_a_damaged_store_stands_at_the_top_and_the_report_is_written(cart: Path, damage: str) -> None:
    entries = (reference(1, "2025-12-24T08:00:00+00:00"),)
    alarms = cart.parent / "alarms"
    write_history(alarms, History(entries=entries), {entries[0].sha256: b"1"})
    history, content = alarms / "references" / "history.json", alarms / "references" / f"{entries[0].sha256}.toml"
    if damage == "missing":
        history.unlink()
    else:
        hurt = history if damage == "history" else content
        hurt.write_bytes(hurt.read_bytes() + b" 2")
    said = made(cart, code=65)
    assert "store of references is damaged" in said
    top, rest = body(cart, "2026-01").split("Verification", 1)
    assert "store of references is DAMAGED" in top
    assert "Not known, see the top of this report" in rest
    assert "None was in force" not in rest
    assert "No calibration is in force" not in rest


def test_a_check_that_is_overdue_stands_at_the_top(cart: Path) -> None:
    entries = (reference(1, "2025-12-24T08:00:00+00:00"),)
    write_history(cart.parent / "alarms", History(entries=entries), {entries[0].sha256: b"1"})
    made(cart)
    assert "OVERDUE" not in body(cart, "2026-01")
    assert "no date is set" in body(cart, "2026-01")
    cart.write_text(cart.read_text().replace("[calibration]", "[calibration]\ndue_days = 30"))
    made(cart)
    top, rest = body(cart, "2026-01").split("Verification", 1)
    assert "OVERDUE: it is due since 2026-01-23 08:00 UTC" in top
    assert "Next check" not in rest
    assert "is overdue" in rest


def test_a_damaged_log_is_told(cart: Path) -> None:
    (segment,) = (cart.parent / "alarms").glob("alarms-*.jsonl")
    segment.write_text(segment.read_text().replace("mirrored", "mirroreD"))
    said = made(cart, code=65)
    assert "is damaged" in said
    top, rest = body(cart, "2026-01").split("Verification", 1)
    assert "DAMAGED" in top
    assert "it was changed" in top
    assert "NOT whole" in rest


@pytest.mark.parametrize("cut", ["last", "first", "one amid"])
def test_lines_that_were_cut_out_stand_at_the_top_and_end_with_65(cart: Path, cut: str) -> None:
    (segment,) = (cart.parent / "alarms").glob("alarms-*.jsonl")
    lines = segment.read_text().splitlines(keepends=True)
    left = {"last": lines[:-2], "first": lines[2:], "one amid": lines[:5] + lines[6:]}[cut]
    segment.write_text("".join(left))
    made(cart, code=65)
    (page,) = cart.parent.glob("*-2026-01.html")
    assert "DAMAGED" in body(cart, "2026-01").split("Verification", 1)[0]
    assert '<p class="good"' not in page.read_text()


def test_a_write_that_a_power_cut_tore_is_told_and_is_no_damage(cart: Path) -> None:
    (segment,) = (cart.parent / "alarms").glob("alarms-*.jsonl")
    segment.write_text(segment.read_text() + '{"number": 99')
    made(cart)
    assert "no damage" in body(cart, "2026-01")
    assert "DAMAGED" not in body(cart, "2026-01")


def test_a_period_that_is_not_over_says_so_far(cart: Path) -> None:
    today = datetime.now(UTC)
    said = made(cart, of=f"{today:%Y-%m-%d}")
    name = f"{today:%Y-%m}-so-far"
    assert "is not over" in said
    assert f"{name}.html" in said
    assert f"{today:%Y-%m} so far" in body(cart, name)
    made(cart)
    assert "so far" not in body(cart, "2026-01")


def test_a_report_replaces_a_report_and_nothing_else(cart: Path) -> None:
    made(cart)
    (page,) = cart.parent.glob("*-2026-01.html")
    made(cart)
    page.write_text("notes")
    with pytest.raises(ConfigurationError, match="is something else"):
        made(cart)
    assert page.read_text() == "notes"


def test_a_period_in_the_future_is_refused(cart: Path) -> None:
    ahead = datetime.now(UTC) + timedelta(days=40)
    said = made(cart, of=f"{ahead:%Y-%m-%d}", code=2)
    assert f"the month {ahead:%Y-%m} has not begun" in said
    assert not list(cart.parent.glob("*.html"))


def test_which_period_it_takes_by_itself_is_said_with_the_reason(tmp_path: Path) -> None:
    """On the first day of a cart the last month is empty: its log begins after it."""
    now = datetime.now(UTC)
    AlarmLog(tmp_path / "alarms").append(now, 1, "started", {"software": "1"}, None)
    config = tmp_path / "probewatch.toml"
    config.write_text(f'{GOOD}[alarm]\nfolder = "{tmp_path / "alarms"}"\n')
    last = last_period("month", now).name
    said = made(config, of=None)
    for words in (f"last month that is over, {last}", "begins after it", f"--of {now:%Y-%m-%d}"):
        assert words in said, words
        assert words in body(config, last), words


def test_an_alarm_that_began_before_and_one_that_goes_on_are_told(tmp_path: Path) -> None:
    """The report of a month in which a HALT of the month before went on said that there were no alarms."""
    logged(tmp_path, [(30 * 24.0, "state", state("halt", "scale"))])
    february = summary(period("month", START + timedelta(days=40)), read_log(tmp_path), [], NOW)
    (alarm,) = february.alarms
    assert (alarm.begun, alarm.ended) == (START + timedelta(days=30), False)
    assert summary(period("day", START), read_log(tmp_path), [], NOW).alarms == []


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="needs ssh-keygen (openssh-client)")
def test_a_signed_report_verifies_and_a_changed_one_does_not(cart: Path) -> None:
    key = cart.parent / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key], check=True)
    assert "signed" in made(cart, "--sign", str(key))
    (page,) = cart.parent.glob("*-2026-01.html")
    allowed = cart.parent / "allowed"
    allowed.write_text(f"cart {key.with_suffix('.pub').read_text()}")

    def verifies() -> bool:
        verify = ["ssh-keygen", "-Y", "verify", "-f", allowed, "-I", "cart", "-n", "probewatch-report", "-s"]
        with page.open("rb") as stream:
            return (
                subprocess.run([*verify, f"{page}.sig"], stdin=stream, capture_output=True, check=False).returncode == 0
            )

    assert verifies()
    page.write_text(page.read_text().replace("anna", "otto"))
    assert not verifies()


def test_of_an_earlier_report_no_signature_is_left_and_its_pdf_is_named(cart: Path) -> None:
    """An honest report that was written anew looked forged."""
    made(cart)
    (page,) = cart.parent.glob("*-2026-01.html")
    signature, pdf = cart.parent / f"{page.name}.sig", page.with_suffix(".pdf")
    signature.write_text("of another page")
    pdf.write_bytes(b"%PDF-1.4 of another page")
    assert f"{pdf} is of an earlier report; --pdf writes it anew" in made(cart)
    assert not signature.exists()
    assert pdf.exists()


def test_a_key_that_cannot_sign_is_told(cart: Path) -> None:
    with pytest.raises(ConfigurationError, match="no such key"):
        made(cart, "--sign", str(cart.parent / "none"))
    (cart.parent / "key").write_text("no key")
    with pytest.raises(ConfigurationError, match="cannot sign"):
        made(cart, "--sign", str(cart.parent / "key"))


@pytest.mark.thorough
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium (chromium)")
def test_the_pdf_is_of_a4_pages(cart: Path) -> None:
    made(cart, "--pdf")
    (pdf,) = cart.parent.glob("*-2026-01.pdf")
    content = pdf.read_bytes()
    assert content.startswith(b"%PDF")
    assert re.search(rb"/MediaBox \[0 0 59[45][.\d]* 84[12]", content)


def test_minutes_are_not_told_as_no_hours(cart: Path, tmp_path: Path) -> None:
    """A cart on its first day: of half an hour in tenths of an hour every state would be none."""
    started = [(0.0, "started", {"software": "1"}), (0.01, "state", state("monitoring")), (0.06, "stopped", {})]
    folder = logged(tmp_path / "young", started)
    cart.write_text(f'{GOOD}[alarm]\nfolder = "{folder}"\n')
    made(cart, "--of", "2026-01-01", "--period", "day")
    told = " ".join(body(cart, "2026-01-01").split())
    assert "The service ran for 3 min" in told
    assert "monitoring 3 min 100.0 %" in told


@pytest.mark.parametrize(
    ("ended", "said"),
    [
        ({"for_s": 360}, "for 6 min in all. Each change of the state has its own entry all the same."),
        (
            {"for_s": 360, "repeated": {"warning (scale)": 1}},
            "Meanwhile 1 change of the state has no entry of its own:",
        ),
        (None, "Meanwhile changes of the state may have no entry of their own: times in each state"),
    ],
)
def test_an_overload_is_told_with_as_many_changes_as_are_known(
    tmp_path: Path, ended: dict[str, object] | None, said: str
) -> None:
    """It was "at least 0 changes"."""
    entries = [(1.0, "state", state("monitoring")), (1.1, "overloaded", {"pressure": 0.6})]
    entries += [] if ended is None else [(1.2, "overload-ended", ended)]
    folder = logged(tmp_path / "alarms", [*entries, (6.0, "stopped", {})])
    config = tmp_path / "probewatch.toml"
    config.write_text(f'{GOOD}[alarm]\nfolder = "{folder}"\n')
    made(config, "--period", "day", of=f"{START:%Y-%m-%d}")
    assert said in body(config, f"{START:%Y-%m-%d}")
