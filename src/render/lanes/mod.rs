//! Several float64, or twice as many float32, at once: one set of kernels for every instruction set.
//!
//! The kernels are written once over [`Lanes`] and compiled for each implementation inside a function that has its
//! features ([`with_lanes`]); all their parts are inlined into it. Every operation rounds as the scalar one does and
//! none is fused, so all implementations give the same bits.
//!
//! The best is found at run time: on x86-64 AVX-512 (F, VL, DQ and BW), else AVX2 (with BMI, LZCNT and POPCNT), else the
//! portable lanes as compiled for SSE2. Elsewhere there are only the portable lanes: on aarch64 the compiler makes NEON
//! of them, which nobody here has run.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod packing;
mod portable;

pub use packing::{PIXELS, Packing};

use super::frame::FACE_BITS;
use super::triangle::{DROPPED, key_terms};
use super::view::Vertex;
use crate::camera::Projection;
use crate::error::Error;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU8, Ordering};

/// Registers hold at most so many lanes.
pub const MOST_LANES: usize = 8;

/// Registers hold at most so many float32.
pub const MOST_SINGLES: usize = 16;

/// Entries of what vertices are looked up in: as many as a byte can name.
pub const TABLE: usize = 256;

/// Entries of the part of it that some instruction sets hold in registers.
pub const FEW: usize = 64;

/// A register of float32: for what need not be exact, only on the safe side.
///
/// The unsafe methods read or write [`COUNT`](Self::COUNT) entries from a pointer on, which must be there.
pub trait Singles: Copy {
    /// Lanes in a register; a multiple of [`Lanes::COUNT`] that divides [`MOST_SINGLES`].
    const COUNT: usize;
    /// A truth value for each lane.
    type Mask: Copy;

    fn splat(value: f32) -> Self;
    /// # Safety
    /// As said of the trait.
    unsafe fn store(self, to: *mut f32);
    /// Writes whole numbers.
    ///
    /// # Safety
    /// As said of the trait.
    unsafe fn store_whole(self, to: *mut i32);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    /// The lesser; `other` if either is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater; `other` if either is NaN.
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// The next whole number; of no more than 2^22 on any side.
    fn ceil(self) -> Self;
    /// The last whole number; of no more than 2^22 on any side.
    fn floor(self) -> Self;
    /// Negated where `other` is negative.
    fn times_sign_of(self, other: Self) -> Self;
    /// Never true of NaN.
    fn ge(self, other: Self) -> Self::Mask;
    /// Never true of NaN.
    fn gt(self, other: Self) -> Self::Mask;
    /// With `other` added where the mask is set.
    fn add_where(self, mask: Self::Mask, other: Self) -> Self;
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The lowest bits, a bit a lane.
    fn bits(mask: Self::Mask) -> u32;
    /// Entries of a table: `corner` picks from each packed face. `few` promises that they are among the first [`FEW`].
    ///
    /// # Safety
    /// As said of the trait, of `faces`.
    unsafe fn look_up(table: &[f32; TABLE], few: bool, faces: *const u32, corner: usize) -> Self;
}

/// A register of float64.
///
/// The unsafe methods read or write [`COUNT`](Self::COUNT) entries from a pointer on, which must be there.
pub trait Lanes: Copy + Packing {
    /// Lanes in a register; divides [`MOST_LANES`].
    const COUNT: usize;
    /// A truth value for each lane.
    type Mask: Copy;
    /// An unsigned 64-bit word for each lane.
    type Words: Copy;
    /// Registers of float32.
    type Singles: Singles;

