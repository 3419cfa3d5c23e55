//! Four lanes in plain Rust: what every processor runs, and the compiler vectorises as it can.

use super::super::clusters::unpack;
use super::super::view::Vertex;
use super::{Cells, KEPT, Lanes, SHIFT, Singles, TABLE, UNSEEN, terms};
use crate::render::frame;

const COUNT: usize = 4;

/// A sum with this ends in the bits of the nearest whole number: two additions, which every processor has for vectors,
/// where conversions and roundings are often made one by one.
const WHOLE: f64 = 1.5 * (1_u64 << 52) as f64;

#[derive(Clone, Copy)]
pub struct Four([f64; COUNT]);

impl Four {
    #[inline(always)]
    fn each(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self(std::array::from_fn(|lane| f(self.0[lane], other.0[lane])))
    }

    #[inline(always)]
    fn test(self, other: Self, f: impl Fn(f64, f64) -> bool) -> [u64; COUNT] {
        std::array::from_fn(|lane| all(f(self.0[lane], other.0[lane])))
    }
}

/// All bits or none.
#[inline(always)]
fn all(set: bool) -> u64 {
    if set { u64::MAX } else { 0 }
}

/// `yes` where a bit of the mask is set, else `no`.
#[inline(always)]
fn chosen(mask: u64, yes: u64, no: u64) -> u64 {
    (mask & yes) | (!mask & no)
}

/// Rounded up, within the range of 16 bits.
#[inline(always)]
fn whole(x: f64) -> i16 {
    const MOST: f64 = i16::MAX as f64;
    let x = if x > -MOST { x } else { -MOST };
    let x = if x < MOST { x } else { MOST };
    let sum = x + WHOLE;
    sum.to_bits() as i16 + i16::from(sum - WHOLE < x)
}

#[inline(always)]
fn to_word(cells: Cells) -> u64 {
    let [a, b, c, d] = cells.map(|entry| u64::from(entry as u16));
    a | b << 16 | c << 32 | d << 48
}

#[inline(always)]
fn to_cells(word: u64) -> Cells {
    [word as u16, (word >> 16) as u16, (word >> 32) as u16, (word >> 48) as u16].map(|entry| entry as i16)
}

impl Lanes for Four {
    const COUNT: usize = COUNT;
    /// All bits of a lane or none.
    type Mask = [u64; COUNT];
    type Words = [u64; COUNT];
    type Singles = FourSingles;

    #[inline(always)]
    fn ramp() -> Self {
        Self(std::array::from_fn(|lane| lane as f64))
    }

    #[inline(always)]
    fn halves(low: f64, _: f64) -> Self {
        Self::splat(low)
    }

