"""Noise of the residual path: whitening, its parts against closed forms, and what is learned of them."""

import numpy as np
import pytest

from probewatch.appliance.core.path.blocks import BREATHING, MEMORY, PARTS, SLANT, WALK, WAY, WHITE, Blocks
from probewatch.appliance.core.path.noise import LearnedNoise, Noise
from probewatch.drivers.rigid import Array

SIZES = np.array([0.12, 0.05, 0.04, 0.02, 1e-3, 0.5, 0.05])
"""Standard deviations of the parts of a position."""


def blocks(n: int = 90, chains: int = 2) -> Blocks:
    return Blocks.of(np.arange(n) / 30, np.repeat(np.arange(chains), n // chains))


def noise(sizes: Array = SIZES) -> Noise:
    return Noise(np.tile(np.square(sizes), (2, 1)))


def drawn(given: Blocks, elevation_mm: Array, sizes: Array, seed: int) -> Array:
    """(2, m) rows with noise of the given sizes and an offset of 30 mm for each chain."""
    random = np.random.default_rng(seed)
    C = np.tensordot(np.square(sizes), given.parts(elevation_mm), axes=1) + 1e-12 * np.eye(len(given))
    return random.normal(size=(2, len(given))) @ np.linalg.cholesky(C).T + 30.0 * given.chain


def test_a_block_is_the_mean_of_the_pictures_of_a_tenth_of_a_second_in_one_chain() -> None:
    given = Blocks.of(np.array([0.0, 0.03, 0.07, 0.11, 0.14, 0.18, 0.21]), np.array([0, 0, 0, 0, 1, 1, 1]))
    assert given.count.tolist() == [3, 1, 2, 1]
    assert given.chain.tolist() == [0, 0, 1, 1]
    np.testing.assert_allclose(given.means(np.arange(7.0)), [1, 3, 4.5, 6])
    assert len(blocks(1800, 1)) <= 201, "a long window has longer blocks"


def test_whitening_is_generalised_least_squares_with_a_free_offset_per_chain() -> None:
    """rᵀ Σ⁻¹ r, computed apart with each chain's best offset taken off, equals the sum of squared innovations."""
    given, elevation_mm = blocks(), np.linspace(0, 4, 30)
    sizes = SIZES.copy()
    sizes[BREATHING:] = 1e-3, 1e-3
    learned = LearnedNoise(given, given.parts(elevation_mm), noise(sizes))
    path = drawn(given, elevation_mm, sizes, 1)[0]
    weight = np.linalg.inv(np.tensordot(np.square(sizes), given.parts(elevation_mm), axes=1))
    chains = np.stack([given.chain == 0, given.chain == 1]).astype(float)
    offsets = np.linalg.solve(chains @ weight @ chains.T, chains @ weight @ path)
    left = path - offsets @ chains
    assert np.sum(learned.rows[0].white(path) ** 2) == pytest.approx(left @ weight @ left, rel=1e-4)


def test_innovations_of_paths_drawn_from_the_model_are_white_and_colour_undoes_it() -> None:
    given, elevation_mm = blocks(600, 1), 5 * np.sin(np.arange(200) / 20)
    row = LearnedNoise(given, given.parts(elevation_mm), noise()).rows[0]
    path = drawn(given, elevation_mm, SIZES, 2)[0]
    white = row.white(path)[1:]
    assert np.var(white) == pytest.approx(1, abs=0.2)
    assert np.mean(white[1:] * white[:-1]) == pytest.approx(0, abs=0.15)
    np.testing.assert_allclose(row.coloured(row.white(path)), path, atol=1e-6)


def test_the_walks_begin_with_each_chain_and_grow_with_time_and_way() -> None:
    given = blocks()
    parts = given.parts(np.linspace(0, 30, 30))
    same = given.chain[:, None] == given.chain
    assert not parts[WALK][~same].any()
    assert parts[WALK][14, 14] == pytest.approx(1.4, abs=0.02)
    assert parts[WAY][14, 14] == pytest.approx(given.t_s[14] * 10, rel=0.15)


def test_a_slant_is_the_double_integral_of_a_slope_that_forgets_itself_over_three_millimetres() -> None:
    """Numerically, between places 3 and 5 mm from the lowest."""
    ends_mm = ((0, 0), (0, 3), (3, 3), (3, 5), (5, 5), (5, 3), (3, 3))
    z_mm = np.concatenate([np.linspace(*ends, 25) for ends in ends_mm])
    parts = Blocks.of(np.arange(525) / 30, np.zeros(525, dtype=np.int64)).parts(z_mm)
    step = 0.005
    a, b = (np.arange(step / 2, end, step) for end in (3.0, 5.0))
    expected = np.exp(-np.abs(a[:, None] - b) / 3.0).sum() * step**2
    assert parts[SLANT][62, 112] == pytest.approx(expected, rel=2e-3)
    np.testing.assert_allclose(parts[SLANT][62], parts[SLANT][162], atol=1e-9, err_msg="the same place shifts alike")


def test_a_slant_forgets_itself_across_directions_and_tilts_lead_astray_as_ways_do() -> None:
    """Out of the plane and back at another tilt: what is left of the way's error is that of the tilt, both ways."""
    there, back = np.linspace(0, 2, 60), np.linspace(2, 0, 60)
    at_once, tilted = np.concatenate([there, back]), np.repeat([0.0, 20.0], 60)
    given = Blocks.of(np.arange(360) / 30, np.zeros(360, dtype=np.int64))
    alike, apart = given.parts(at_once), given.parts(np.stack([at_once, tilted]))
    assert alike[SLANT][-1, -1] == pytest.approx(0.0, abs=1e-9)
    one_way = alike[SLANT][59, 59]
    tilt = given.parts(tilted)[SLANT][-1, -1]
    assert apart[SLANT][-1, -1] == pytest.approx(2 * one_way + tilt, rel=0.05)
    assert apart[WAY][-1, -1] > alike[WAY][-1, -1] + 15


def test_a_memory_is_of_the_means_of_blocks() -> None:
    """Numerically, as means of many places within each of four blocks of 3, 3, 3 and 1 pictures."""
    given = Blocks.of(np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 9.5]) / 30, np.zeros(10, dtype=np.int64))
    part = given.parts(np.zeros(4))[MEMORY]
    width_s = given.count * 0.1 / 3
    within = (np.arange(200) + 0.5) / 200 - 0.5
    t_s = given.t_s[:, None] + width_s[:, None] * within
    expected = np.exp(-np.abs(t_s[:, None, :, None] - t_s[None, :, None, :]) / 0.15).mean(axis=(2, 3))
    np.testing.assert_allclose(part, expected, rtol=0.02)
    assert part[0, 0] < 0.85 < part[3, 3]


