//! Quads of some tiles as bytes that compress well.
//!
//! Where quads are follows from the slab's opacity and a bit for each block that could be halved: a tile is walked as
//! [`quads`](super::quads) divides it, blocks that are all transparent have none. Of corners, the difference to a guess is
//! kept: the corner that was last at the same place of the panorama, if it is about what the quad's earlier corners make
//! expect (it may be of another surface), else that expectation. Where a surface goes on, three of four are zero.
//!
//! The bytes: the number of quads (32 bits, low byte first); of all differences, quad by quad and all first corners before
//! all second ones, the low bytes and then the high bytes, a difference v (16 bits, two's complement) as 2 v or, below zero,
//! -2 v - 1; a bit for each block of more than a pixel, lowest bits first, set if it is a quad and not halved.

use super::quads::Quad;
use crate::error::Error;

/// A corner that is off what is expected by at most so many steps is of the same surface: about two pixels of parallax.
const NEAR: u16 = 32;

/// Which tiles of which slab.
#[derive(Debug, Clone, Copy)]
pub struct Part<'a> {
    /// Whether a pixel is opaque, row by row.
    pub opaque: &'a [bool],
    pub width: usize,
    /// Pixels a side of a tile: a power of two.
    pub tile: usize,
    /// Their numbers, by rows of tiles.
    pub tiles: &'a [usize],
}

impl Part<'_> {
    fn check(&self) -> Result<(), Error> {
        let Self { opaque, width, tile, tiles } = *self;
        if width == 0 || !tile.is_power_of_two() || !width.is_multiple_of(tile) {
            return Err(Error::Invalid(format!(
                "tile must be a power of two that divides {width}, got {tile}"
            )));
        }
        let count = opaque.len() / (width * tile) * (width / tile);
        match tiles.iter().find(|&&number| number >= count) {
            Some(number) => {
                Err(Error::Invalid(format!("there is no tile {number}: the panorama has {count}")))
            }
            None => Ok(()),
        }
    }

    /// Walks the blocks of the tiles that have opaque pixels.
    fn walk<W: Walker>(&self, walker: &mut W) -> Result<(), Error> {
        let across = self.width / self.tile;
        for &number in self.tiles {
            self.block(number % across * self.tile, number / across * self.tile, self.tile, walker)?;
        }
        Ok(())
    }

    fn block<W: Walker>(&self, x: usize, y: usize, side: usize, walker: &mut W) -> Result<(), Error> {
        let mut rows = (y..y + side).map(|row| &self.opaque[row * self.width + x..][..side]);
        if rows.all(|row| row.iter().all(|&opaque| !opaque)) {
            return Ok(());
        }
        if side == 1 || !walker.halve(x, y, side)? {
            return walker.leaf(x, y, side);
        }
        let half = side / 2;
        for (right, down) in [(0, 0), (half, 0), (0, half), (half, half)] {
            self.block(x + right, y + down, half, walker)?;
        }
        Ok(())
    }
}

trait Walker {
    /// Whether a block of more than a pixel is halved.
    fn halve(&mut self, x: usize, y: usize, side: usize) -> Result<bool, Error>;
    /// Takes a block that is not.
    fn leaf(&mut self, x: usize, y: usize, side: usize) -> Result<(), Error>;
}

/// The corners that were last at each place, in the columns of some tiles.
struct Guesses {
    left: usize,
    columns: usize,
    last: u16,
    known: Vec<Option<u16>>,
}

impl Guesses {
    fn new(part: &Part<'_>) -> Self {
        let across = part.width / part.tile;
        let columns = part.tiles.iter().map(|number| number % across);
        let left = columns.clone().min().unwrap_or(0) * part.tile;
        let right = columns.max().map_or(left, |last| (last + 1) * part.tile);
        let (columns, rows) = (right - left + 1, part.opaque.len() / part.width + 1);
        Self { left, columns, last: 0, known: vec![None; columns * rows] }
    }

    fn places(&self, x: usize, y: usize, side: usize) -> [usize; 4] {
        let first = y * self.columns + x - self.left;
        [first, first + side, first + side * self.columns, first + side * self.columns + side]
    }