    #[inline(always)]
    fn prefetch<T>(_: &[T]) {}

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; COUNT])
    }

    #[inline(always)]
    unsafe fn load(from: *const f64) -> Self {
        // SAFETY: the lanes are there, as the trait asks.
        Self(unsafe { from.cast::<[f64; COUNT]>().read() })
    }

    #[inline(always)]
    unsafe fn load_f32(from: *const f32) -> Self {
        // SAFETY: the lanes are there, as the trait asks.
        Self(unsafe { from.cast::<[f32; COUNT]>().read() }.map(f64::from))
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f64) {
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { to.cast::<[f64; COUNT]>().write(self.0) }
    }

    #[inline(always)]
    unsafe fn store_f32(self, to: *mut f32) {
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { to.cast::<[f32; COUNT]>().write(self.0.map(|lane| lane as f32)) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.each(other, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.each(other, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.each(other, |a, b| a * b)
    }

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.each(other, |a, b| a / b)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.each(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.each(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f64::abs))
    }

    #[inline(always)]
    fn times_sign_of(self, other: Self) -> Self {
        self.each(other, |a, b| f64::from_bits(a.to_bits() ^ (b.to_bits() & 1 << 63)))
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a >= b)
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a > b)
    }

    #[inline(always)]
    fn eq(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a == b)
    }

    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|lane| {
            f64::from_bits(chosen(mask[lane], yes.0[lane].to_bits(), no.0[lane].to_bits()))
        }))
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|lane| a[lane] & b[lane])
    }

    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|lane| a[lane] | b[lane])
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        (0..COUNT).map(|lane| (mask[lane] as u32 & 1) << lane).sum()
    }

    #[inline(always)]
    fn mask(bits: u32) -> Self::Mask {
        std::array::from_fn(|lane| all(bits >> lane & 1 == 1))
    }

    #[inline(always)]
    fn greatest(self) -> f64 {
        self.0.into_iter().fold(f64::NEG_INFINITY, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    unsafe fn gather(vertices: *const Vertex, faces: *const u32, corner: usize) -> [Self; 4] {
        let mut lanes = [[0.0; COUNT]; 4];
        let [xs, ys, ws, values] = &mut lanes;
        for lane in 0..COUNT {
            // SAFETY: the faces are there and their corners are vertices, as the trait asks.
            let vertex = unsafe { *vertices.add(unpack(*faces.add(lane))[corner]) };
            (xs[lane], ys[lane]) = (vertex.x, vertex.y);
            (ws[lane], values[lane]) = (vertex.w, vertex.value);
        }
        lanes.map(Self)
    }

    #[inline(always)]
    unsafe fn gather_cells(cells: *const Cells, faces: *const u32) -> Self::Words {
        std::array::from_fn(|lane| {
            // SAFETY: the faces are there and their corners have cells, as the trait asks.
            let [a, b, c] = unsafe { unpack(*faces.add(lane)).map(|corner| *cells.add(corner)) };
            to_word(std::array::from_fn(|entry| a[entry].min(b[entry]).min(c[entry])))
        })
    }

    #[inline(always)]
    fn greatest_cells(a: Self::Words, b: Self::Words) -> Self::Words {
        std::array::from_fn(|lane| {
            let (a, b) = (to_cells(a[lane]), to_cells(b[lane]));
            to_word(std::array::from_fn(|entry| a[entry].max(b[entry])))
        })
    }

    #[inline(always)]
    fn judge_cells(cells: Self::Words, side: i16) -> [u32; 3] {
        let mut masks = [0; 3];
        for (lane, &cells) in cells.iter().enumerate() {
            let [left, top, right, bottom] = to_cells(cells);
            // From the last pixels back to the first.
            let (wide, high) = (left.saturating_add(right), top.saturating_add(bottom));
            let unseen = left == UNSEEN[0];
            let some = !unseen & (wide <= 0) & (high <= 0);
            let small = some & (wide > -side) & (high > -side);
            for (mask, set) in masks.iter_mut().zip([unseen, some, small]) {
                *mask |= u32::from(set) << lane;
            }
        }
        masks
    }

    #[inline(always)]
    unsafe fn append_cells(
        mask: u32,
        cells: Self::Words,
        faces: [*const u32; 2],
        cells_to: *mut Cells,
        faces_to: [*mut u32; 2],
    ) {
        let mut count = 0;
        for (lane, &cells) in cells.iter().enumerate() {
            // SAFETY: all is there, as the trait asks.
            unsafe {
                *cells_to.add(count) = to_cells(cells);
                *faces_to[0].add(count) = *faces[0].add(lane);
                *faces_to[1].add(count) = *faces[1].add(lane);
            }
            count += (mask >> lane & 1) as usize;
        }
    }

    #[inline(always)]
    unsafe fn load_cells(from: *const Cells) -> [Self; 4] {
        // SAFETY: the lanes are there, as the trait asks.
        let cells = unsafe { from.cast::<[Cells; COUNT]>().read() };
        std::array::from_fn(|entry| Self(cells.map(|cell| f64::from(cell[entry]))))
    }

    #[inline(always)]
    unsafe fn store_cells(up: [Self; 2], down: [Self; 2], mask: Self::Mask, to: *mut Cells) {
        let cells: [Cells; COUNT] = std::array::from_fn(|lane| {
            // The negative of what is rounded down is the negative rounded up.
            let cells = [up[0].0[lane], up[1].0[lane], -down[0].0[lane], -down[1].0[lane]].map(whole);
            if mask[lane] == 0 { UNSEEN } else { cells }
        });
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { to.cast::<[Cells; COUNT]>().write(cells) }
    }

    #[inline(always)]
    unsafe fn store_vertices(vertices: [Self; 4], to: *mut Vertex) {
        let [x, y, w, value] = vertices.map(|lanes| lanes.0);
        for lane in 0..COUNT {
            // SAFETY: the lanes are there, as the trait asks.
            unsafe { *to.add(lane) = Vertex { x: x[lane], y: y[lane], w: w[lane], value: value[lane] } }
        }
    }

    #[inline(always)]
    unsafe fn tags(faces: *const u32) -> Self::Words {
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { faces.cast::<[u32; COUNT]>().read() }.map(frame::tag)
    }

    #[inline(always)]
    fn splat_word(word: u64) -> Self::Words {
        [word; COUNT]
    }

    #[inline(always)]
    unsafe fn load_words(from: *const u64) -> Self::Words {
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { from.cast::<[u64; COUNT]>().read() }
    }

    #[inline(always)]
    fn words<const PERSPECTIVE: bool>(values: Self, tags: Self::Words) -> Self::Words {
        let [subtrahend, flip] = terms(PERSPECTIVE);
        std::array::from_fn(|lane| {
            let bits = (values.0[lane].to_bits() ^ flip).wrapping_sub(subtrahend);
            bits << SHIFT & KEPT | tags[lane]
        })
    }

    #[inline(always)]
    unsafe fn store_words(words: Self::Words, to: *mut u64) {
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { to.cast::<[u64; COUNT]>().write(words) }
    }

    #[inline(always)]
    fn lesser(a: Self::Words, b: Self::Words) -> Self::Words {
        std::array::from_fn(|lane| a[lane].min(b[lane]))
    }

    #[inline(always)]
    fn greater(a: Self::Words, b: Self::Words) -> Self::Mask {
        std::array::from_fn(|lane| all(a[lane] > b[lane]))
    }

    #[inline(always)]
    unsafe fn append(
        bits: u32,
        words: Self::Words,
        first: u32,
        steps: *const u32,
        words_to: *mut u64,
        places_to: *mut u32,
    ) {
        let mut count = 0;
        for (lane, word) in words.into_iter().enumerate() {
            // SAFETY: there is room for as many entries as lanes, as the trait asks.
            unsafe {
                *words_to.add(count) = word;
                *places_to.add(count) = first + *steps.add(lane);
            }
            count += (bits >> lane & 1) as usize;
        }
    }

    #[inline(always)]
    unsafe fn deepen(mask: Self::Mask, words: Self::Words, at: *mut u64) {
        for lane in 0..COUNT {
            // SAFETY: the lanes are there, as the trait asks.
            unsafe { *at.add(lane) = (words[lane] & mask[lane]).max(*at.add(lane)) }
        }
    }
}

/// A sum with this ends in the bits of the nearest whole number, as with [`WHOLE`].
const WHOLE_SINGLE: f32 = 1.5 * (1_u32 << 23) as f32;

#[derive(Clone, Copy)]
pub struct FourSingles([f32; COUNT]);

impl FourSingles {
    #[inline(always)]
    fn each(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|lane| f(self.0[lane], other.0[lane])))
    }

    #[inline(always)]
    fn test(self, other: Self, f: impl Fn(f32, f32) -> bool) -> [u32; COUNT] {
        std::array::from_fn(|lane| if f(self.0[lane], other.0[lane]) { u32::MAX } else { 0 })
    }
}