    fn splat(value: f64) -> Self;
    /// 0, 1, 2 and so on.
    fn ramp() -> Self;
    /// `low` in the first four lanes, `high` in all others.
    fn halves(low: f64, high: f64) -> Self;
    /// Asks for memory that will be read soon.
    fn prefetch<T>(memory: &[T]);
    /// # Safety
    /// As said of the trait.
    unsafe fn load(from: *const f64) -> Self;
    /// # Safety
    /// As said of the trait.
    unsafe fn load_f32(from: *const f32) -> Self;
    /// # Safety
    /// As said of the trait.
    unsafe fn store(self, to: *mut f64);
    /// Rounds to the nearest float32.
    ///
    /// # Safety
    /// As said of the trait.
    unsafe fn store_f32(self, to: *mut f32);
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    /// The lesser; `other` if either is NaN.
    fn min(self, other: Self) -> Self;
    /// The greater; `other` if either is NaN.
    fn max(self, other: Self) -> Self;
    fn abs(self) -> Self;
    /// Negated where `other` is negative.
    fn times_sign_of(self, other: Self) -> Self;
    /// Never true of NaN, as all comparisons.
    fn ge(self, other: Self) -> Self::Mask;
    fn gt(self, other: Self) -> Self::Mask;
    fn eq(self, other: Self) -> Self::Mask;
    /// `yes` where the mask is set, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The lowest bits, a bit a lane.
    fn bits(mask: Self::Mask) -> u32;
    /// A mask of bits, the lowest first.
    fn mask(bits: u32) -> Self::Mask;
    /// The greatest lane; none may be NaN.
    fn greatest(self) -> f64;

    /// Homogeneous coordinates and values of vertices: `corner` picks from each packed face.
    ///
    /// # Safety
    /// `faces` are [`COUNT`](Self::COUNT) packed faces whose corners are vertices from `vertices` on.
    unsafe fn gather(vertices: *const Vertex, faces: *const u32, corner: usize) -> [Self; 4];
    /// Entry by entry the least of the cells of each face's corners.
    ///
    /// # Safety
    /// `faces` are [`COUNT`](Self::COUNT) packed faces whose corners have cells from `cells` on.
    unsafe fn gather_cells(cells: *const Cells, faces: *const u32) -> Self::Words;
    /// Entry by entry the greater of two cells.
    fn greatest_cells(a: Self::Words, b: Self::Words) -> Self::Words;
    /// Of cells: the lanes that have no place on the screen, and those of boxes that hold a pixel and of those the
    /// ones of at most `side` pixels each way.
    fn judge_cells(cells: Self::Words, side: i16) -> [u32; 3];
    /// Writes the words and faces of the lanes that are set, one after the other.
    ///
    /// # Safety
    /// `faces` are [`COUNT`](Self::COUNT) each, and there is room for as many from all places to write to on.
    unsafe fn append_cells(
        mask: u32,
        cells: Self::Words,
        faces: [*const u32; 2],
        cells_to: *mut Cells,
        faces_to: [*mut u32; 2],
    );
    /// The four entries of each of some [`Cells`].
    ///
    /// # Safety
    /// As said of the trait.
    unsafe fn load_cells(from: *const Cells) -> [Self; 4];
    /// Writes the cells of vertices: columns and rows rounded up, and the negatives of those rounded down, brought
    /// into the range of 16 bits; [`UNSEEN`] where the mask is not set.
    ///
    /// # Safety
    /// As said of the trait.
    unsafe fn store_cells(up: [Self; 2], down: [Self; 2], mask: Self::Mask, to: *mut Cells);
    /// Writes vertices.
    ///
    /// # Safety
    /// As said of the trait.
    unsafe fn store_vertices(vertices: [Self; 4], to: *mut Vertex);

