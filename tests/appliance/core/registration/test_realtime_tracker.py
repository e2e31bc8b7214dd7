"""The keyframe chain on rendered pictures: it follows, hands over, finds again, and says when it lost the picture."""

import numpy as np
import pytest

from probewatch.appliance.core.registration.keyframe import compose
from probewatch.appliance.core.registration.realtime_tracker import RealTimeTracker, Tracked
from probewatch.drivers.samples import Matrix4
from probewatch.drivers.twins.scene.world import World
from tests.support.motions import TRUTH, picture_path
from tests.support.rendered import SMALL, Warp, aspect, moved, rms_px, sweep, true_motion, world

HOME = np.eye(4)
BLACK = np.zeros((240, 320), np.uint8)


def practised(seen: World) -> RealTimeTracker:
    """A tracker that has forgotten the pictures but not the overlay, of which it takes no new view for ten pictures."""
    tracker = RealTimeTracker(aspect(SMALL))
    for k, image in enumerate(sweep(seen, 17)):
        tracker.step(image, k)
    assert tracker.settled
    tracker.restart()
    return tracker


def shown(tracker: RealTimeTracker, seen: World, poses: list[Matrix4], first: int = 100) -> list[Tracked]:
    return [tracker.step(seen.frame_at(pose, first + k), first + k) for k, pose in enumerate(poses)]


def along(px: tuple[float, float], turn_deg: float, frames: int, elevation_mm: float = 0.0) -> list[Matrix4]:
    """Poses from home to the given one, evenly."""
    shares = np.linspace(0, 1, frames + 1)
    return [moved(HOME, SMALL, (s * px[0], s * px[1]), s * turn_deg, s * elevation_mm) for s in shares]


def since(first: Warp, later: Warp) -> Warp:
    """Motion between two places of one path."""
    turned, _ = compose(first, (np.zeros(2), later[1] - first[1]), aspect(SMALL))
    return later[0] - turned, later[1] - first[1]


def test_the_first_picture_starts_a_chain_at_rest() -> None:
    first = RealTimeTracker(aspect(SMALL)).step(world().frame_at(HOME), 7)
    assert (first.chain, first.keyframe, first.registration, first.step) == (1, 7, None, None)
    assert first.reason == "no keyframe yet"
    np.testing.assert_array_equal(first.path[0], 0)


def test_path_and_step_are_the_rendered_motion() -> None:
    seen = world()
    poses = along((8, -5), 0.6, frames=3)
    tracked = shown(practised(seen), seen, poses)
    assert {t.chain for t in tracked} == {tracked[0].chain}
    assert {t.keyframe for t in tracked} == {100}
    assert rms_px(tracked[-1].path, true_motion(poses[0], poses[-1], SMALL), SMALL) <= 0.1
    assert tracked[-1].step is not None
    assert rms_px(tracked[-1].step, true_motion(poses[-2], poses[-1], SMALL), SMALL) <= 0.1


def test_a_new_keyframe_continues_the_path() -> None:
    seen = world()
    tracker, poses = practised(seen), along((24, 12), 2.0, frames=8)
    for k, pose in enumerate(poses):
        tracked = tracker.step(seen.frame_at(pose, 100 + k), 100 + k)
        assert tracked.keyframe == 100 + max(k - 1, 0) // 3 * 3
        if k % 3 == 0:
            tracker.renew_keyframe()
    assert rms_px(tracked.path, true_motion(HOME, poses[-1], SMALL), SMALL) <= 0.15


@pytest.mark.parametrize("seed", [1, pytest.param(3, marks=pytest.mark.thorough)])
def test_sixty_pictures_of_a_sweep_are_followed_within_a_third_of_a_pixel(seed: int) -> None:
    """From the picture on at which the overlay is known; the sweep tilts and drifts out of plane a little."""
    seen = world(seed)
    tracker = RealTimeTracker(aspect(SMALL))
    paths = []
    for k, image in enumerate(sweep(seen, 72)):
        tracked = tracker.step(image, k)
        found = tracked.registration
        if found is not None and (found.correlation < 0.8 or found.overlap < 0.85):
            tracker.renew_keyframe()
        paths.append(tracked.path)
    u_px, alpha_rad = picture_path(TRUTH, np.array([seen.trajectory.pose(k / 30) for k in range(11, 72)]))
    errors = [rms_px(since(paths[11], paths[11 + k]), (u_px[k], alpha_rad[k]), SMALL) for k in range(61)]
    assert np.hypot(*u_px[-1]) > 30, "the probe went somewhere"
    assert errors[-1] <= 0.3
    assert max(errors) <= 0.35


