"""The Debian package: first start, upgrade, remove, purge, and a configuration that cannot be used."""

import re
import time

from tests.cart.bench import CONFIG, UNIT, journal, show, wait_status
from tests.cart.container import Container
from tests.support.polling import until

PACKAGE = "/probewatch.deb"


def test_after_installation_it_runs_unverified_and_says_what_to_do(container: Container) -> None:
    wait_status(container, "not verified, alarm on: not configured yet.", 30)
    shown = container.sh(f"systemctl status {UNIT} --no-pager").out
    assert f"Run: probewatch configure {CONFIG}" in shown
    assert container.sh("stat -c '%U %G %a' /var/lib/probewatch").out.split() == ["probewatch", "probewatch", "750"]
    assert container.sh("probewatch --version").code == 0
    exposure = container.sh(f"systemd-analyze security {UNIT} --no-pager | tail -n 1").out
    print(exposure.strip())
    assert float(re.search(r"probewatch\.service: ([0-9.]+)", exposure)[1]) <= 1.5
    (entry,) = journal(container, UNIT, "PROBEWATCH_EVENT='not configured'")
    assert (entry["PROBEWATCH_FILE"], entry["PRIORITY"]) == (CONFIG, "4")


def test_upgrade_keeps_what_the_technician_wrote(container: Container) -> None:
    wait_status(container, "not verified", 30)
    before = show(container, "MainPID")
    container.sh(f"echo '# ours' >>{CONFIG}; touch /var/lib/probewatch/kept")
    container.sh(
        f"dpkg-deb -R {PACKAGE} /var/next && sed -i 's/^Version:.*/Version: 99/' /var/next/DEBIAN/control"
        " && dpkg-deb -Znone --build /var/next /var/next.deb && dpkg -i /var/next.deb",
        timeout_s=180,
    )
    assert container.sh("dpkg-query -W -f '${Version} ${Status}' probewatch").out == "99 install ok installed"
    assert container.sh(f"tail -n 1 {CONFIG}").out == "# ours\n"
    assert "kept" in container.sh("ls /var/lib/probewatch").out.split()
    wait_status(container, "not verified", 30)
    assert show(container, "MainPID") != before, "the new version runs"


def test_remove_keeps_configuration_and_state_and_purge_keeps_the_audit_trail_unless_asked(
    container: Container,
) -> None:
    wait_status(container, "not verified", 30)
    container.sh("touch /var/lib/probewatch/kept")
    container.sh("dpkg -r probewatch", timeout_s=120)
    assert container.sh(f"systemctl is-active {UNIT}", check=False).out.strip() != "active"
    container.sh(f"test -f {CONFIG} && test -f /var/lib/probewatch/kept && test ! -e /usr/bin/probewatch")
    left = container.sh("find /opt/probewatch 2>/dev/null | head", check=False).out
    assert left == "", left
    container.sh("dpkg -P probewatch </dev/null", timeout_s=120)
    container.sh("test ! -e /etc/probewatch && test -f /var/lib/probewatch/kept")
    container.sh(f"dpkg -i {PACKAGE}", timeout_s=180)
    wait_status(container, "not verified", 30)
    container.sh("PROBEWATCH_PURGE_AUDIT_TRAIL=yes dpkg -P probewatch", timeout_s=120)
    container.sh("test ! -e /etc/probewatch && test ! -e /var/lib/probewatch")


def test_a_configuration_that_cannot_be_used_fails_once_with_words(container: Container) -> None:
    wait_status(container, "not verified", 30)
    container.put(CONFIG, '[video]\nurl = "sim:/x"\n[tracker]\nurl = "ndi:/dev/ttyUSB0"\n[limits]\nscale_procent = 3\n')
    container.sh(f"systemctl restart {UNIT}", check=False)
    time.sleep(2)
    assert show(container, "ActiveState") == "failed"
    assert show(container, "ExecMainStatus") == "78"
    assert show(container, "NRestarts") == "0"
    shown = container.sh(f"systemctl status {UNIT} --no-pager", check=False).out
    assert "scale_procent is not known. Did you mean 'scale_percent'?" in shown
    assert "Traceback" not in shown


def test_once_configured_it_goes_on_by_itself(container: Container) -> None:
    wait_status(container, "not verified", 30)
    container.sh(f"sed -i 's/^configured = false/configured = true/' {CONFIG}")
    until(lambda: show(container, "ExecMainStatus") == "78", 20, container.look_s)
    shown = container.sh(f"systemctl status {UNIT} --no-pager", check=False).out
    assert "calibration.toml" in shown, "the calibration is still to be made, and that is what it says"
