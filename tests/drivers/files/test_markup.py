"""TOML and XML that nobody means: refused before they take memory or time."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.appliance.configuration.config import load_config
from probewatch.appliance.configuration.noise_file import read_noise
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.drivers.errors import ConfigurationError
from probewatch.drivers.files.markup import toml_of, xml_of

ROOT = Path(__file__).parents[3]
DOTTED = ".".join(["a"] * 7900) + " = 1\n"
NESTED = {
    "a key of 7900 parts": DOTTED,
    "the same with blanks": ".".join([" a "] * 3900) + " = 1\n",
    "quoted parts": ".".join(['"a.b"'] * 2600) + " = 1\n",
    "a heading": "[" + ".".join(["a"] * 7900) + "]\n",
    "behind a text that ends in quotes": 'b = """x"""""\n' + DOTTED,
    "behind a text with quotes in it": "b = '\"'\n" + DOTTED,
    "behind a comment with a quote": '# "\n' + DOTTED,
    "in an inline table": "b = { " + DOTTED.strip() + " }\n",
    "lists": "a = " + "[" * 7900 + "]" * 7900 + "\n",
    "inline tables": "a = " + "{a=" * 3900 + "1" + "}" * 3900 + "\n",
}
LONG_NUMBERS = {
    "hexadecimal": f"version = 0x{'f' * 4000}\n",
    "binary": f"version = 0b{'1' * 15_000}\n",
    "in a list": f"image_size_px = [0x{'f' * 4000}, 480]\n",
    "in a section": f"[limits]\nrotation_deg = 0o{'7' * 6000}\n",
    "one bit more than TOML has": f"version = {1 << 63}\n",
}
SPENDS = """
import resource, sys, time
from pathlib import Path
from probewatch.appliance.storage.calibration_file import read_calibration
from probewatch.appliance.configuration.config import load_config
from probewatch.drivers.errors import ConfigurationError
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
began_s = time.process_time()
read = {"config": load_config, "calibration": lambda path: read_calibration(path, (640, 480))}[sys.argv[1]]
try:
    read(Path(sys.argv[2]))
except ConfigurationError as error:
    print(error, file=sys.stderr)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, time.process_time() - began_s)
"""


def spent(kind: str, path: Path) -> tuple[float, float]:
    """(kB of memory, s of the processor) that reading it took beyond what the program takes anyway."""
    command = [sys.executable, "-c", SPENDS, kind, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True, timeout=60)
    assert str(path) in done.stderr, "it is refused by name"
    kilobytes, seconds = map(float, done.stdout.split())
    return kilobytes, seconds


@pytest.mark.parametrize("text", NESTED.values(), ids=NESTED)
def test_nesting_that_no_configuration_has_is_refused_before_it_is_built(tmp_path: Path, text: str) -> None:
    path = tmp_path / "nested.toml"
    path.write_text(text)
    for read in (load_config, lambda path: read_calibration(path, (640, 480))):
        began_s = time.thread_time()
        with pytest.raises(ConfigurationError, match=r"a key of more than 8 parts|more than 16 brackets"):
            read(path)
        assert time.thread_time() - began_s < 0.2


@pytest.mark.parametrize("text", LONG_NUMBERS.values(), ids=LONG_NUMBERS)
def test_a_number_too_long_to_be_quoted_is_refused(tmp_path: Path, text: str) -> None:
    """Python prints 4300 digits at most, and TOML has no bound for hexadecimal ones."""
    path = tmp_path / "long.toml"
    path.write_text(text)
    for read in (load_config, read_noise, lambda path: read_calibration(path, (640, 480))):
        with pytest.raises(ConfigurationError, match="a whole number of more than 63 bits"):
            read(path)


@pytest.mark.parametrize("kind", ["config", "calibration"])
def test_sixteen_kilobytes_of_dots_take_no_memory(tmp_path: Path, kind: str) -> None:
    """tomllib keeps every beginning of a dotted key: it took the service to 306 MiB."""
    path = tmp_path / "nested.toml"
    path.write_text(DOTTED)
    kilobytes, _ = spent(kind, path)
    assert kilobytes < 8_000


def test_thousands_of_mistakes_take_no_time_and_a_few_are_told(tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text("".join(f"k{number:05} = 1\n" for number in range(5000)))
    began_s = time.thread_time()
    with pytest.raises(ConfigurationError, match=r"'k00003' is not known.*and [0-9]+ more") as refusal:
        load_config(path)
    assert time.thread_time() - began_s < 0.5
    assert len(str(refusal.value)) < 5000


def test_what_people_write_is_read() -> None:
    text = """
    # a.b.c.d.e.f.g.h.i.j.k = a comment
    site."two.words".'three.more.words' = "a.b.c.d.e.f.g.h.i.j.k [[[[[[[[[[[[[[[[[["   # [[[[[[[[[[[[[[[[[[[[[[
    matrix = [[1.5, 2.5, 3.5, 4.5], [1.5, 2.5, 3.5, 4.5], [1.5, 2.5, 3.5, 4.5], [0.0, 0.0, 0.0, 1.0], [1.1, 1.1, 1.1]]
    long = '''a.b.c.d.e.f.g.h.i.j'''
    address = "192.168.0.1.2.3.4.5.6.7.8.9"
    """
    assert toml_of(text.encode(), 10_000)["site"]["two.words"]["three.more.words"].startswith("a.b.c")
    for file in (ROOT / "config").glob("*.toml"):
        assert toml_of(file.read_bytes(), 64_000)


@settings(max_examples=300, deadline=None)
@given(st.text(alphabet="""a.="'#[]{}\\\n 1,""", max_size=80))
def test_brackets_in_texts_and_comments_hide_nothing(text: str) -> None:
    """However quotes stand before it, a long key that TOML would take for one is refused."""
    for candidate in (text + "\n" + ".".join("b" * 20) + " = 1\n", text + ".".join("b" * 20) + " = 1\n"):
        try:
            found = toml_of(candidate.encode(), 10_000)
        except ValueError:
            continue
        assert "b" not in found, "else it was text or a comment"