    /// What corner `index` may be, from those before it.
    fn guess(&self, places: &[usize; 4], corners: &[u16; 4], index: usize) -> u16 {
        let [a, b, c, _] = *corners;
        let expected = match index {
            0 => return places.iter().find_map(|&place| self.known[place]).unwrap_or(self.last),
            1 | 2 => a,
            _ => b.wrapping_add(c).wrapping_sub(a),
        };
        let close = |&q: &u16| q.wrapping_sub(expected).min(expected.wrapping_sub(q)) <= NEAR;
        self.known[places[index]].filter(close).unwrap_or(expected)
    }

    fn learn(&mut self, places: &[usize; 4], corners: &[u16; 4]) {
        for (&place, &corner) in places.iter().zip(corners) {
            self.known[place] = Some(corner);
        }
        self.last = corners[0];
    }
}

struct Packer<'a> {
    quads: std::iter::Peekable<std::slice::Iter<'a, Quad>>,
    guesses: Guesses,
    differences: [Vec<u16>; 4],
    whole: Vec<bool>,
}

impl Walker for Packer<'_> {
    fn halve(&mut self, x: usize, y: usize, side: usize) -> Result<bool, Error> {
        let next = self.quads.peek().map(|quad| [quad[0], quad[1], quad[2]].map(usize::from));
        let whole = next == Some([x, y, side]);
        self.whole.push(whole);
        Ok(!whole)
    }

    fn leaf(&mut self, x: usize, y: usize, side: usize) -> Result<(), Error> {
        let quad = self.quads.next().filter(|q| [q[0], q[1], q[2]].map(usize::from) == [x, y, side]);
        let Some(&[_, _, _, a, b, c, d]) = quad else {
            return Err(Error::Invalid(format!(
                "the quads don't cover the opaque pixels block by block: none at column {x}, row {y}"
            )));
        };
        let (corners, places) = ([a, b, c, d], self.guesses.places(x, y, side));
        for (index, differences) in self.differences.iter_mut().enumerate() {
            let off = corners[index].wrapping_sub(self.guesses.guess(&places, &corners, index)).cast_signed();
            differences.push(((off << 1) ^ (off >> 15)).cast_unsigned());
        }
        self.guesses.learn(&places, &corners);
        Ok(())
    }
}

/// The bytes of the quads of some tiles, in the order that [`quads`](super::quads::quads) has them.
///
/// # Errors
/// [`Error::Invalid`] if a tile isn't there, or the quads aren't those of the opaque pixels.
pub fn pack(part: &Part<'_>, quads: &[Quad]) -> Result<Vec<u8>, Error> {
    part.check()?;
    let mut packer = Packer {
        quads: quads.iter().peekable(),
        guesses: Guesses::new(part),
        differences: Default::default(),
        whole: vec![],
    };
    part.walk(&mut packer)?;
    if let Some(quad) = packer.quads.next() {
        return Err(Error::Invalid(format!("a quad has no opaque pixels in these tiles: {quad:?}")));
    }
    let mut bytes = u32::try_from(quads.len()).unwrap_or(u32::MAX).to_le_bytes().to_vec();
    for half in 0..2 {
        bytes.extend(packer.differences.iter().flatten().map(|value| value.to_le_bytes()[half]));
    }
    bytes.extend(
        packer
            .whole
            .chunks(8)
            .map(|bits| bits.iter().enumerate().fold(0, |byte, (bit, &set)| byte | u8::from(set) << bit)),
    );
    Ok(bytes)
}

struct Unpacker<'a> {
    low: &'a [u8],
    high: &'a [u8],
    bits: &'a [u8],
    asked: usize,
    guesses: Guesses,
    quads: Vec<Quad>,
    count: usize,
}

impl Walker for Unpacker<'_> {
    fn halve(&mut self, _x: usize, _y: usize, _side: usize) -> Result<bool, Error> {
        let byte = self.bits.get(self.asked / 8).ok_or_else(|| cut_off("its bits end early"))?;
        let whole = byte >> (self.asked % 8) & 1 == 1;
        self.asked += 1;
        Ok(!whole)
    }

    fn leaf(&mut self, x: usize, y: usize, side: usize) -> Result<(), Error> {
        let number = self.quads.len();
        if number == self.count {
            return Err(cut_off("it has fewer quads than opaque blocks"));
        }
        let places = self.guesses.places(x, y, side);
        let mut corners = [0; 4];
        for index in 0..4 {
            let at = index * self.count + number;
            let folded = u16::from_le_bytes([self.low[at], self.high[at]]);
            let off = (folded >> 1) ^ (folded & 1).wrapping_neg();
            corners[index] = self.guesses.guess(&places, &corners, index).wrapping_add(off);
        }
        self.guesses.learn(&places, &corners);
        let [a, b, c, d] = corners;
        self.quads.push([x as u16, y as u16, side as u16, a, b, c, d]);
        Ok(())
    }
}

