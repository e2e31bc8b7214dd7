"""What scanners and grabbers do to pictures."""

import numpy as np
import pytest

from probewatch.drivers.twins.scene.processing import Processing, ProcessingScanner

RANDOM = np.random.default_rng(1).integers(0, 256, (60, 80), np.uint8)


def test_nothing_is_done_unless_it_is_asked_for():
    scanner = ProcessingScanner(Processing())
    assert scanner.grabbed(scanner.processed(RANDOM)) is RANDOM


def test_of_the_last_picture_its_share_stays():
    scanner = ProcessingScanner(Processing(persistence=0.6))
    full, empty = np.full((4, 4), 250, np.uint8), np.zeros((4, 4), np.uint8)
    shown = [int(scanner.processed(picture)[0, 0]) for picture in (full, empty, empty, empty)]
    assert shown == [250, 150, 90, 54]
    scanner.off()
    assert scanner.processed(empty).max() == 0


def test_smoothing_takes_the_grain_and_leaves_the_border():
    grain = np.random.default_rng(2).integers(-9, 10, (60, 80))
    picture = (np.where(np.arange(80) < 40, 60, 180) + grain).astype(np.uint8)
    smooth = ProcessingScanner(Processing(smoothed=True)).processed(picture).astype(float)
    assert smooth[:, :38].std() < 0.6 * picture[:, :38].std()
    assert smooth[:, 41].mean() - smooth[:, 38].mean() == pytest.approx(120, abs=4)


def test_jpeg_spoils_a_picture_a_little():
    picture = np.clip(np.add.outer(np.arange(60), np.arange(80)), 0, 255).astype(np.uint8)
    coded = ProcessingScanner(Processing(jpeg=40)).grabbed(picture)
    assert not np.array_equal(coded, picture)
    assert coded.astype(float) == pytest.approx(picture.astype(float), abs=12)