def test_a_leap_within_the_picture_is_found_again() -> None:
    seen = world()
    start, landed = HOME, moved(HOME, SMALL, (70, 0))
    tracked = shown(practised(seen), seen, [start, start, landed])
    assert tracked[-1].chain == tracked[0].chain
    assert rms_px(tracked[-1].path, true_motion(start, landed, SMALL), SMALL) <= 0.1


def test_where_the_keyframe_fades_the_picture_before_takes_its_place() -> None:
    """Slow elevation without anyone asking for a new keyframe: the chain holds."""
    seen = world()
    tracked = shown(practised(seen), seen, along((0, 0), 0, frames=14, elevation_mm=2.8))
    assert {t.chain for t in tracked} == {tracked[0].chain}
    assert len({t.keyframe for t in tracked}) >= 3


def test_another_place_starts_another_chain_and_says_why() -> None:
    seen = world()
    elsewhere = moved(HOME, SMALL, elevation_mm=5.0)
    tracked = shown(practised(seen), seen, [HOME, HOME, elsewhere, elsewhere])
    chains = [t.chain - tracked[0].chain for t in tracked]
    assert chains == [0, 0, 1, 1]
    assert tracked[2].reason == "picture no longer matches the keyframe"
    assert tracked[2].registration is None
    assert tracked[2].step is None
    np.testing.assert_array_equal(tracked[2].path[0], 0)
    assert tracked[3].registration is not None


def test_black_pictures_break_the_chain_once_each_until_tissue_returns() -> None:
    seen = world()
    tracker = practised(seen)
    image = seen.frame_at(HOME, 1)
    tracked = [tracker.step(picture, k) for k, picture in enumerate([image, BLACK, BLACK, image, image])]
    assert [t.chain - tracked[0].chain for t in tracked] == [0, 1, 2, 3, 3]
    assert [t.reason for t in tracked[2:4]] == ["picture without structure"] * 2
    assert tracked[4].registration is not None


def test_a_restart_compares_nothing_across_it() -> None:
    seen = world()
    tracker = practised(seen)
    before = tracker.step(seen.frame_at(HOME, 1), 1)
    tracker.restart()
    after = tracker.step(seen.frame_at(HOME, 2), 2)
    assert after.chain == before.chain + 1
    assert after.registration is None


def test_renewing_before_any_picture_changes_nothing() -> None:
    tracker = RealTimeTracker(aspect(SMALL))
    tracker.renew_keyframe()
    assert tracker.step(world().frame_at(HOME), 1).chain == 1
    assert not tracker.settled


def test_the_anchor_outlives_keyframes_and_chains() -> None:
    """Held against the anchor, the picture is where it truly went, whatever was renewed or lost in between."""
    seen = world()
    tracker, end = practised(seen), moved(HOME, SMALL, (12, 6), 1.0)
    tracker.step(seen.frame_at(HOME, 1), 1)
    tracker.take_anchor()
    way = along((12, 6), 1.0, frames=4)
    for k, pose in enumerate(way):
        tracked = tracker.step(seen.frame_at(pose, 10 + k), 10 + k)
        tracker.renew_keyframe()
    found = tracker.against_anchor()
    assert found is not None
    assert rms_px((found.u_px, found.alpha_rad), true_motion(HOME, end, SMALL), SMALL) <= 0.15
    elsewhere = moved(HOME, SMALL, elevation_mm=5.0)
    assert tracker.step(seen.frame_at(elsewhere, 20), 20).chain == tracked.chain + 1
    assert tracker.against_anchor() is None, "not alike"
    tracker.step(seen.frame_at(HOME, 21), 21)
    back = tracker.against_anchor()
    assert back is not None
    assert rms_px((back.u_px, back.alpha_rad), (np.zeros(2), 0.0), SMALL) <= 0.15


def test_without_an_anchor_there_is_nothing_to_compare() -> None:
    seen = world()
    tracker = RealTimeTracker(aspect(SMALL))
    tracker.take_anchor()
    assert tracker.against_anchor() is None, "no picture yet"
    tracker = practised(seen)
    tracker.step(BLACK, 1)
    tracker.take_anchor()
    assert tracker.against_anchor() is None, "an anchor without structure"
    tracker.step(seen.frame_at(HOME, 2), 2)
    tracker.take_anchor()
    assert tracker.against_anchor() is not None
    tracker.restart()
    tracker.step(seen.frame_at(HOME, 3), 3)
    assert tracker.against_anchor() is None, "forgotten"


@pytest.mark.parametrize("size", [(40, 320), (320, 240), (20, 20), (480, 640)])
def test_a_picture_of_another_size_is_refused(size: tuple[int, int]) -> None:
    tracker = practised(world())
    with pytest.raises(ValueError, match=rf"\({size[0]}, {size[1]}\) px after pictures of \(240, 320\)"):
        tracker.step(np.zeros(size, np.uint8), 50)
