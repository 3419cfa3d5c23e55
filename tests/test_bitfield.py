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


def test_a_summary_of_several_words_skips_what_is_empty():
    bits = Bitfields.from_ids([[0, 63 * 64, 64 * 64, 127 * 64 + 5, 9_999], []], 10_000)
    summary = bits.summary()
    assert summary.shape == (2, 3)
    np.testing.assert_array_equal(bitfield.ids(summary[0]), [0, 63, 64, 127, 156])
    out = np.zeros(5, dtype=np.uint32)
    np.testing.assert_array_equal(bitfield.ids(bits.words[0], summary=summary[0], out=out), bits.ids(0))
    assert len(bitfield.ids(bits.words[1], summary=summary[1])) == 0
    with pytest.raises(ValueError, match="room for 4 ids, the row has 5"):
        bitfield.ids(bits.words[0], summary=summary[0], out=out[:4])


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


def similar_rows(rows, size, seed=0):
    """Faces with normals, seen from directions: rows that resemble each other as real ones do."""
    rng = np.random.default_rng(seed)
    normals, directions = rng.normal(size=(size, 3)), rng.normal(size=(rows, 3))
    return (directions @ normals.T > 0.5) & (rng.random((rows, size)) < 0.97)


@given(
    hnp.arrays(np.bool_, st.tuples(st.integers(0, 40), st.integers(0, 150)), elements=st.booleans()),
    st.integers(0, 3),
)
@settings(max_examples=60, deadline=None)
def test_coded_rows_come_back(flags, zeroed):
    flags[:zeroed] = False
    bits = Bitfields.pack(flags)
    assert bitfield.decode(bitfield.encode(bits.words, bits.size)) == bits


@pytest.mark.parametrize("size", [1, 64, 65_535, 65_536, 65_537, 140_000])
def test_rows_of_one_block_and_of_several_come_back(size):
    bits = Bitfields.pack(similar_rows(20, size))
    coded = bitfield.encode(bits.words, size)
    assert len(coded["starts"]) == -(-size // 65_536) + 1
    assert bitfield.decode(coded) == bits


def test_alike_rows_take_little_and_noise_takes_itself():
    size = 20_000
    alike = bitfield.encode(Bitfields.pack(similar_rows(200, size)).words, size)
    assert len(alike["stream"]) < 200 * size / 8 / 3
    noise = bitfield.encode(Bitfields.pack(random_flags(50, size, share=0.5)).words, size)
    assert len(noise["stream"]) < 50 * size / 8 * 1.03
    empty = bitfield.encode(Bitfields.zeros(1000, size).words, size)
    assert len(empty["stream"]) < 1000
    assert not bitfield.decode(empty).words.any()


def test_numpy_alone_opens_the_file(tmp_path):
    bits = Bitfields.pack(similar_rows(30, 5000))
    np.savez_compressed(tmp_path / "rows.npz", **bitfield.encode(bits.words, bits.size), other=np.arange(3))
    with np.load(tmp_path / "rows.npz", allow_pickle=False) as arrays:
        assert bitfield.decode(arrays) == bits


@given(st.data())
@settings(max_examples=80, deadline=None)
def test_damaged_files_are_refused(data):
    bits = Bitfields.pack(similar_rows(20, 900))
    coded = bitfield.encode(bits.words, bits.size)
    name = data.draw(st.sampled_from(sorted(coded)))
    array = coded[name]
    damage = data.draw(st.sampled_from(["drop", "cut", "change", "dtype", "shape"]))
    if damage == "drop":
        del coded[name]
    elif damage == "cut" and array.ndim:
        coded[name] = array[: data.draw(st.integers(0, len(array) - 1))]
    elif damage == "dtype":
        coded[name] = array.astype(float)
    elif damage == "shape":
        coded[name] = array[None]
    else:
        bytes_of = bytearray(array.tobytes())
        position = data.draw(st.integers(0, len(bytes_of) - 1))
        bytes_of[position] ^= data.draw(st.integers(1, 255))
        coded[name] = np.frombuffer(bytes(bytes_of), dtype=array.dtype).reshape(array.shape)
    try:
        decoded = bitfield.decode(coded)
    except ValueError:
        return
    # A changed byte after the last that matters changes nothing; neither does a reference nobody needed.
    assert decoded == bits


@pytest.mark.parametrize("position", range(0, 400, 40))
def test_one_changed_bit_of_the_stream_is_noticed(position):
    bits = Bitfields.pack(similar_rows(20, 900))
    coded = bitfield.encode(bits.words, bits.size)
    stream = coded["stream"].copy()
    stream[position] ^= 4
    with pytest.raises(ValueError, match=r"damaged|too many"):
        bitfield.decode(coded | {"stream": stream})


@given(hnp.arrays(np.uint8, st.integers(0, 400)), st.integers(0, 3000), st.integers(0, 30))
@settings(max_examples=60, deadline=None)
def test_streams_of_noise_are_refused(stream, size, rows):
    coded = bitfield.encode(Bitfields.zeros(rows, size).words, size)
    starts = np.linspace(0, len(stream), len(coded["starts"])).astype(np.uint64)
    coded |= {"stream": stream, "starts": starts, "checksum": coded["checksum"] ^ np.uint64(1)}
    with pytest.raises(ValueError):
        bitfield.decode(coded)


def test_a_size_beyond_all_memory_is_refused_at_once():
    coded = bitfield.encode(Bitfields.zeros(3, 100).words, 100)
    with pytest.raises(ValueError, match="there are 1 blocks"):
        bitfield.decode(coded | {"size": np.array(2**62, dtype=np.uint64)})
    references = np.full((10_000, 8), 0xFFFF, dtype=np.uint16)
    with pytest.raises(ValueError, match="bytes are too few for 10000 rows"):
        bitfield.decode(coded | {"references": references, "size": np.array(30_000, dtype=np.uint64)})