@pytest.mark.parametrize(
    ("part", "size"),
    [(WHITE, 0.2), (WALK, 0.2), (WAY, 0.1), (MEMORY, 0.2), (BREATHING, 2.0)],
    ids=["white", "walk", "way", "memory", "breath"],
)
def test_the_size_of_a_part_is_learned_from_paths_that_hold_it(part: int, size: float) -> None:
    """Twenty seconds, from a start that is wrong by five times; the mean of eight rows."""
    given, elevation_mm = blocks(600, 1), 10 * np.sin(np.arange(200) / 25)
    sizes = np.array([0.05, 0.01, 0.01, 0.012, 1e-3, 1e-3, 1e-3])
    sizes[part] = size
    found = []
    for seed in range(4):
        begun = noise(np.where(np.arange(PARTS) == part, 5 * size, 0.1))
        learned = LearnedNoise(given, given.parts(elevation_mm), begun)
        path = drawn(given, elevation_mm, sizes, seed)
        for _ in range(30):
            learned.learn(path, np.zeros((2, 9, len(given))), np.eye(9))
        found.append(np.sqrt(learned.noise.variances[:, part]))
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(size, rel=0.25)


def test_no_part_is_believed_to_be_nothing() -> None:
    given = blocks(600, 1)
    learned = LearnedNoise(given, given.parts(np.zeros(200)), noise())
    for _ in range(40):
        learned.learn(np.zeros((2, 200)), np.zeros((2, 9, 200)), np.eye(9))
    assert np.sqrt(learned.noise.variances[0, WHITE]) == pytest.approx(0.02)
    assert np.all(learned.noise.variances > 0)


def test_breathing_is_taken_out_of_a_path_and_motion_is_left() -> None:
    given = blocks(600, 1)
    breath = 2 * np.sin(2 * np.pi * given.t_s / 4)
    quick = 0.3 * np.sign(np.sin(40 * given.t_s))
    learned = LearnedNoise(
        given, given.parts(np.zeros(200)), noise(np.array([0.3, 0.01, 0.01, 0.012, 1e-3, 2.0, 1e-3]))
    )
    path = breath + quick
    clean = path - learned.rows[0].tissue(path)
    assert np.std(clean - quick) < 0.15
    assert np.std(clean) > 0.2


@pytest.mark.parametrize("fps", [10, 15, 20, 25, 30, 60])
def test_noise_with_a_memory_is_one_however_few_pictures_a_block_has(fps: int) -> None:
    """A recording of 20 Hz that rests keeps one picture here and three there; replay ended in ValueError."""
    random = np.random.default_rng(fps)
    least = []
    for _ in range(60):
        kept = np.flatnonzero(random.random(3 * fps) < random.uniform(0.2, 1.0))
        t_s = kept / fps
        given = Blocks.of(t_s, np.cumsum(np.diff(t_s, prepend=0.0) > 0.5))
        memory = given.parts(np.zeros(len(given)))[MEMORY]
        least.append(np.linalg.eigvalsh(memory)[0])
        usual = LearnedNoise(given, given.parts(np.zeros(len(given))), noise())
        assert np.isfinite(usual.rows[0].log_volume)
    assert min(least) > 0


def test_blocks_that_do_not_overlap_keep_their_noise_bit_for_bit() -> None:
    given = blocks(90, 1)
    length = given.count / np.median(given.count) * float(np.median(np.diff(given.t_s))) / 0.15
    shared = np.sinh(length / 2) / (length / 2)
    wanted = np.exp(-given.apart_s / 0.15) * np.outer(shared, shared)
    np.fill_diagonal(wanted, 2 * (length - 1 + np.exp(-length)) / length**2)
    np.testing.assert_array_equal(given.parts(np.zeros(len(given)))[MEMORY], wanted)
