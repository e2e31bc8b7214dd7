"""Codecs of the NDI protocol: what is encoded is decoded."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from probewatch.drivers.trackers.ndi.bx import decode_bx, encode_bx
from probewatch.drivers.trackers.ndi.replies import (
    ActiveStray,
    HandleState,
    Markers,
    Options,
    ToolInformation,
    ToolReply,
    TrackingReply,
    Transform,
)
from probewatch.drivers.trackers.ndi.tx import decode_tx, encode_tx
from probewatch.drivers.trackers.ndi.wire import (
    decode_text,
    encode_text,
)
from tests.drivers.trackers.ndi.test_wire import positions

quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 0.01)


@st.composite
def transforms(draw: st.DrawFn) -> Transform:
    q = np.asarray(draw(quaternions))
    w, x, y, z = (float(np.float32(v)) for v in q / np.linalg.norm(q))
    return Transform((w, x, y, z), draw(positions), draw(st.floats(0, 9, width=32)))


@st.composite
def markers(draw: st.DrawFn, everywhere: bool) -> Markers:
    outside = tuple(draw(st.lists(st.booleans(), max_size=20)))
    return Markers(outside, tuple(draw(positions) if everywhere or not out else None for out in outside))


@st.composite
def tracking_replies(draw: st.DrawFn) -> tuple[TrackingReply, int]:
    options = draw(st.integers(0, 15)) | draw(st.sampled_from([0, 0x800, 0x1000, 0x1800])) | Options.POSE
    everywhere = bool(options & Options.OUT_OF_VOLUME)
    u32 = st.integers(0, 2**32 - 1)
    replies = []
    for handle in draw(st.lists(st.integers(1, 255), unique=True, max_size=4)):
        state = draw(st.sampled_from([HandleState.VALID, HandleState.MISSING, HandleState.DISABLED]))
        if state is HandleState.DISABLED:
            replies.append(ToolReply(handle, state))
            continue
        nibbles = tuple(draw(st.lists(st.integers(0, 5), min_size=20, max_size=20)))
        replies.append(
            ToolReply(
                handle,
                state,
                draw(transforms()) if state is HandleState.VALID else None,
                draw(u32),
                draw(u32),
                ToolInformation(draw(st.integers(0, 255)), nibbles) if options & Options.TOOL_INFORMATION else None,
                ActiveStray(1, draw(positions)) if options & Options.ACTIVE_STRAY else None,
                draw(markers(everywhere)) if options & Options.TOOL_MARKERS else None,
            )
        )
    strays = draw(markers(everywhere)) if options & Options.PASSIVE_STRAYS else None
    return TrackingReply(tuple(replies), draw(st.integers(0, 65535)), strays), int(options)


@given(tracking_replies())
@settings(max_examples=60, deadline=None)
def test_bx_round_trip(case: tuple[TrackingReply, int]) -> None:
    reply, options = case
    assert decode_bx(encode_bx(reply, options), options) == reply


@given(tracking_replies())
@settings(max_examples=60, deadline=None)
def test_tx_round_trip_is_exact_after_one_rounding(case: tuple[TrackingReply, int]) -> None:
    reply, options = case
    line = encode_tx(reply, options)
    rounded = decode_tx(line, options)
    assert encode_tx(rounded, options) == line
    assert [replace(t, transform=None, stray=None, markers=None) for t in rounded.tools] == [
        replace(t, transform=None, stray=None, markers=None) for t in reply.tools
    ]


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=200))
def test_text_round_trip(text: str) -> None:
    if not text.startswith("ERROR"):
        assert decode_text(encode_text(text)) == text
