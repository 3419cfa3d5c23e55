//! Where a face might show though the picture does not show it: around samples that are not nearer than the face is
//! there.

use crate::camera::Projection;
use crate::render::frame::{Band, TILE, tag};
use crate::render::lanes::Lanes;
use crate::render::pyramid::{PixelBox, Pyramid};
use crate::render::triangle::{KEY_RANGE, Nearness, Triangle};
use crate::render::view::{Vertex, View};
use glam::DVec3;
use std::ops::Range;

/// How far beyond its corners a face's box reaches, so that it has the samples around it.
pub const RING: f64 = 1.0;

/// Columns that one word holds.
const WORD: usize = 64;

/// Some pixels of a box.
#[derive(Default)]
pub struct Unclear {
    area: PixelBox,
    /// Columns come in words from this one on.
    left: usize,
    /// Words in a row.
    words: usize,
    bits: Vec<u64>,
    wide: Vec<u64>,
}

impl Unclear {
    /// Finds the samples of a face's box, with [`RING`] around it, that leave open whether the face shows there. Whether
    /// there are any.
    #[inline(always)]
    pub fn look<L: Lanes>(
        &mut self,
        pyramid: &mut Pyramid,
        band: &Band<'_>,
        view: &View,
        corners: &[Vertex; 3],
        area: PixelBox,
    ) -> bool {
        let Some(triangle) = Triangle::new(view, corners) else { return false };
        match view.projection {
            Projection::Perspective => self.find::<L, true>(pyramid, band, view, Near::new(&triangle), area),
            Projection::Orthographic => {
                self.find::<L, false>(pyramid, band, view, Near::new(&triangle), area)
            }
        }
    }

    #[inline(always)]
    fn find<L: Lanes, const PERSPECTIVE: bool>(
        &mut self,
        pyramid: &mut Pyramid,
        band: &Band<'_>,
        view: &View,
        near: Near<'_, L, PERSPECTIVE>,
        area: PixelBox,
    ) -> bool {
        self.left = area.x.start / WORD * WORD;
        self.words = (area.x.end - self.left).div_ceil(WORD);
        self.bits.clear();
        self.bits.resize(self.words * area.y.len(), 0);
        let at_border = in_border(&area.x, view.width) || in_border(&area.y, view.height);
        let mut any = false;
        for top in (area.y.start / TILE * TILE..area.y.end).step_by(TILE) {
            for left in (area.x.start / TILE * TILE..area.x.end).step_by(TILE) {
                let block = PixelBox {
                    x: left.max(area.x.start)..(left + TILE).min(area.x.end),
                    y: top.max(area.y.start)..(top + TILE).min(area.y.end),
                };
                if near.misses(view, &block) {
                    continue;
                }
                if !at_border && pyramid.all_greater::<L>(band, &block, near.nearest(view, &block)) {
                    continue;
                }
                // The block's columns, of its tile's.
                let wanted = ((1_u32 << block.x.len()) - 1) << (block.x.start - left);
                for y in block.y {
                    for first in (left..left + TILE).step_by(L::COUNT) {
                        let at = (y - band.rows.start) * band.stride + first;
                        let samples = &band.samples[at..at + L::COUNT];
                        // SAFETY: the slice holds a register of samples.
                        let samples = unsafe { L::load_words(samples.as_ptr()) };
                        let (close, hidden) = near.test(view, first, y, samples);
                        let close = close & wanted >> (first - left);
                        let open = if at_border { close } else { close & !hidden };
                        let column = first - self.left;
                        let word = (y - area.y.start) * self.words + column / WORD;
                        self.bits[word] |= u64::from(open) << (column % WORD);
                        any |= open != 0;
                    }
                }
            }
        }
        self.area = area;
        any
    }

    /// Adds the samples beside those that were found, and leaves out what is beyond the box.
    pub fn widen(&mut self) {
        let (words, rows) = (self.words, self.area.y.len());
        self.wide.clear();
        for row in 0..rows {
            for word in 0..words {
                let mut all = 0;
                for row in row.saturating_sub(1)..(row + 2).min(rows) {
                    let at = row * words;
                    let before = if word > 0 { self.bits[at + word - 1] } else { 0 };
                    let after = if word + 1 < words { self.bits[at + word + 1] } else { 0 };
                    let here = self.bits[at + word];
                    all |= here | here << 1 | before >> (WORD - 1) | here >> 1 | after << (WORD - 1);
                }
                self.wide.push(all);
            }
        }
    }

    /// Whether a pixel of the box is among those of [`widen`](Self::widen).
    #[inline(always)]
    pub fn has(&self, x: usize, y: usize) -> bool {
        let PixelBox { x: columns, y: rows } = &self.area;
        if !columns.contains(&x) || !rows.contains(&y) {
            return false;
        }
        let (column, row) = (x - self.left, y - rows.start);
        self.wide[row * self.words + column / WORD] >> (column % WORD) & 1 == 1
    }