impl Singles for FourSingles {
    const COUNT: usize = COUNT;
    /// All bits of a lane or none.
    type Mask = [u32; COUNT];

    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; COUNT])
    }

    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { to.cast::<[f32; COUNT]>().write(self.0) }
    }

    #[inline(always)]
    unsafe fn store_whole(self, to: *mut i32) {
        // The nearest is the number itself; its sign is that of the bits' lower half.
        let whole =
            self.0.map(|lane| (lane + WHOLE_SINGLE).to_bits().wrapping_sub(WHOLE_SINGLE.to_bits()) as i32);
        // SAFETY: the lanes are there, as the trait asks.
        unsafe { to.cast::<[i32; COUNT]>().write(whole) }
    }

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.each(other, |a, b| a + b)
    }

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.each(other, |a, b| a - b)
    }

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.each(other, |a, b| a * b)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.each(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.each(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.map(f32::abs))
    }

    #[inline(always)]
    fn ceil(self) -> Self {
        Self(self.0.map(|x| {
            let nearest = x + WHOLE_SINGLE - WHOLE_SINGLE;
            nearest + if nearest < x { 1.0 } else { 0.0 }
        }))
    }

    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.map(|x| {
            let nearest = x + WHOLE_SINGLE - WHOLE_SINGLE;
            nearest - if nearest > x { 1.0 } else { 0.0 }
        }))
    }

    #[inline(always)]
    fn times_sign_of(self, other: Self) -> Self {
        self.each(other, |a, b| f32::from_bits(a.to_bits() ^ (b.to_bits() & 1 << 31)))
    }

    #[inline(always)]
    fn ge(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a >= b)
    }

    #[inline(always)]
    fn gt(self, other: Self) -> Self::Mask {
        self.test(other, |a, b| a > b)
    }

    #[inline(always)]
    fn add_where(self, mask: Self::Mask, other: Self) -> Self {
        Self(std::array::from_fn(|lane| self.0[lane] + f32::from_bits(other.0[lane].to_bits() & mask[lane])))
    }

    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|lane| a[lane] & b[lane])
    }

    #[inline(always)]
    fn bits(mask: Self::Mask) -> u32 {
        mask.iter().enumerate().map(|(lane, &all)| all & 1 << lane).sum()
    }

    #[inline(always)]
    unsafe fn look_up(table: &[f32; TABLE], _: bool, faces: *const u32, corner: usize) -> Self {
        // SAFETY: the lanes are there, as the trait asks.
        let faces = unsafe { faces.cast::<[u32; COUNT]>().read_unaligned() };
        Self(faces.map(|face| table[(face >> (8 * corner) & 0xff) as usize]))
    }
}
