//! Which faces of a cluster show, and in which pixels: float32, a wide register of faces at a time, on the safe side.
//!
//! Many faces of a scan have no pixel's centre in their box, or cover none of those in it. Float32 finds that out for twice as many faces at once; only what is left is set up in float64, for its depths. What
//! float32 cannot tell is left to the exact way.
//!
//! How wrong an edge function may be: in the unit `u` = 2^-24, with corners up to `R` pixels from the cluster's first
//! pixel and up to `D` from the face's (or from what is tested, at most [`SMALL`] pixels on), corners are `u R` off when
//! rounded and `u D` more when moved to the face's first pixel. The product of a distance of up to `D` and a side of up
//! to `2 D` is then off by `8 D u (R + D)`; sides, products, sums and the steps along rows and columns round by less than
//! `40 D^2 u`. Together that is less than `8 D (R + 8 D) u`. The exact edge function itself is a sum of products of
//! homogeneous coordinates: in pixels of up to `C` from the image's centre it is off by less than `2^-46 C^2`.

use super::super::clusters::{Cluster, MOST_FACES};
use super::super::frame::{Band, tag};
use super::super::lanes::{FEW, Lanes, MOST_LANES, MOST_SINGLES, Singles, TABLE};
use super::super::pyramid::PixelBox;
use super::super::triangle::KEY_RANGE;
use super::super::view::View;
use super::cluster::{Projected, Screen};

/// Faces whose box is at most this many pixels wide and high are small.
pub const SMALL: usize = 4;

/// The faces of a cluster that a sieve has looked at, and of them the small ones that show, as far as float32 can tell;
/// padded so that whole registers can be read.
pub struct Shown {
    /// The first pixel of each face's box, counted from that of the cluster, and how many more there are each way.
    left: [i32; MOST_FACES],
    top: [i32; MOST_FACES],
    wide: [i32; MOST_FACES],
    high: [i32; MOST_FACES],
    /// The pixels from there on that are covered, [`SMALL`] bits a row.
    cover: [i32; MOST_FACES],
    /// The nearest value of a corner, or nearer; and no less than what the face draws anywhere.
    near: [f32; MOST_FACES],
    nearest: [u64; MOST_FACES],
    pub count: usize,
    pub corners: [u32; Self::ROOM],
    pub ids: [u32; Self::ROOM],
    /// A column of the image, and a row of it: where each face's pixels are counted from.
    pub columns: [u32; Self::ROOM],
    pub rows: [f32; Self::ROOM],
    /// The sample there, of the band.
    pub places: [u32; Self::ROOM],
    /// The pixels that a face covers, [`SMALL`] bits a row.
    pub pixels: [u32; Self::ROOM],
}

impl Shown {
    const ROOM: usize = MOST_FACES + MOST_LANES;
}

impl Default for Shown {
    fn default() -> Self {
        Self {
            left: [0; MOST_FACES],
            top: [0; MOST_FACES],
            wide: [0; MOST_FACES],
            high: [0; MOST_FACES],
            cover: [0; MOST_FACES],
            near: [0.0; MOST_FACES],
            nearest: [0; MOST_FACES],
            count: 0,
            corners: [0; Self::ROOM],
            ids: [0; Self::ROOM],
            columns: [0; Self::ROOM],
            rows: [0.0; Self::ROOM],
            places: [0; Self::ROOM],
            pixels: [0; Self::ROOM],
        }
    }
}

/// The bits of a box, by the rows and columns after the first.
const BOXES: [[u32; SMALL]; SMALL] = {
    let mut boxes = [[0; SMALL]; SMALL];
    let mut bit = 0;
    while bit < SMALL.pow(4) {
        let (high, wide, row, column) = (bit / 64, bit / 16 % 4, bit / 4 % 4, bit % 4);
        if row <= high && column <= wide {
            boxes[high][wide] |= 1 << (SMALL * row + column);
        }
        bit += 1;
    }
    boxes
};

