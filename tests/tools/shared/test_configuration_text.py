"""A configuration that is changed says what was answered and, in every other line, what it said before."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from probewatch.appliance.configuration.config import config_of
from probewatch.drivers.errors import ConfigurationError
from probewatch.tools.shared.configuration_text import changed, template

EXAMPLE = Path(__file__).parents[3] / "config/probewatch.toml"
FILE = Path("probewatch.toml")


def test_the_template_is_the_commented_example_that_nobody_has_adapted() -> None:
    before, after = EXAMPLE.read_text().splitlines(), template().splitlines()
    assert [line for line in zip(before, after, strict=True) if line[0] != line[1]] == [
        ("# configured = true", "configured = false")
    ]


def test_every_other_line_stays_with_its_comment() -> None:
    text = 'configured = false # yet\n[video]\nurl = "v4l2:/dev/video0"   # with a # in it\n# why\n[alarm]\n'
    new = changed(text, {("configured",): True, ("video", "url"): 'a"#b'}, FILE)
    assert new.splitlines() == [
        "configured = true  # yet",
        "[video]",
        'url = "a\\"#b"              # with a # in it',
        "# why",
        "[alarm]",
    ]


def test_a_key_that_stands_there_as_a_comment_is_taken_where_it_stands() -> None:
    new = changed(EXAMPLE.read_text(), {("alarm", "language"): "de"}, FILE)
    assert 'language = "de"                 # en, de: the operator\'s texts' in new.splitlines()
    assert len(new.splitlines()) == len(EXAMPLE.read_text().splitlines())


def test_a_key_that_is_left_out_becomes_a_comment_and_comes_back_by_it() -> None:
    text = EXAMPLE.read_text()
    without = changed(text, {("calibration", "file"): None}, FILE)
    assert '# file = "calibration.toml"' in without.splitlines()
    assert changed(without, {("calibration", "file"): "calibration.toml"}, FILE) == text
    assert changed(without, {("calibration", "file"): None}, FILE) == without


def test_a_key_or_section_that_nobody_mentions_is_added() -> None:
    new = changed("[video]\nurl = 'a'\n", {("video", "more"): "b", ("alarm", "language"): "de"}, FILE)
    assert tomllib.loads(new) == {"video": {"url": "a", "more": "b"}, "alarm": {"language": "de"}}


def test_a_further_output_stands_behind_the_last_and_before_what_leads_to_the_next_section() -> None:
    text = "[[output]]\nurl = 'a'\n# of it\n\n# of the next\n[alarm]\n"
    new = changed(text, {("output", 1, "url"): "b", ("output", 1, "signal"): "red"}, FILE)
    assert tomllib.loads(new) == {"output": [{"url": "a"}, {"url": "b", "signal": "red"}], "alarm": {}}
    assert new.startswith("[[output]]\nurl = 'a'\n# of it\n\n[[output]]\n")
    assert new.endswith("\n\n# of the next\n[alarm]\n")


@pytest.mark.parametrize(
    "text",
    [
        "[video]\nurl = '''\na'''\n",
        "output = [{ url = 'a' }]\nvideo.url = 'a'\n[alarm]\n",
        "alarm.folder = 'x'\nvideo.url = 'a'\n",
        'video = { url = "a" }\n',
    ],
)
def test_a_layout_that_cannot_be_kept_is_refused_and_not_half_changed(text: str) -> None:
    answers = {("video", "url"): "v", ("output", 0, "url"): "o", ("alarm", "language"): "de"}
    with pytest.raises(ConfigurationError, match=r"cannot be edited line by line.*--fresh"):
        changed(text, answers, FILE)


@given(st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), min_size=1))
def test_whatever_is_printable_arrives_as_it_was_answered(value: str) -> None:
    text = '[calibration]\nfile = "x"  # here\n# probe = "Probe"  # there\n'
    new = changed(text, {("calibration", "file"): value, ("calibration", "probe"): value}, FILE)
    assert tomllib.loads(new)["calibration"] == {"file": value, "probe": value}


def test_a_changed_template_is_a_configuration() -> None:
    answers = {("configured",): True, ("video", "url"): "sim:/x", ("tracker", "url"): "ndi:/y"}
    config = config_of(changed(template(), answers, FILE), FILE)
    assert (config.configured, config.video.url, config.tracker.url) == (True, "sim:/x", "ndi:/y")
