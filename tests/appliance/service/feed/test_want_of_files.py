"""A process without a free descriptor. No thread of another test may be open here: it would want descriptors too."""

import resource
from pathlib import Path

from probewatch.appliance.service.feed.process_host import FeedHost
from tests.support.descriptors import leaves_nothing_open, open_files


def test_where_files_run_out_the_estimator_goes_before_the_feed(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    with leaves_nothing_open():
        feed = FeedHost(tmp_path / "feed")
        opened = len(open_files())
        try:
            for more in range(8):
                resource.setrlimit(resource.RLIMIT_NOFILE, (opened + more, before[1]))
                tap = feed.tap()
                assert tap is None or more >= 5
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, before)
        assert feed.tap() is not None
        feed.close()