    /// The columns and rows of the pixels of [`widen`](Self::widen).
    #[inline(always)]
    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        let rows = self.wide.chunks_exact(self.words.max(1)).zip(self.area.y.clone());
        let words =
            rows.flat_map(|(row, y)| row.iter().zip((self.left..).step_by(WORD)).map(move |word| (word, y)));
        let all = words.flat_map(|((&word, left), y)| {
            std::iter::successors(Some(word), |rest| Some(rest & rest.wrapping_sub(1)))
                .take_while(|&rest| rest != 0)
                .map(move |rest| (left + rest.trailing_zeros() as usize, y))
        });
        all.filter(|(x, _)| self.area.x.contains(x))
    }
}

/// Squares of [`TILE`] pixels in which something may show that the picture does not.
#[derive(Default)]
pub struct Busy {
    columns: usize,
    tiles: Vec<bool>,
}

impl Busy {
    /// None, of an image of this size.
    pub fn clear(&mut self, view: &View) {
        self.columns = view.width.div_ceil(TILE);
        self.tiles.clear();
        self.tiles.resize(self.columns * view.height.div_ceil(TILE), false);
    }

    /// Adds those of a face's pixels.
    pub fn add(&mut self, unclear: &Unclear) {
        for (x, y) in unclear.pixels() {
            self.tiles[y / TILE * self.columns + x / TILE] = true;
        }
    }

    /// Their columns and rows.
    pub fn squares(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let busy = self.tiles.iter().enumerate().filter(|&(_, &busy)| busy);
        busy.map(|(tile, _)| [(tile % self.columns) as u32, (tile / self.columns) as u32])
    }
}

/// A face, as far as samples within [`RING`] of it go.
struct Near<'a, L: Lanes, const PERSPECTIVE: bool> {
    triangle: &'a Triangle,
    edges: [[L; 3]; 3],
    plane: [L; 3],
}

impl<'a, L: Lanes, const PERSPECTIVE: bool> Near<'a, L, PERSPECTIVE> {
    #[inline(always)]
    fn new(triangle: &'a Triangle) -> Self {
        let [e0, e1, e2] = triangle.edges;
        let edge = |n: DVec3| [L::splat(n.x), L::splat(n.y), L::splat(n.z + RING * (n.x.abs() + n.y.abs()))];
        let n = triangle.plane;
        let reach = RING * (n.x.abs() + n.y.abs());
        let reach = if PERSPECTIVE { reach } else { -reach };
        Self {
            triangle,
            edges: [edge(e0), edge(e1), edge(e2)],
            plane: [L::splat(n.x), L::splat(n.y), L::splat(n.z + reach)],
        }
    }

    /// Whether a block's samples all lie outside one edge.
    #[inline(always)]
    fn misses(&self, view: &View, block: &PixelBox) -> bool {
        let [e0, e1, e2] = self.triangle.edges.each_ref();
        let [(a, p), (b, q), (c, r)] = [over(view, block, e0), over(view, block, e1), over(view, block, e2)];
        (a + p).min(b + q).min(c + r) < 0.0
    }

    /// No sample in or around a block is greater.
    #[inline(always)]
    fn nearest(&self, view: &View, block: &PixelBox) -> u64 {
        let (value, reach) = over(view, block, &self.triangle.plane);
        let value = if PERSPECTIVE { value + reach } else { value - reach };
        let [low, high] = self.triangle.range;
        Nearness(value.max(low).min(high)).key(view.projection) | tag(0)
    }

    /// Which of some samples lie within [`RING`] of the face, and which are nearer than all of it within that.
    #[inline(always)]
    fn test(&self, view: &View, first: usize, y: usize, samples: L::Words) -> (u32, u32) {
        let x = L::ramp().add(L::splat(view.column(first)));
        let y = L::splat(view.row(y));
        let zero = L::splat(0.0);
        let mut close = at(&self.edges[0], x, y).ge(zero);
        close = L::and(close, at(&self.edges[1], x, y).ge(zero));
        close = L::and(close, at(&self.edges[2], x, y).ge(zero));
        // As samples are: of a face parallel to the image rounding alone would tell.
        let [low, high] = self.triangle.range;
        let value = at(&self.plane, x, y).max(L::splat(low)).min(L::splat(high));
        let value = value.max(L::splat(KEY_RANGE[0])).min(L::splat(KEY_RANGE[1]));
        let words = L::words::<PERSPECTIVE>(value, L::splat_word(tag(0)));
        (L::bits(close), L::bits(L::greater(samples, words)))
    }
}

/// A plane's value at a block's middle, and by how much more it is somewhere within [`RING`] of its samples, where it may
/// have been rounded in another order.
#[inline(always)]
fn over(view: &View, block: &PixelBox, n: &DVec3) -> (f64, f64) {
    let (left, right) = (view.column(block.x.start), view.column(block.x.end - 1));
    let (top, bottom) = (view.row(block.y.start), view.row(block.y.end - 1));
    let (across, down) = (0.5 * (right - left) + RING, 0.5 * (bottom - top) + RING);
    let (x, y) = (0.5 * (left + right), 0.5 * (top + bottom));
    let size = n.x.abs() * (x.abs() + across) + n.y.abs() * (y.abs() + down) + n.z.abs();
    (n.x * x + n.y * y + n.z, n.x.abs() * across + n.y.abs() * down + ROUNDING * size)
}

