"""Rows of bits against NumPy's own bit operations."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from cyclorama import Bitfields, bitfield

SIZES = [0, 1, 63, 64, 65, 127, 128, 1000]
flags_of_rows = hnp.arrays(bool, st.tuples(st.integers(1, 5), st.integers(0, 200)))


def random_flags(rows, size, seed=0, share=0.4):
    return np.random.default_rng(seed).random((rows, size)) < share


def words_by_numpy(flags):
    packed = np.packbits(flags, axis=1, bitorder="little")
    padded = np.zeros((len(flags), bitfield.width(flags.shape[1]) * 8), dtype=np.uint8)
    padded[:, : packed.shape[1]] = packed
    return padded.view("<u8").astype(np.uint64)


@pytest.mark.parametrize("size", SIZES)
def test_rows_are_what_numpy_packs(size):
    flags = random_flags(7, size)
    bits = Bitfields.pack(flags)
    np.testing.assert_array_equal(bits.words, words_by_numpy(flags))
    np.testing.assert_array_equal(bits.unpack(), flags)
    np.testing.assert_array_equal(bits.count(), flags.sum(axis=1))
    for row in range(7):
        np.testing.assert_array_equal(bits.ids(row), np.flatnonzero(flags[row]))
    assert Bitfields.from_ids([np.flatnonzero(row) for row in flags], size) == bits


@given(flags_of_rows)
@settings(max_examples=60, deadline=None)
def test_set_operations_are_numpys(flags):
    bits = Bitfields.pack(flags)
    np.testing.assert_array_equal(bitfield.ids(bits.union()), np.flatnonzero(flags.any(axis=0)))
    np.testing.assert_array_equal(bitfield.ids(bits.intersection()), np.flatnonzero(flags.all(axis=0)))
    other = Bitfields.pack(flags[::-1])
    np.testing.assert_array_equal(bits.difference(other).unpack(), flags & ~flags[::-1])
    offsets, ids = bits.face_lists()
    np.testing.assert_array_equal(np.diff(offsets.astype(int)), flags.sum(axis=1))
    np.testing.assert_array_equal(ids, np.nonzero(flags)[1])


@given(flags_of_rows)
@settings(max_examples=40, deadline=None)
def test_a_summary_names_the_words_that_have_faces(flags):
    bits = Bitfields.pack(flags)
    summary = bits.summary()
    np.testing.assert_array_equal(bitfield.unpack(summary, bits.words.shape[1]), bits.words != 0)
    for row in range(len(bits)):
        np.testing.assert_array_equal(bitfield.ids(bits.words[row], summary=summary[row]), bits.ids(row))
    np.testing.assert_array_equal(bitfield.union(summary), bitfield.summary(bits.union())[0])


def test_chosen_rows_are_joined_as_integers_or_as_a_mask():
    flags = random_flags(9, 300)
    bits = Bitfields.pack(flags)
    expected = words_by_numpy(flags[[2, 5, 7]].any(axis=0)[None])[0]
    np.testing.assert_array_equal(bits.union([2, 5, 7]), expected)
    np.testing.assert_array_equal(bits.union(np.isin(np.arange(9), [2, 5, 7])), expected)
    out = np.full(bits.words.shape[1], 7, dtype=np.uint64)
    assert bits.union([2, 5, 7], out=out) is out
    np.testing.assert_array_equal(out, expected)
    assert not bits.union([], out=out).any()
    with pytest.raises(ValueError, match="at least one row"):
        bits.intersection([])


def test_faces_are_listed_into_the_callers_array():
    bits = Bitfields.pack(random_flags(1, 1000))
    expected = bits.ids(0)
    for room in (len(expected), 1000, 2000):
        out = np.zeros(room, dtype=np.uint32)
        found = bits.ids(0, out=out)
        assert found.base is out
        np.testing.assert_array_equal(found, expected)
    with pytest.raises(ValueError, match=f"room for {len(expected) - 1} ids, the row has {len(expected)}"):
        bits.ids(0, out=np.zeros(len(expected) - 1, dtype=np.uint32))


def test_slices_are_views_and_masks_are_copies():
    flags = random_flags(6, 130)
    bits = Bitfields.pack(flags)
    assert np.shares_memory(bits[2:5].words, bits.words)
    assert bits[2:5] == Bitfields.pack(flags[2:5])
    assert bits[-1] == Bitfields.pack(flags[-1:])
    assert bits[[4, 0]] == Bitfields.pack(flags[[4, 0]])
    assert bits[flags[:, 0]] == Bitfields.pack(flags[flags[:, 0]])
    assert len(bits[3:3]) == 0
    assert bits != bits[:5]
    assert Bitfields(bits.words, 130).words is bits.words
    assert repr(Bitfields.zeros(0, 0)) == "<Bitfields: 0 rows of 0 bits, 0.0% set>"


def test_wrong_rows_are_named():
    words = np.zeros((2, 2), dtype=np.uint64)
    words[1, 1] = 1 << 6
    Bitfields(words, 71)
    with pytest.raises(ValueError, match=r"words\[1, 1\] is 0x40: bits past the last of 70 faces"):
        Bitfields(words, 70)
    with pytest.raises(ValueError, match="2 words a row, but 64 faces take 1"):
        Bitfields(words, 64)
    with pytest.raises(ValueError, match="must be uint64, got int64"):
        Bitfields(words.astype(np.int64), 71)
    with pytest.raises(ValueError, match="size must be an integer of at least 0, got -1"):
        Bitfields(words, -1)
    with pytest.raises(ValueError, match=r"ids\[1\] is 9, but there are 9 faces"):
        Bitfields.from_ids([[0, 9]], 9)
    with pytest.raises(ValueError, match=r"ids\[0\] is -1"):
        Bitfields.from_ids([[-1]], 9)
    with pytest.raises(ValueError, match=r"rows\[1\] is 2, but there are 2 rows"):
        bitfield.union(words, [0, 2])
    with pytest.raises(ValueError, match=r"rows\[0\] is -1"):
        bitfield.union(words, [-1])
    with pytest.raises(ValueError, match="same shape"):
        bitfield.difference(words, words[:1])
    frozen = np.zeros(2, dtype=np.uint64)
    frozen.flags.writeable = False
    with pytest.raises(ValueError, match="out cannot be written"):
        bitfield.union(words, out=frozen)
    with pytest.raises(ValueError, match=r"out must be \(2,\) uint64"):
        bitfield.union(words, out=np.zeros(3, dtype=np.uint64))
    with pytest.raises(ValueError, match="summary of 2 words"):
        bitfield.ids(words[0], summary=np.zeros(2, dtype=np.uint64))
    with pytest.raises(ValueError, match="summary of 1 words"):
        bitfield.ids(words[0], summary=np.array([4], dtype=np.uint64))


def test_a_column_major_array_is_read_by_its_rows():
    flags = random_flags(5, 200)
    words = np.asfortranarray(Bitfields.pack(flags).words)
    assert Bitfields(words, 200) == Bitfields.pack(np.asfortranarray(flags))


def test_an_output_that_overlaps_its_input_is_refused():
    words = np.zeros((2, 2), dtype=np.uint64)
    with pytest.raises(ValueError, match="out cannot be written"):
        bitfield.union(words, [0], out=words[1])


def morton_by_digits(points):
    """Interleaves the binary digits of each point's step, as text."""
    low, extent = points.min(axis=0), np.ptp(points, axis=0).max()
    steps = ((points - low) / extent * (2**21 - 1)).astype(int)
    keys = ["".join(a + b + c for a, b, c in zip(*(f"{s:021b}" for s in p[::-1]), strict=True)) for p in steps]
    return sorted(range(len(points)), key=lambda k: (keys[k], k))


def test_morton_order_interleaves_the_digits_of_the_axes():
    points = np.random.default_rng(1).normal(size=(300, 3)).round(1)
    order = bitfield.morton_order(points)
    np.testing.assert_array_equal(order, morton_by_digits(points))
    np.testing.assert_array_equal(np.sort(order), np.arange(300))
    with pytest.raises(ValueError, match=r"points\[1\]"):
        bitfield.morton_order([[0, 0, 0], [np.inf, 0, 0]])
