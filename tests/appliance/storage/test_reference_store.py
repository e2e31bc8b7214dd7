"""Which reference is in force outlives restarts, power cuts and full disks; a damaged store is refused by name."""

import errno
import os
import signal
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from probewatch.appliance.service.control.references import References
from probewatch.appliance.storage import reference_store
from probewatch.appliance.storage.alarm_log import AlarmLog
from probewatch.appliance.storage.reference import in_force
from probewatch.appliance.storage.reference_store import HISTORY, read_history, set_aside
from probewatch.appliance.types import Check, Fault, Verdict, VerdictKind
from probewatch.drivers.errors import ConfigurationError
from tests.support.polling import until
from tests.support.stores import (
    PLUS,
    SIZE_PX,
    calibration,
    configuration,
    forge,
    kept,
    log,
    place,
    settled,
    started,
    written,
)

pytestmark = pytest.mark.usefixtures("log")
__all__ = ["log"]


def second(config, *shift_mm):
    """A store in which a second reference, 1 mm away, has taken the place of the configured one."""
    references = started(config)
    new = written(config.calibration.file.with_name("new.toml"), *(shift_mm or (0, 0, 1)))
    references.take(references.from_content(new.read_bytes(), str(new)), "recalibration", "anna", "moved by 1 mm")
    return settled(references)


def test_the_configured_file_is_the_first_reference(tmp_path):
    config = configuration(tmp_path)
    references = settled(started(config))
    (entry,) = kept(config).entries
    assert references.current.entry == entry
    assert (entry.number, entry.origin, entry.file) == (1, "configuration", str(tmp_path / "probe.toml"))
    content = (place(config) / f"{entry.sha256}.toml").read_bytes()
    assert content == config.calibration.file.read_bytes()


def test_a_restart_goes_on_with_what_was_in_force_not_with_the_configured_file(tmp_path):
    config = configuration(tmp_path)
    second(config)
    references = settled(started(config))
    assert references.current.entry.number == 2
    assert references.current.calibration.offset_mm[2] == pytest.approx(4.0)
    assert references.changed is None, "the configured file is as it was when a person decided"


def test_it_goes_on_without_the_files_that_the_references_came_from(tmp_path):
    config = configuration(tmp_path)
    second(config)
    (tmp_path / "new.toml").unlink()
    assert settled(started(config)).current.calibration.offset_mm[2] == pytest.approx(4.0)


def verified(config):
    references = started(config)
    references.note_verified()
    until(lambda: kept(config).configured_sha256)
    return settled(references)


def looked(config):
    """What a start says of the configured file, once it has looked."""
    references = started(config)
    until(lambda: not references._look)
    return settled(references)


def test_an_edited_configured_file_is_named_and_not_taken(tmp_path):
    config = configuration(tmp_path)
    verified(config)
    written(tmp_path / "probe.toml", 5, 0, 0)
    references = looked(config)
    assert references.current.entry.number == 1
    assert references.current.calibration.offset_mm[0] == pytest.approx(1.0)
    assert references.changed == f"{tmp_path}/probe.toml was changed, and is not in force"


def test_a_configured_file_that_is_gone_is_named_too(tmp_path):
    config = configuration(tmp_path)
    verified(config)
    (tmp_path / "probe.toml").unlink()
    assert "No such file" in looked(config).changed


def test_a_configuration_that_returns_to_an_old_file_is_named(tmp_path):
    config = configuration(tmp_path)
    verified(config)
    second(config)
    verified(config)
    assert looked(config).changed is None
    assert looked(configuration(tmp_path, "new.toml")).changed is None, "it names what is in force"
    assert "probe.toml was changed" in looked(configuration(tmp_path)).changed


def named(config, file):
    """The configuration of the same cart with that calibration."""
    return config.model_copy(update={"calibration": config.calibration.model_copy(update={"file": file})})


NONE_ANY_MORE = "the configuration names no calibration any more, and reference 1 stays in force"


def test_a_configuration_that_names_no_calibration_any_more_is_named(tmp_path, log):
    """It was silent: `configure --no-calibration` went on with the reference in force."""
    config = configuration(tmp_path)
    verified(config)
    assert looked(named(config, None)).changed == NONE_ANY_MORE
    assert "configured calibration is not in force" in log.getvalue()
    assert "probewatch calibration use FILE" in log.getvalue()


def test_motion_that_verifies_the_configured_reference_is_no_decision_about_another_file(tmp_path):
    config = configuration(tmp_path)
    settled(started(config))
    verified(named(config, None))
    assert looked(named(config, None)).changed == NONE_ANY_MORE


def test_of_a_cart_that_never_named_one_or_whose_reference_was_chosen_since_it_says_nothing(tmp_path):
    config = configuration(tmp_path)
    unnamed = named(config, None)
    references = started(unnamed)
    references.take(references.from_content(config.calibration.file.read_bytes(), "scan"), "recalibration")
    settled(references)
    assert looked(unnamed).changed is None
    verified(unnamed)
    assert looked(unnamed).changed is None
    (tmp_path / "probe.toml").unlink()
    assert "No such file" in looked(config).changed, "named again, it is compared"


