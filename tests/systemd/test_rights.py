"""Who may do what: units, users, folders, sockets and the service's own rules, taken together and tried.

systemd's own tools make the users and folders in a system that lies in a folder; real sockets are served there; and a
process with the user and groups of each unit tries everything that there is. What a sandbox hides is read in the unit.
"""

import json
import os
import pwd
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from probewatch.appliance.configuration.config import Alarm, Config, Control, Feed, Recorder
from probewatch.appliance.service.control.rights import Onlookers
from probewatch.appliance.service.control.server import ControlServer
from probewatch.appliance.service.feed.process_host import FeedHost
from probewatch.tools.page.token_socket import Door
from tests.appliance.service.control.test_requests import Desk
from tests.support.rights import CONTENT, CONTROL, DOOR, FEED, PLACES, everything
from tests.systemd.test_unit import FOLDER, UNITS, settings

LOOK_ON = {"status", "feed"}
SHOWN = {*LOOK_ON, "pictures"}
ASKED = {*SHOWN, "requests", "token"}
MAY = {
    "probewatch-metrics": LOOK_ON,
    "probewatch-mqtt": LOOK_ON,
    "probewatch-openigtlink": SHOWN,
    "probewatch-recorder": {*SHOWN, "recordings", "configuration"},
    "probewatch-report": {"alarm log", "reports", "configuration"},
    "probewatch-page": {*SHOWN, "requests", "token", "alarm log", "scans", "configuration"},
    "probewatch": {*SHOWN, "requests", "token", "alarm log", "scans", "configuration"},
}
"""What each unit may, and nothing else. docs/security.md says it in words."""
TECHNICIAN = {*SHOWN, "requests", "token", "alarm log", "recordings", "scans", "configuration"}
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be one user after the other")
needs_tools = pytest.mark.skipif(
    shutil.which("systemd-sysusers") is None or shutil.which("systemd-tmpfiles") is None,
    reason="needs systemd-sysusers and systemd-tmpfiles (systemd)",
)
pytestmark = [needs_root, needs_tools]


@dataclass(frozen=True, slots=True)
class Identity:
    """As whom a process tries. groups: all of them, the first its own."""

    uid: int
    groups: tuple[int, ...]


class Cart:
    """A system in a folder, as the package leaves it once every unit has been started."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for place in ("etc/probewatch", "run", "var/lib/private"):
            (root / place).mkdir(parents=True)
        (root / "var/lib/private").chmod(0o700)
        for tool, file in (("sysusers", "probewatch.sysusers"), ("tmpfiles", "probewatch.tmpfiles")):
            create = ["--create"] if tool == "tmpfiles" else []
            subprocess.run([f"systemd-{tool}", f"--root={root}", *create, str(FOLDER / file)], check=True)
        self.users = {name: int(uid) for name, uid in self._entries("passwd")}
        self.groups = {name: int(gid) for name, gid in self._entries("group")}
        for unit in UNITS:
            self._start(unit)
        for place in PLACES:
            content, holder = self.at(place) / CONTENT, self.at(place).stat()
            content.touch(0o640)
            os.chown(content, holder.st_uid, holder.st_gid)
        (self.at("/etc/probewatch") / CONTENT).chmod(0o644)

    def identity(self, unit: Path) -> Identity:
        """Of its processes: user, group, and every group that either unit or list of users adds."""
        said = settings(unit)
        (user,) = said.get("User", [unit.stem])
        (group,) = said.get("Group", [user])
        names = [group, *" ".join(said.get("SupplementaryGroups", [])).split(), *self.memberships(user)]
        uid = self.users.get(user, DYNAMIC)
        return Identity(uid, tuple(dict.fromkeys(self.groups.get(name, uid) for name in names)))

    def memberships(self, user: str) -> list[str]:
        lines = (line.split(":") for line in (self.root / "etc/group").read_text().splitlines())
        return [name for name, _, _, members in lines if user in members.split(",")]

    def _entries(self, name: str) -> list[tuple[str, str]]:
        lines = (line.split(":") for line in (self.root / "etc" / name).read_text().splitlines())
        return [(line[0], line[2]) for line in lines]

    def _start(self, unit: Path) -> None:
        """Its folders, as systemd makes them; those of a dynamic user lie where only root may pass."""
        said, who = settings(unit), self.identity(unit)
        for kind, above, mode in (("State", "var/lib", "0755"), ("Runtime", "run", "0755")):
            for name in said.get(f"{kind}Directory", []):
                private = kind == "State" and "DynamicUser" in said
                folder = self.root / above / ("private" if private else "") / name
                folder.mkdir(exist_ok=True)
                folder.chmod(int(said.get(f"{kind}DirectoryMode", [mode])[0], 8))
                os.chown(folder, who.uid, who.groups[0])
                if private:
                    (self.root / above / name).symlink_to(f"private/{name}")

    def at(self, place: str) -> Path:
        return self.root / place.removeprefix("/")


DYNAMIC = 61_184
"""The first uid that systemd gives to a DynamicUser=."""
STRANGER = Identity(65_534, (65_534,))


class Sockets:
    """Those that the service and its page make; polled from this thread."""

    def __init__(self, cart: Cart, monkeypatch: pytest.MonkeyPatch, shown: tuple[str, ...] = Feed().viewers) -> None:
        def known(name: str) -> Any:
            return pwd.struct_passwd((name, "x", cart.users[name], 0, "", "/", "/bin/false"))  # KeyError: no such user

        monkeypatch.setattr(pwd, "getpwnam", known)
        onlookers = Onlookers.of(Config.model_construct(control=Control(), feed=Feed(viewers=shown)))
        self._cart = cart
        control, feed, door = (cart.root / place for place in (CONTROL, FEED, DOOR))
        self._requests = Desk(onlookers.refused).requests
        self._names = set(self._requests.names) - {"status"}
        self._feed = FeedHost(feed, "", onlookers.all, onlookers.without_pictures)
        self._control = ControlServer(control, "", onlookers.all)
        self._door = Door(door, "", lambda name: ("token", "url"), onlookers.refused)
        self._feed.tap()
        for path, unit in ((control, "probewatch"), (feed, "probewatch"), (door, "probewatch-page")):
            holder = cart.identity(FOLDER / f"{unit}.service")
            os.chown(path, holder.uid, holder.groups[0])

    def __enter__(self) -> "Sockets":
        self._door.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._door.close()
        self._control.close()
        self._feed.close()

    def found_by(self, who: Identity) -> set[str]:
        """What a process of that identity can do, which this one serves meanwhile."""
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            with suppress(BaseException):
                os.setgroups(who.groups)
                os.setgid(who.groups[0])
                os.setuid(who.uid)
                os.write(writing, json.dumps(sorted(everything(self._cart.root, self._names))).encode())
            os._exit(0)
        os.close(writing)
        while os.waitpid(child, os.WNOHANG) == (0, 0):
            self._control.poll(self._requests.answer)
            self._feed.look_after()
            time.sleep(0.001)
        with os.fdopen(reading) as pipe:
            return set(json.load(pipe))


@contextmanager
def made_cart() -> Iterator[Cart]:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Cart(Path(folder))


@pytest.fixture(scope="module")
def cart() -> Iterator[Cart]:
    with made_cart() as cart:
        yield cart


@pytest.fixture(scope="module")
def sockets(cart: Cart) -> Iterator[Sockets]:
    with pytest.MonkeyPatch.context() as patch, Sockets(cart, patch) as sockets:
        yield sockets


def hidden_by(unit: Path) -> set[str]:
    """Places of which its sandbox takes the sight."""
    return {place.removeprefix("-") for line in settings(unit).get("InaccessiblePaths", []) for place in line.split()}


def sandboxed(unit: Path, found: set[str]) -> set[str]:
    """What is left of it in the unit's sandbox, which lets a dynamic user pass to folders of its own."""
    closed = {PLACES[place] for place in hidden_by(unit)}
    closed |= set() if "AF_UNIX" in " ".join(settings(unit)["RestrictAddressFamilies"]) else ASKED
    return (found - closed) | {PLACES[place] for place in private_places(unit)}