fn cut_off(why: &str) -> Error {
    Error::Invalid(format!("the file of quads is not that of this picture: {why}"))
}

/// The quads that [`pack`] made bytes of.
///
/// # Errors
/// [`Error::Invalid`] if the bytes are not whole, or of another picture.
pub fn unpack(part: &Part<'_>, bytes: &[u8]) -> Result<Vec<Quad>, Error> {
    part.check()?;
    let (count, rest) = bytes.split_first_chunk().ok_or_else(|| cut_off("it has no number of quads"))?;
    let count = u32::from_le_bytes(*count) as usize;
    if count > rest.len() / 8 {
        return Err(cut_off("it is cut off"));
    }
    let (low, rest) = rest.split_at(4 * count);
    let (high, bits) = rest.split_at(4 * count);
    let guesses = Guesses::new(part);
    let mut unpacker =
        Unpacker { low, high, bits, asked: 0, guesses, quads: Vec::with_capacity(count), count };
    part.walk(&mut unpacker)?;
    if unpacker.quads.len() != count || unpacker.asked.div_ceil(8) != bits.len() {
        return Err(cut_off("it has more quads than opaque blocks"));
    }
    Ok(unpacker.quads)
}

#[cfg(test)]
mod tests {
    use super::super::quads::{Rule, quads};
    use super::*;
    use crate::control::Control;
    use proptest::prelude::*;

    fn slab(pixels: &[f32]) -> Vec<Quad> {
        let rule = Rule { tile: 8, tolerance: 0.01, step: 0.05 };
        quads(pixels, 24, rule, &Control::default()).unwrap().quads
    }

    proptest! {
        #[test]
        fn quads_come_back_from_their_bytes_and_from_no_others(
            pixels in prop::collection::vec(prop_oneof![Just(0.0_f32), 0.5..0.52_f32, 1.0..2.0_f32], 24 * 16),
            first in 0_usize..3, cut in 0_usize..1000,
        ) {
            let tiles = [first, first + 3];
            let own = |q: &&Quad| usize::from(q[0]) / 8 == first;
            let found: Vec<Quad> = slab(&pixels).iter().filter(own).copied().collect();
            let opaque: Vec<bool> = pixels.iter().map(|&q| q > 0.0).collect();
            let part = Part { opaque: &opaque, width: 24, tile: 8, tiles: &tiles };
            let bytes = pack(&part, &found).unwrap();
            prop_assert_eq!(unpack(&part, &bytes).unwrap(), found);
            prop_assert!(unpack(&part, &bytes[..cut % bytes.len()]).is_err());
            prop_assert!(unpack(&part, &[&bytes[..], &[0]].concat()).is_err());
        }
    }

    #[test]
    fn a_plane_is_its_first_corners_and_what_is_not_there_is_said() {
        let plane: Vec<f32> = (0..24 * 16).map(|i| 1.0 + 0.01 * (i % 24) as f32).collect();
        let opaque = vec![true; plane.len()];
        let part = Part { opaque: &opaque, width: 24, tile: 8, tiles: &[1, 4] };
        let found = slab(&plane);
        let bytes = pack(&part, &[found[1], found[4]]).unwrap();
        assert_eq!(bytes.len(), 4 + 2 * 8 + 1);
        // The second tile's upper corners are the first one's lower ones.
        let second = [0, 1].map(|corner| [bytes[4 + 2 * corner + 1], bytes[12 + 2 * corner + 1]]);
        assert_eq!(second, [[0, 0], [0, 0]]);
        assert!(pack(&part, &found[..1]).unwrap_err().to_string().contains("none at column 8"));
        assert!(pack(&part, &[found[1], found[4], found[5]]).is_err());
        assert!(pack(&Part { tiles: &[6], ..part }, &[]).unwrap_err().to_string().contains("no tile 6"));
    }
}