/// Sorts the faces of a cluster that is placed on the screen from `area`'s first pixel on: small ones that show, large
/// ones with their boxes, and those that want a closer look.
#[inline(always)]
pub fn sift<L: Lanes, const PERSPECTIVE: bool>(
    view: &View,
    cluster: &Cluster<'_>,
    area: &PixelBox,
    band: &Band<'_>,
    projected: &mut Projected,
    shown: &mut Shown,
) {
    let Projected { screen, large, straddling, .. } = projected;
    (large.count, straddling.count, shown.count) = (0, 0, 0);
    let Cluster { corners, ids, count, coordinates } = *cluster;
    assert!(corners.len() == ids.len() && corners.len().is_multiple_of(MOST_SINGLES));
    assert!(count <= corners.len() && corners.len() <= MOST_FACES);
    let few = coordinates[0].len() <= FEW;
    let sieve = Sieve::<L::Singles>::new(view, area);
    // All faces first, then those of each kind: what is computed is ready by then, and the processor foresees the loops.
    let (mut small, mut rest, mut doubtful) = (0_u64, 0_u64, 0_u64);
    for at in (0..count).step_by(L::Singles::COUNT) {
        // SAFETY: corners come in whole registers.
        let found = unsafe { sieve.sort::<PERSPECTIVE>(screen, few, corners[at..].as_ptr(), at, shown) };
        small |= u64::from(found[0]) << at;
        rest |= u64::from(found[1]) << at;
        doubtful |= u64::from(found[2]) << at;
    }
    let real = u64::MAX >> (MOST_FACES - count);
    (small, rest, doubtful) = (small & real, rest & real, doubtful & real);
    let (first_column, first_row) = (area.x.start as i32, area.y.start as i32);
    while rest != 0 {
        let face = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let (left, top) = (first_column + shown.left[face], first_row + shown.top[face]);
        let cells = [left, top, -(left + shown.wide[face]), -(top + shown.high[face])];
        large.push(corners[face], ids[face], cells.map(|cell| cell as i16));
    }
    while doubtful != 0 {
        let face = doubtful.trailing_zeros() as usize;
        doubtful &= doubtful - 1;
        straddling.push(corners[face], ids[face], [0; 4]);
    }
    if small != 0 {
        for first in (0..count).step_by(L::COUNT) {
            // SAFETY: the slices hold a register.
            unsafe {
                let near = L::load_f32(shown.near[first..first + L::COUNT].as_ptr());
                let near = near.max(L::splat(KEY_RANGE[0])).min(L::splat(KEY_RANGE[1]));
                let words = L::words::<PERSPECTIVE>(near, L::splat_word(tag(0)));
                L::store_words(words, shown.nearest[first..first + L::COUNT].as_mut_ptr());
            }
        }
    }
    // Whole rows of samples, though the image may end with the box.
    let last_column = (band.stride - SMALL) as u32;
    while small != 0 {
        let face = small.trailing_zeros() as usize;
        small &= small - 1;
        let row = (first_row + shown.top[face]) as u32;
        let column = (first_column + shown.left[face]) as u32;
        let from = column.min(last_column);
        let place = (row as usize - band.rows.start) * band.stride + from as usize;
        let within = BOXES[shown.high[face] as usize & 3][shown.wide[face] as usize & 3];
        let pixels = (shown.cover[face] as u32 & within) << (column - from);
        let entry = shown.count;
        shown.corners[entry] = corners[face];
        shown.ids[entry] = ids[face];
        shown.columns[entry] = from;
        shown.rows[entry] = row as f32;
        shown.places[entry] = place as u32;
        shown.pixels[entry] = pixels;
        // Of one or two pixels it costs little to see whether they are nearer already.
        let ends =
            [pixels.trailing_zeros(), pixels.checked_ilog2().unwrap_or(0)].map(|bit| bit as usize & 15);
        let [first, last] = ends.map(|bit| band.samples[place + bit / SMALL * band.stride + bit % SMALL]);
        let few = pixels == 1 << ends[0] | 1 << ends[1];
        let hidden = few && first.min(last) > shown.nearest[face];
        shown.count += usize::from(pixels != 0 && !hidden);
    }
}