def private_places(unit: Path) -> set[str]:
    said = settings(unit)
    return {f"/var/lib/{name}" for name in said.get("StateDirectory", []) if "DynamicUser" in said}


def test_no_unit_is_forgotten() -> None:
    assert {unit.stem for unit in UNITS} == MAY.keys()


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_each_unit_may_do_what_it_needs_and_nothing_else(cart: Cart, sockets: Sockets, unit: Path) -> None:
    assert sandboxed(unit, sockets.found_by(cart.identity(unit))) == MAY[unit.stem]


def test_a_configuration_that_names_other_viewers_gives_no_unit_more(monkeypatch: pytest.MonkeyPatch) -> None:
    with made_cart() as cart, Sockets(cart, monkeypatch, shown=("probewatch-page",)) as sockets:
        for name in ("openigtlink", "recorder"):
            unit = FOLDER / f"probewatch-{name}.service"
            assert sandboxed(unit, sockets.found_by(cart.identity(unit))) <= MAY[unit.stem], name


@pytest.mark.parametrize("name", ["metrics", "mqtt", "openigtlink"])
def test_who_looks_on_from_the_network_reads_nothing_that_is_stored_even_outside_its_sandbox(
    cart: Cart, sockets: Sockets, name: str
) -> None:
    unit = FOLDER / f"probewatch-{name}.service"
    assert sockets.found_by(cart.identity(unit)) == {*MAY[unit.stem], "configuration"}, (
        "which everybody on the cart may read"
    )


def test_a_technician_may_do_everything_and_a_stranger_nothing(cart: Cart, sockets: Sockets) -> None:
    technician = Identity(STRANGER.uid, (*STRANGER.groups, cart.groups["probewatch"]))
    assert sockets.found_by(technician) == TECHNICIAN
    assert sockets.found_by(STRANGER) == {"configuration"}


def test_what_a_sandbox_hides_is_there_when_the_unit_starts() -> None:
    """Of a path that is not there systemd hides nothing, also when it appears later; a private one is closed anyway."""
    made = {line.split()[1] for line in (FOLDER / "probewatch.tmpfiles").read_text().splitlines() if line[0] == "d"}
    private = {place for unit in UNITS for place in private_places(unit)}
    for unit in UNITS:
        assert hidden_by(unit) <= {*made, *private, "/etc/probewatch"}, unit.name


def test_who_looks_on_as_shipped_is_made_by_sysusers(cart: Cart) -> None:
    assert {*Control().viewers, *Feed().viewers} <= cart.users.keys()


def test_the_places_are_those_of_the_configuration() -> None:
    assert {str(Alarm().folder), str(Recorder().folder)} <= PLACES.keys()
    assert str(Control().socket) == f"/{CONTROL}"
