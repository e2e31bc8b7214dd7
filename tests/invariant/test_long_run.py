"""Which sequences `make invariant` tries: others for each commit, the same for the same seed and frames anywhere."""

from tests.invariant.__main__ import seed_of, shares


def test_each_commit_tries_other_sequences_and_files_that_differ_from_it_do_not() -> None:
    assert seed_of("fd59fbc") != seed_of("f22c415")
    assert seed_of("fd59fbc+") == seed_of("fd59fbc")


def test_the_gate_keeps_two_processors_busy_and_no_two_shares_try_the_same_seed() -> None:
    """Each takes every so manyth seed from its own on."""
    for frames, count in ((1, 1), (25_000, 2), (100_000, 8)):
        told = shares(frames, 11)
        assert len(told) == count
        assert sum(share.frames for share in told) >= frames
        assert {share.stride for share in told} == {count}
        assert sorted(share.seed for share in told) == list(range(11, 11 + count))