/// Of two sums of three terms each, of the sum of their sizes.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A plane over the image.
#[inline(always)]
fn at<L: Lanes>(plane: &[L; 3], x: L, y: L) -> L {
    plane[0].mul(x).add(plane[1].mul(y).add(plane[2]))
}

/// Whether part of a range of samples may lie outside the outermost samples and little of it between them: of what
/// is in the strip along the image's border the picture shows one side only.
pub fn in_border(range: &Range<usize>, size: usize) -> bool {
    (range.start == 0 || range.end == size) && range.len() <= 2
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::clusters::Clusters;
    use crate::render::fixtures::{cameras, meshes};
    use crate::render::frame::{Frame, key};
    use crate::render::lanes::{InstructionSet, Kernel};
    use crate::render::raster::{Painter, pixel_box};
    use proptest::prelude::*;

    struct Look<'a, 'b> {
        unclear: &'a mut Unclear,
        band: &'a Band<'b>,
        view: &'a View,
        corners: &'a [Vertex; 3],
        area: PixelBox,
    }

    impl Kernel for Look<'_, '_> {
        type Output = bool;

        #[inline(always)]
        fn run<L: Lanes>(self) -> bool {
            let mut pyramid = Pyramid::default();
            pyramid.read(self.band);
            self.unclear.look::<L>(&mut pyramid, self.band, self.view, self.corners, self.area)
        }
    }

    proptest! {
        /// Wherever a face covers a sample that is not nearer than it, and beside that; and the same for all sets.
        #[test]
        fn samples_behind_a_face_are_unclear(mesh in meshes(), camera in cameras(), shown in 1_usize..4) {
            let view = View::new(&mesh, &camera);
            let count = mesh.faces().len() as u32;
            let clusters = Clusters::new(&mesh, (0..count).step_by(shown));
            let mut frame = Frame::default();
            frame.clear(view.width, view.height);
            Painter::default().draw(InstructionSet::best(), &view, &clusters, &mut frame.whole());
            let band = frame.whole();
            for face in (0..count).take(40) {
                let corners = &view.project_face(&mesh, face);
                let Some(triangle) = Triangle::new(&view, corners) else { continue };
                let Some(area) = pixel_box(&view, corners, &band.rows, RING) else { continue };
                let mut found = Vec::new();
                for set in InstructionSet::available() {
                    let mut unclear = Unclear::default();
                    let look =
                        Look { unclear: &mut unclear, band: &band, view: &view, corners, area: area.clone() };
                    let any = set.run(look);
                    unclear.widen();
                    prop_assert_eq!(any, unclear.pixels().count() > 0);
                    found.push(unclear);
                }
                for y in area.y.clone() {
                    for x in area.x.clone() {
                        let has = found[0].has(x, y);
                        prop_assert!(found.iter().all(|unclear| unclear.has(x, y) == has));
                        prop_assert_eq!(found[0].pixels().any(|pixel| pixel == (x, y)), has);
                        let sample = key(band.samples[y * band.stride + x]);
                        if triangle.hit(view.column(x), view.row(y)).is_some_and(|n| n.key(view.projection) >= sample) {
                            for (x, y) in [(x, y), (x.saturating_sub(1), y), (x, y + 1), (x + 1, y.saturating_sub(1))] {
                                prop_assert!(found[0].has(x, y) || !area.x.contains(&x) || !area.y.contains(&y));
                            }
                        }
                    }
                }
            }
        }

        /// Also across the words that columns come in.
        #[test]
        fn wide_are_the_pixels_and_those_beside_them(
            left in 50_usize..70,
            width in 1_usize..150,
            height in 1_usize..4,
            marks in prop::collection::vec((any::<usize>(), any::<usize>()), 0..6),
        ) {
            let area = PixelBox { x: left..left + width, y: 7..7 + height };
            let first = left / WORD * WORD;
            let words = (area.x.end - first).div_ceil(WORD);
            let mut unclear =
                Unclear { area: area.clone(), left: first, words, bits: vec![0; words * height], ..Unclear::default() };
            let marks: Vec<_> = marks.iter().map(|(x, y)| (left + x % width, 7 + y % height)).collect();
            for &(x, y) in &marks {
                unclear.bits[(y - 7) * words + (x - first) / WORD] |= 1 << ((x - first) % WORD);
            }
            unclear.widen();
            for y in area.y.clone() {
                for x in area.x.clone() {
                    let beside = marks.iter().any(|mark| mark.0.abs_diff(x) <= 1 && mark.1.abs_diff(y) <= 1);
                    prop_assert_eq!(unclear.has(x, y), beside);
                    prop_assert_eq!(unclear.pixels().any(|pixel| pixel == (x, y)), beside);
                }
            }
        }
    }
}