DEVICE_SET = """<PlusConfiguration><CoordinateDefinitions>
<Transform From="Image" To="Probe" Matrix="0.08 0 0 1 0 0.07 0 11 0 0 0.1 0 0 0 0 1"/>
</CoordinateDefinitions></PlusConfiguration>"""
DOCTYPE = "<!DOCTYPE a [<!ENTITY b 'bbbbbbbb'><!ENTITY c '&b;&b;&b;&b;'>]>"
ENCODED = {
    "UTF-8": DEVICE_SET.encode(),
    "UTF-8 with a mark": b"\xef\xbb\xbf" + DEVICE_SET.encode(),
}


@pytest.mark.parametrize("data", ENCODED.values(), ids=ENCODED)
def test_a_device_set_is_read(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "set.xml"
    path.write_bytes(data)
    assert read_calibration(path, (640, 480)).image_size_px == (640, 480)


@pytest.mark.parametrize(
    "data",
    [
        (DOCTYPE + DEVICE_SET).encode(),
        (DOCTYPE.lower() + DEVICE_SET).encode(),
        (DOCTYPE + DEVICE_SET).encode("utf-16-le"),
        (DOCTYPE + DEVICE_SET).encode("utf-16-be"),
        (DOCTYPE + DEVICE_SET).encode("utf-16"),
        (f'<?xml version="1.0" encoding="utf-16"?>{DOCTYPE}{DEVICE_SET}').encode("utf-16-le"),
        (f'<?xml version="1.0" encoding="us-ascii"?>{DOCTYPE}{DEVICE_SET}').encode(),
    ],
)
def test_a_document_type_is_refused_in_whatever_encoding(tmp_path: Path, data: bytes) -> None:
    with pytest.raises(ValueError, match=r"DOCTYPE|not well-formed"):
        xml_of(data)
    path = tmp_path / "set.xml"
    path.write_bytes(data)
    with pytest.raises(ConfigurationError, match=str(path)):
        read_calibration(path, (640, 480))


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("<a>" * 300_000, "elements in each other"),
        ("<a>" + "<b/>" * 240_000 + "</a>", "more than 10000 elements"),
        ("<a " + " ".join(f'b{n}=""' for n in range(90_000)) + "/>", "no way from"),
        ("<a>" + "x" * 900_000 + "</a>", "no way from"),
        ("<a>" + "x" * 1_000_000 + "</a>", "too large"),
    ],
    ids=["deep", "many", "attributes", "text", "large"],
)
def test_an_xml_of_a_megabyte_takes_little(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "set.xml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=complaint):
        read_calibration(path, (640, 480))
    kilobytes, seconds = spent("calibration", path)
    assert kilobytes < 40_000
    assert seconds < 1.0


@pytest.mark.parametrize("key", ["video.url", "tracker.url", "calibration.file", "control.socket", "alarm.folder"])
@pytest.mark.parametrize("sign", ["\\u0000", "\\n", "\\u001b", "\\u202e"])
def test_a_control_character_in_a_name_is_refused_by_its_key(tmp_path: Path, key: str, sign: str) -> None:
    values = {"video.url": "sim:/tmp/a", "tracker.url": "ndi:/dev/b", "calibration.file": "c", "alarm.folder": "d"}
    values |= {key: f"sim:/tmp/{sign}x"}
    path = tmp_path / "config.toml"
    path.write_text(
        "".join(f'{name} = "{value}"\n' for name, value in values.items()) + 'output = [{url = "relay:/e"}]'
    )
    section, name = key.split(".")
    with pytest.raises(ConfigurationError, match=rf"\[{section}\] {name} = .*a control character") as refusal:
        load_config(path)
    assert str(refusal.value).isprintable()


WORDS = st.sampled_from(["0", "-1", "nan", "1e999", '"x"', "[]", "{}", "true", "1979-05-27", "10000000000000000000000"])
VALUE = st.one_of(WORDS, st.text(max_size=20).map(lambda text: repr(text).replace("'", '"')))


@settings(max_examples=200, deadline=None)
@given(at=st.integers(0, 60), value=VALUE)
def test_a_configuration_with_anything_in_place_of_a_value_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, at: int, value: str
) -> None:
    lines = (ROOT / "config/probewatch.toml").read_text().splitlines()
    keys = [number for number, line in enumerate(lines) if " = " in line and not line.startswith("#")]
    number = keys[at % len(keys)]
    lines[number] = f"{lines[number].partition(' = ')[0]} = {value}"
    path = tmp_path_factory.getbasetemp() / "changed.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    refusal: ConfigurationError | None = None
    try:
        load_config(path)
    except ConfigurationError as error:
        refusal = error
    assert refusal is None or str(path) in str(refusal)