@pytest.mark.parametrize("bytes_left", [0, 10, 200])
def test_a_history_that_was_cut_is_refused_by_name(tmp_path, bytes_left):
    config = configuration(tmp_path)
    second(config)
    os.truncate(place(config) / HISTORY, bytes_left)
    with pytest.raises(ConfigurationError, match=r"history\.json.*probewatch calibration reset") as refusal:
        References(config)
    assert refusal.value.exit_code == 78


def flip(file: Path) -> None:
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


def test_no_damage_falls_back_to_another_reference(tmp_path):
    """Every file of the store flipped in one bit, emptied and removed."""
    for damage in (flip, lambda file: file.write_bytes(b""), Path.unlink):
        for name in ("history", "content"):
            folder = tmp_path / f"{damage.__name__}-{name}".replace("<", "").replace(">", "")
            folder.mkdir()
            config = configuration(folder)
            second(config)
            in_use = kept(config).in_force
            damage(place(config) / (HISTORY if name == "history" else f"{in_use.sha256}.toml"))
            with pytest.raises(ConfigurationError, match="which calibration is in force is not known"):
                References(config)


@pytest.mark.parametrize(
    "changes",
    [{"v": 2}, {"entries": [{}]}, {"entries": 7}, {"surprise": 1}, {"entries": [{"number": 2}]}],
)
def test_a_history_of_another_kind_is_refused(tmp_path, changes):
    config = configuration(tmp_path)
    second(config)
    forge(config, **changes)
    with pytest.raises(ConfigurationError, match="cannot be understood"):
        References(config)


def test_a_reference_missing_from_the_middle_is_refused(tmp_path):
    config = configuration(tmp_path)
    second(config)
    forge(config, entries=[kept(config).entries[1].model_dump(mode="json")])
    with pytest.raises(ConfigurationError, match="not numbered from 1"):
        References(config)


def test_a_store_that_is_gone_is_missed_by_the_alarm_log(tmp_path):
    config = configuration(tmp_path)
    second(config)
    data = {"reference": {"number": 2, "origin": "recalibration", "sha256": "ab" * 32}}
    AlarmLog(config.alarm.folder).append(datetime.now(UTC), 1, "started", data, None)
    place(config).rename(tmp_path / "elsewhere")
    with pytest.raises(ConfigurationError, match=r"alarm log says that reference 2 \(recalibration"):
        References(config)
    set_aside(config.alarm.folder)
    assert settled(started(config)).current.entry.origin == "configuration", "a person has started again"


def test_a_damaged_store_set_aside_is_kept_and_begins_again(tmp_path):
    config = configuration(tmp_path)
    second(config)
    flip(place(config) / HISTORY)
    aside = set_aside(config.alarm.folder)
    assert (aside / HISTORY).exists()
    assert [entry.number for entry in kept(configuration(tmp_path)).entries] == []
    assert settled(started(config)).current.entry.number == 1


WRITER = """
import itertools, sys
from pathlib import Path
from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.service.control.references import References
config = load_config(Path(sys.argv[1]))
references = References(config)
references.begin()
files = [Path(sys.argv[2]), Path(sys.argv[3])]
for number in itertools.count():
    file = files[number % 2]
    taken = references.take(references.from_content(file.read_bytes(), str(file)), "recalibration")
    while not references.on_disk:
        pass
    print(taken.entry.number, taken.entry.sha256, flush=True)
"""


@pytest.mark.thorough
def test_what_was_said_to_be_on_the_disk_is_in_force_after_a_kill(tmp_path):
    """Killed at five moments of its writing; the reference is the last acknowledged one or the one being written."""
    config = configuration(tmp_path)
    files = [written(tmp_path / f"{name}.toml", 0, 0, shift) for name, shift in (("a", 1), ("b", 2))]
    last = 0
    for cut in range(5):
        command = [sys.executable, "-c", WRITER, str(tmp_path / "probewatch.toml"), *map(str, files)]
        writer = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        lines = [writer.stdout.readline()]
        time.sleep(0.004 * cut)
        writer.send_signal(signal.SIGKILL)
        lines += writer.communicate()[0].splitlines()
        number, sha256 = [line.split() for line in lines if line.count(" ") == 1][-1]
        now = kept(config).in_force
        assert now.number in (int(number), int(number) + 1)
        assert now.number > last
        assert now.number != int(number) or now.sha256 == sha256
        last = now.number


def test_every_write_is_on_the_disk_before_the_next(tmp_path, monkeypatch):
    """Folder and file are synchronised, the content before the history that names it."""
    order = []
    real = reference_store._write

    def noted(file, content):
        real(file, content)
        order.append(file.name)

    monkeypatch.setattr(reference_store, "_write", noted)
    config = configuration(tmp_path)
    settled(started(config))
    assert order[0] == HISTORY, "an empty history comes first"
    assert order[1:3] == [f"{kept(config).in_force.sha256}.toml", HISTORY]