/// What faces are tested with.
struct Sieve<S: Singles> {
    /// The last column and row.
    last: [S; 2],
    /// How far a box may reach beyond what was rounded.
    pad: S,
    /// No pixel is farther from the image's centre than a cluster's first one and this.
    reach: S,
}

/// A unit of rounding.
const UNIT: f32 = 0.5 * f32::EPSILON;

impl<S: Singles> Sieve<S> {
    #[inline(always)]
    fn new(view: &View, area: &PixelBox) -> Self {
        let size = (view.width.max(view.height) + 2 * SMALL) as f32;
        Self {
            last: [S::splat(area.x.len() as f32 - 1.0), S::splat(area.y.len() as f32 - 1.0)],
            // Twice what `screen_error` asks for.
            pad: S::splat(2e-6 + 4.0 * f32::EPSILON * size),
            reach: S::splat(size),
        }
    }

    /// The faces that are small and cover pixels; those that are large; those of which it cannot be said. Their boxes go
    /// to `shown` from entry `at` on.
    ///
    /// # Safety
    /// There is a register of faces.
    #[inline(always)]
    unsafe fn sort<const PERSPECTIVE: bool>(
        &self,
        screen: &Screen,
        few: bool,
        faces: *const u32,
        at: usize,
        shown: &mut Shown,
    ) -> [u32; 3] {
        // SAFETY: as the caller says.
        let [[ax, bx, cx], [ay, by, cy]]: [[S; 3]; 2] =
            unsafe { [corners(&screen.x, few, faces), corners(&screen.y, few, faces)] };
        let zero = S::splat(0.0);
        let (least_x, most_x) = (ax.min(bx).min(cx), ax.max(bx).max(cx));
        let (least_y, most_y) = (ay.min(by).min(cy), ay.max(by).max(cy));
        let left = least_x.sub(self.pad).max(zero).ceil();
        let top = least_y.sub(self.pad).max(zero).ceil();
        let wide = most_x.add(self.pad).min(self.last[0]).floor().sub(left);
        let high = most_y.add(self.pad).min(self.last[1]).floor().sub(top);
        // A sum has all that is not finite.
        let seen = S::bits(S::splat(f32::INFINITY).gt(ax.add(bx).add(cx).abs()));
        let unseen = ((1 << S::COUNT) - 1) & !seen;
        let boxes = seen & S::bits(S::and(wide.ge(zero), high.ge(zero)));
        let side = S::splat((SMALL - 1) as f32);
        let small = boxes & S::bits(S::and(side.ge(wide), side.ge(high)));
        let Shown { left: lefts, top: tops, wide: wides, high: highs, cover: covers, near: nears, .. } =
            shown;
        for (number, to) in [(left, lefts), (top, tops), (wide, wides), (high, highs)] {
            // SAFETY: the slice holds a register.
            unsafe { number.store_whole(to[at..at + S::COUNT].as_mut_ptr()) };
        }
        if small == 0 {
            return [0, boxes, unseen];
        }
        let far = most_x.sub(left).max(left.sub(least_x)).max(most_y.sub(top).max(top.sub(least_y)));
        let corner = far.add(left.max(top));
        let far = far.add(side);
        let from_centre = corner.add(self.reach);
        let error = far.mul(S::splat(8.0 * UNIT)).mul(corner.add(far.mul(S::splat(8.0))));
        let error = error.add(from_centre.mul(from_centre).mul(S::splat((2.0_f32).powi(-46))));
        let [ax, bx, cx] = [ax.sub(left), bx.sub(left), cx.sub(left)];
        let [ay, by, cy] = [ay.sub(top), by.sub(top), cy.sub(top)];
        let [e0, e1, e2] = [Edge::new(ax, ay, bx, by), Edge::new(bx, by, cx, cy), Edge::new(cx, cy, ax, ay)];
        let area = e0.at.add(e1.at).add(e2.at);
        let edges = [e0.turned(area), e1.turned(area), e2.turned(area)];
        let two = S::splat(2.0);
        let three = S::splat(3.0);
        let (cover, clear) = if small & (S::bits(wide.ge(two)) | S::bits(high.ge(two))) == 0 {
            pixels::<S, 2>(&edges, error)
        } else if small & (S::bits(wide.ge(three)) | S::bits(high.ge(three))) == 0 {
            pixels::<S, 3>(&edges, error)
        } else {
            pixels::<S, 4>(&edges, error)
        };
        let sure = S::bits(S::and(clear.gt(error), area.abs().gt(error.mul(three))));
        // SAFETY: the slices hold a register, and as the caller says.
        unsafe {
            cover.store_whole(covers[at..at + S::COUNT].as_mut_ptr());
            let [a, b, c]: [S; 3] = corners(&screen.near, few, faces);
            let near = if PERSPECTIVE { a.max(b).max(c) } else { a.min(b).min(c) };
            near.store(nears[at..at + S::COUNT].as_mut_ptr());
        }
        [small & sure & S::bits(cover.gt(zero)), boxes & !small, unseen | small & !sure]
    }
}

