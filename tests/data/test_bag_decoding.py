"""Messages read from their bytes are the messages decoded in full, whatever a publisher changes between two of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from dynident.data.formats._bag_decoding import Decoder
from dynident.data.formats._bag_messages import columns_of, numbers_of

STORE = get_typestore(Stores.ROS2_HUMBLE)
KIND = "sensor_msgs/msg/JointState"


def packed(names: Sequence[str], lists: Sequence[Sequence[float]], stamp: int = 5, frame: str = "") -> bytes:
    """Return the bytes of a state of joints."""
    types = STORE.types
    time = types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    header = types["std_msgs/msg/Header"](stamp=time, frame_id=frame)
    arrays = [np.array(values, dtype=np.float64) for values in lists]
    return bytes(STORE.serialize_cdr(types[KIND](header, list(names), *arrays), KIND))


class Counting:
    """Decodes in full, and counts how often."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, data: Any, kind: str) -> Any:
        self.count += 1
        return STORE.deserialize_cdr(data, kind)


def same(found: Any, data: bytes) -> bool:
    true = numbers_of(STORE.deserialize_cdr(data, KIND))
    return found.layout == true.layout and found.stamp == true.stamp and found.values.tobytes() == true.values.tobytes()


@st.composite
def messages(draw: Any) -> bytes:
    names = draw(st.lists(st.sampled_from(["a", "b", "elbow", "é", "joint_1", ""]), max_size=3))
    sizes = [draw(st.sampled_from([len(names), len(names), 0, 2])) for _ in range(3)]
    number = st.floats(width=64)
    lists = [draw(st.lists(number, min_size=size, max_size=size)) for size in sizes]
    return packed(names, lists, draw(st.integers(0, 2**31 * 10**9 - 1)), draw(st.sampled_from(["", "base", "tool"])))


@given(st.lists(messages(), min_size=1, max_size=4))
def test_every_message_is_what_the_full_decoder_makes_of_it(stream: list[bytes]) -> None:
    decode = Decoder(STORE.deserialize_cdr)
    for data in stream * 2:
        assert same(decode(data, "/joint_states", KIND), data)


def test_only_the_first_of_a_kind_is_decoded_in_full() -> None:
    counting = Counting()
    decode = Decoder(counting)
    generator = np.random.default_rng(1)
    for stamp in range(20):
        arm = packed(("shoulder", "elbow"), generator.normal(size=(3, 2)), stamp * 10**9 + 7, "base")
        hand = packed(("finger",), [generator.normal(size=1), (), generator.normal(size=1)], stamp)
        for data in (arm, hand):
            assert same(decode(data, "/joint_states", KIND), data)
    assert counting.count == 2


def test_joints_that_change_their_places_are_seen() -> None:
    decode = Decoder(STORE.deserialize_cdr)
    first, second = (packed(names, [[1, 2], [], [3, 4]]) for names in (("aa", "bb"), ("bb", "aa")))
    for data, joint in ((first, "aa"), (second, "bb"), (first, "aa")):
        found = decode(data, "/joint_states", KIND)
        assert dict(zip(columns_of(found.layout), found.values, strict=True))[f"{joint}.effort"] == 3.0


def test_bytes_that_are_laid_out_in_another_way_are_decoded_in_full() -> None:
    counting = Counting()
    decode = Decoder(counting)
    types = STORE.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](1, 2), "")
    message = types[KIND](header, ["a"], np.ones(1), np.ones(1), np.ones(1))
    data = bytes(STORE.serialize_cdr(message, KIND, little_endian=False))
    for _ in range(3):
        found = decode(data, "/joint_states", KIND)
        assert found.stamp == 1_000_000_002 and found.values.tolist() == [1.0, 1.0, 1.0]
    assert counting.count == 3