def ok(*names):
    checks = tuple(Check(name, Fault.SCALE, 0, 0, "", 1, VerdictKind.OK) for name in names)
    return (Verdict(0, VerdictKind.OK, checks),)


def test_a_reference_that_is_not_on_the_disk_is_not_verified(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    config = configuration(tmp_path)
    references = started(config)
    assert references.judged(ok())[0].kind is VerdictKind.OK
    monkeypatch.setattr("probewatch.appliance.service.control.references.RETRY_S", 0.02)
    with monkeypatch.context() as patch:
        patch.setattr("probewatch.appliance.service.control.references.write_history", full)
        new = written(tmp_path / "new.toml", 0, 0, 1)
        references.take(references.from_content(new.read_bytes(), str(new)), "recalibration")
        until(lambda: "No space" in str(references.waits))
        (verdict,) = references.judged(ok())
        assert verdict.kind is VerdictKind.NOT_VERIFIED
        assert "not on the disk yet (No space" in verdict.reason
    until(lambda: references.on_disk)
    assert references.judged(ok())[0].kind is VerdictKind.OK
    settled(references)


def test_a_history_that_could_not_be_read_again_is_not_written(tmp_path, monkeypatch):
    """Thousands of references, whose files have long names: the next start was refused."""
    config = configuration(tmp_path)
    settled(started(config))
    monkeypatch.setattr(reference_store, "_MAX_HISTORY_BYTES", (place(config) / HISTORY).stat().st_size + 200)
    references = started(config)
    new = written(tmp_path / "new.toml", 0, 0, 1)
    references.take(references.from_content(new.read_bytes(), str(new)), "recalibration")
    until(lambda: "is full; begin another" in str(references.waits))
    assert references.judged(ok())[0].kind is VerdictKind.NOT_VERIFIED
    references.close()
    assert settled(started(config)).current.entry.number == 1


def test_a_far_reference_must_show_everything_also_after_a_restart(tmp_path):
    config = configuration(tmp_path)
    references = started(config)
    far = written(tmp_path / "far.toml", 0, 0, 30)
    everything = ("polarity", "offset-elevational")
    references.take(references.from_content(far.read_bytes(), str(far)), "recalibration", to_show=everything)
    settled(references)
    references = started(config)
    (verdict,) = references.judged(ok("polarity"))
    assert verdict.kind is VerdictKind.NOT_VERIFIED
    assert verdict.reason == "reference: it is far from the one before, and of it is not shown yet: offset-elevational"
    assert references.judged(ok(*everything))[0].kind is VerdictKind.OK
    references.note_verified()
    assert references.judged(ok("polarity"))[0].kind is VerdictKind.OK, "shown once, watched as usual from then on"
    settled(references)
    assert kept(config).in_force.verified_utc is not None


@pytest.mark.parametrize("by_configuration", [True, False])
def test_a_device_set_gets_its_size_from_the_configuration_or_the_first_picture(tmp_path, by_configuration):
    (tmp_path / "set.xml").write_text(PLUS)
    more = "calibration.image_size_px = [800, 600]\n" if by_configuration else ""
    config = configuration(tmp_path, "set.xml", more=more)
    references = started(config)
    if not by_configuration:
        assert "no picture has come yet" in references.waits
        assert references.judged(ok())[0].kind is VerdictKind.NOT_VERIFIED
        references.see((800, 600))
        until(lambda: references.current)
        until(lambda: references.on_disk)
    settled(references)
    again = settled(started(configuration(tmp_path, "set.xml")))
    assert again.current.calibration.image_size_px == (800, 600), "kept for the next start"
    assert in_force(config).calibration.image_size_px == (800, 600)
    assert list(place(config).glob("*.xml"))


def test_a_size_that_a_file_contradicts_is_refused(tmp_path):
    config = configuration(tmp_path, more="calibration.image_size_px = [800, 600]\n")
    with pytest.raises(ConfigurationError, match=rf"image_size_px is \({SIZE_PX[0]}"):
        References(config)


def test_a_simulated_calibration_is_no_reference_of_a_real_cart(tmp_path):
    written(tmp_path / "probe.toml", simulated=True)
    with pytest.raises(ConfigurationError, match="made of a simulated scan"):
        References(configuration(tmp_path))
    assert read_history(tmp_path / "state") is None
    references = started(configuration(tmp_path, video="sim:/tmp/scanner"))
    assert settled(references).current.entry.simulated
    with pytest.raises(ConfigurationError, match="made of a simulated scan"):
        References(configuration(tmp_path))


def test_the_mark_of_a_simulated_calibration_is_written_and_read(tmp_path):
    assert calibration(simulated=True).simulated
    assert "simulated = true" in written(tmp_path / "a.toml", simulated=True).read_text()
    assert "simulated" not in written(tmp_path / "b.toml").read_text()