    /// What faces add to keys ([`frame::tag`](super::frame::tag)).
    ///
    /// # Safety
    /// As said of the trait.
    unsafe fn tags(faces: *const u32) -> Self::Words;
    /// The same word in each lane.
    fn splat_word(word: u64) -> Self::Words;
    /// # Safety
    /// As said of the trait.
    unsafe fn load_words(from: *const u64) -> Self::Words;
    /// The words of values within [`KEY_RANGE`](super::triangle::KEY_RANGE), with what their faces add.
    fn words<const PERSPECTIVE: bool>(values: Self, tags: Self::Words) -> Self::Words;
    /// # Safety
    /// As said of the trait.
    unsafe fn store_words(words: Self::Words, to: *mut u64);
    /// Lane by lane the lesser.
    fn lesser(a: Self::Words, b: Self::Words) -> Self::Words;
    /// Where `a` is greater.
    fn greater(a: Self::Words, b: Self::Words) -> Self::Mask;
    /// Where the mask is set, the greater of what is at `at` and `words`; elsewhere what is there is written again.
    ///
    /// # Safety
    /// As said of the trait.
    unsafe fn deepen(mask: Self::Mask, words: Self::Words, at: *mut u64);
    /// Appends the lanes whose bits are set: their words, and `first` and their steps from there.
    ///
    /// # Safety
    /// As said of the trait, of all pointers.
    unsafe fn append(
        bits: u32,
        words: Self::Words,
        first: u32,
        steps: *const u32,
        words_to: *mut u64,
        places_to: *mut u32,
    );
}

/// First column and row, and the negatives of the last, of the pixels whose centres something may cover.
pub type Cells = [i16; 4];

/// The cells of what has no place on the screen.
pub const UNSEEN: Cells = [i16::MIN; 4];

/// How the bits of a value become a word: what is subtracted, and the bits that are kept once shifted.
const SHIFT: u32 = FACE_BITS - DROPPED;
const KEPT: u64 = !((1 << FACE_BITS) - 1);

const fn terms(perspective: bool) -> [u64; 2] {
    key_terms(if perspective { Projection::Perspective } else { Projection::Orthographic })
}

/// Something to be computed with the widest registers at hand.
pub trait Kernel {
    type Output;
    /// Must be `#[inline(always)]`, as all that it calls with lanes.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// The instruction sets that the kernels are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum InstructionSet {
    /// Plain Rust on four lanes, for any processor.
    Portable,
    /// Four lanes.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// Eight lanes.
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// What was chosen by [`InstructionSet::choose`], as a number; [`NONE`] before.
static CHOSEN: AtomicU8 = AtomicU8::new(NONE);

const NONE: u8 = u8::MAX;

impl InstructionSet {
    /// All that were compiled, the best last.
    const ALL: &'static [Self] = &[
        Self::Portable,
        #[cfg(target_arch = "x86_64")]
        Self::Avx2,
        #[cfg(target_arch = "x86_64")]
        Self::Avx512,
    ];

    /// What is used: the best that this processor has, unless another was [chosen](Self::choose).
    pub fn best() -> Self {
        static BEST: OnceLock<InstructionSet> = OnceLock::new();
        match Self::ALL.get(usize::from(CHOSEN.load(Ordering::Relaxed))) {
            Some(&chosen) => chosen,
            None => *BEST.get_or_init(|| Self::available().last().copied().unwrap_or(Self::Portable)),
        }
    }

    /// Those that this processor has, the best last.
    pub fn available() -> Vec<Self> {
        Self::ALL.iter().copied().filter(|set| set.is_there()).collect()
    }

    /// Lets the whole process use another set than the best: answers stay the same to the bit, times do not.
    ///
    /// # Errors
    /// The processor, or the build, has none of this name.
    pub fn choose(name: &str) -> Result<(), Error> {
        let available = Self::available();
        let Some(&set) = available.iter().find(|set| set.name() == name) else {
            let names: Vec<_> = available.into_iter().map(Self::name).collect();
            return Err(Error::Invalid(format!("instruction set must be one of {names:?}, got {name:?}")));
        };
        CHOSEN.store(set as u8, Ordering::Relaxed);
        Ok(())
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Portable => "portable",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "AVX-512",
        }
    }

    fn is_there(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => avx2::is_there(),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => avx512::is_there(),
        }
    }

    /// Runs a kernel; `self` must be [`available`](Self::available).
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        assert!(self.is_there(), "the processor has no {}", self.name());
        match self {
            Self::Portable => kernel.run::<portable::Four>(),
            // SAFETY: the processor has the features that the function is compiled for.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { avx2::run(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { avx512::run(kernel) },
        }
    }
}