/// What the corners of some faces have in a table.
///
/// # Safety
/// There is a register of faces.
#[inline(always)]
unsafe fn corners<S: Singles>(table: &[f32; TABLE], few: bool, faces: *const u32) -> [S; 3] {
    // SAFETY: as the caller says.
    unsafe {
        [S::look_up(table, few, faces, 0), S::look_up(table, few, faces, 1), S::look_up(table, few, faces, 2)]
    }
}

/// An edge function: its value at the first pixel, and its steps along a row and down.
struct Edge<S: Singles> {
    at: S,
    along: S,
    down: S,
}

impl<S: Singles> Edge<S> {
    #[inline(always)]
    fn new(px: S, py: S, qx: S, qy: S) -> Self {
        let (x, y) = (qx.sub(px), qy.sub(py));
        Self { at: py.mul(x).sub(px.mul(y)), along: y, down: S::splat(0.0).sub(x) }
    }

    /// Negated where `other` is negative.
    #[inline(always)]
    fn turned(&self, other: S) -> Self {
        Self {
            at: self.at.times_sign_of(other),
            along: self.along.times_sign_of(other),
            down: self.down.times_sign_of(other),
        }
    }
}

/// Of a square of pixels those that are surely covered, bit by bit as a sum; and the least that any edge function that
/// decides is from zero.
#[inline(always)]
fn pixels<S: Singles, const SIDE: usize>(edges: &[Edge<S>; 3], error: S) -> (S, S) {
    let mut cover = S::splat(0.0);
    let mut clear = S::splat(f32::INFINITY);
    let [e0, e1, e2] = edges;
    let mut first = [e0.at, e1.at, e2.at];
    for row in 0..SIDE {
        let mut at = first;
        // Rows apart, so that sums need not wait for each other.
        let mut bits = S::splat(0.0);
        let mut least_clear = S::splat(f32::INFINITY);
        for column in 0..SIDE {
            let least = at[0].min(at[1]).min(at[2]);
            bits = bits.add_where(least.gt(error), S::splat((1 << (SMALL * row + column)) as f32));
            least_clear = least.abs().min(least_clear);
            at = [at[0].add(e0.along), at[1].add(e1.along), at[2].add(e2.along)];
        }
        cover = cover.add(bits);
        clear = least_clear.min(clear);
        first = [first[0].add(e0.down), first[1].add(e1.down), first[2].add(e2.down)];
    }
    (cover, clear)
}
