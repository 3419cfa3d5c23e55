//! A cluster made ready for drawing: its vertices projected, its faces sorted by their boxes.

use super::super::clusters::{Cluster, MOST_FACES, PADDING, unpack};
use super::super::lanes::{Cells, Lanes, MOST_LANES, TABLE, UNSEEN};
use super::super::pyramid::PixelBox;
use super::super::view::{Vertex, View};

/// Faces that a box, side by side; the ends are padded so that whole registers can be read.
pub struct List {
    pub count: usize,
    /// Packed corners ([`unpack`]).
    pub corners: [u32; MOST_FACES + MOST_LANES],
    pub ids: [u32; MOST_FACES + MOST_LANES],
    pub cells: [Cells; MOST_FACES + MOST_LANES],
}

impl List {
    pub const EMPTY: Self = Self {
        count: 0,
        corners: [0; MOST_FACES + MOST_LANES],
        ids: [0; MOST_FACES + MOST_LANES],
        cells: [[0; 4]; MOST_FACES + MOST_LANES],
    };

    /// Appends the lanes of `mask`, faces and ids from `from` on.
    #[inline(always)]
    fn append<L: Lanes>(&mut self, mask: u32, cells: L::Words, from: [*const u32; 2]) {
        let at = self.count;
        assert!(at <= MOST_FACES);
        // SAFETY: `from` has a register of entries, and so have the arrays from `at` on.
        unsafe {
            let to = [self.corners.as_mut_ptr().add(at), self.ids.as_mut_ptr().add(at)];
            L::append_cells(mask, cells, from, self.cells.as_mut_ptr().add(at), to);
        }
        self.count += mask.count_ones() as usize;
    }

    /// Appends an entry of another list.
    #[inline(always)]
    pub fn copy(&mut self, other: &Self, entry: usize) {
        self.push(other.corners[entry], other.ids[entry], other.cells[entry]);
    }

    /// Appends a face and its box.
    #[inline(always)]
    pub fn push(&mut self, corners: u32, id: u32, cells: Cells) {
        let at = self.count;
        self.corners[at] = corners;
        self.ids[at] = id;
        self.cells[at] = cells;
        self.count += 1;
    }

    /// The pixels of an entry.
    #[inline(always)]
    pub fn area(&self, entry: usize) -> PixelBox {
        let [left, top, right, bottom] = self.cells[entry];
        let end = |last: i16| (1 - i32::from(last)) as usize;
        PixelBox { x: left as usize..end(right), y: top as usize..end(bottom) }
    }
}

/// Vertices on the image as float32, to be on the safe side with.
pub struct Screen {
    /// Columns and rows from a pixel's centre on, rounded to the nearest; NaN at and behind the eye's plane.
    pub x: [f32; TABLE],
    pub y: [f32; TABLE],
    /// [Values](Vertex::value), rounded towards the eye.
    pub near: [f32; TABLE],
}

/// Depths below this are treated as behind the eye: products of them would vanish. Orthographic ones are 1.
const LEAST_DEPTH: f64 = 1e-60;

/// What a rounding to float32 is made up for with.
const ROUNDING: f64 = f32::EPSILON as f64;

/// Room for one cluster.
pub struct Projected {
    pub vertices: [Vertex; TABLE],
    cells: [Cells; TABLE],
    pub screen: Screen,
    pub small: List,
    pub large: List,
    /// Faces with a corner at or behind the eye's plane, and what else wants a closer look.
    pub straddling: List,
}

impl Default for Projected {
    fn default() -> Self {
        Self {
            vertices: [Vertex::default(); TABLE],
            cells: [UNSEEN; TABLE],
            screen: Screen { x: [0.0; TABLE], y: [0.0; TABLE], near: [0.0; TABLE] },
            small: List::EMPTY,
            large: List::EMPTY,
            straddling: List::EMPTY,
        }
    }
}

impl Projected {
    /// The corners of an entry of a list.
    #[inline(always)]
    pub fn corners(&self, packed: u32) -> [Vertex; 3] {
        unpack(packed).map(|vertex| self.vertices[vertex])
    }

    /// Projects the vertices, as [`View::project`] does one. Boxes will reach `reach` pixels farther.
    #[inline(always)]
    pub fn project<L: Lanes, const PERSPECTIVE: bool>(
        &mut self,
        view: &View,
        cluster: &Cluster<'_>,
        reach: f64,
    ) {
        let [xs, ys, zs] = cluster.coordinates;
        let count = xs.len();
        assert!(count <= TABLE && count.is_multiple_of(PADDING));
        assert!(ys.len() == count && zs.len() == count);
        let transform = Transform::<L>::new(view);
        let reach = L::splat(1e-6 + reach);
        for at in (0..count).step_by(L::COUNT) {
            // SAFETY: the count is a multiple of the lanes, and all arrays hold as many.
            let p = unsafe {
                [L::load(xs.as_ptr().add(at)), L::load(ys.as_ptr().add(at)), L::load(zs.as_ptr().add(at))]
            };
            let ([x, y, w, value], screen) = transform.at::<PERSPECTIVE>(p);
            let error = [error(screen[0], reach), error(screen[1], reach)];
            let up = [screen[0].sub(error[0]), screen[1].sub(error[1])];
            let down = [screen[0].add(error[0]), screen[1].add(error[1])];
            // Neither behind the eye nor beyond what can be said of it: NaN compares false.
            let finite = L::and(L::splat(1e30).gt(down[0].abs()), L::splat(1e30).gt(down[1].abs()));
            let seen = L::and(w.gt(L::splat(0.0)), finite);
            // SAFETY: as above.
            unsafe {
                L::store_vertices([x, y, w, value], self.vertices.as_mut_ptr().add(at));
                L::store_cells(up, down, seen, self.cells.as_mut_ptr().add(at));
            }
        }
    }

    /// [`project`](Self::project) to the [screen](Screen), of which `origin` is the first pixel.
    #[inline(always)]
    pub fn place<L: Lanes, const PERSPECTIVE: bool>(
        &mut self,
        view: &View,
        cluster: &Cluster<'_>,
        origin: [usize; 2],
    ) {
        let [xs, ys, zs] = cluster.coordinates;
        let count = xs.len();
        assert!(count <= TABLE && count.is_multiple_of(PADDING));
        assert!(ys.len() == count && zs.len() == count);
        let transform = Transform::<L>::new(view);
        let [left, top] = origin.map(|first| L::splat(first as f64));
        // Products of any farther would overflow.
        let most = L::splat(1e15);
        for at in (0..count).step_by(L::COUNT) {
            // SAFETY: the count is a multiple of the lanes, and all arrays hold as many.
            let p = unsafe {
                [L::load(xs.as_ptr().add(at)), L::load(ys.as_ptr().add(at)), L::load(zs.as_ptr().add(at))]
            };
            let (vertices, screen) = transform.at::<PERSPECTIVE>(p);
            let [_, _, w, value] = vertices;
            let (x, y) = (screen[0].sub(left), screen[1].sub(top));
            let finite = L::and(most.gt(x.abs()), most.gt(y.abs()));
            let seen = L::and(w.gt(L::splat(LEAST_DEPTH)), finite);
            // Orthographic values grow away from the eye.
            let rounding = value.abs().mul(L::splat(ROUNDING));
            let near = if PERSPECTIVE { value.add(rounding) } else { value.sub(rounding) };
            // SAFETY: as above.
            unsafe {
                L::store_vertices(vertices, self.vertices.as_mut_ptr().add(at));
                L::select(seen, x, L::splat(f64::NAN)).store_f32(self.screen.x.as_mut_ptr().add(at));
                y.store_f32(self.screen.y.as_mut_ptr().add(at));
                near.store_f32(self.screen.near.as_mut_ptr().add(at));
            }
        }
    }

    /// Sorts the faces into the lists, by their boxes within `area`; small are those of at most `side` pixels each way.
    #[inline(always)]
    pub fn sort<L: Lanes>(&mut self, cluster: &Cluster<'_>, area: &PixelBox, side: i16) {
        (self.small.count, self.large.count, self.straddling.count) = (0, 0, 0);
        let Cluster { corners, ids, count, .. } = *cluster;
        assert!(corners.len() == ids.len() && corners.len().is_multiple_of(MOST_LANES));
        assert!(count <= corners.len() && corners.len() <= MOST_FACES);
        let [left, top] = [area.x.start, area.y.start].map(|first| u64::from(first as u16));
        let [right, bottom] = [area.x.end, area.y.end].map(|end| u64::from((1 - end as i32) as u16));
        let least = L::splat_word(left | top << 16 | right << 32 | bottom << 48);
        for at in (0..count).step_by(L::COUNT) {
            let real = (1_u32 << (count - at).min(L::COUNT)) - 1;
            let from = [corners[at..].as_ptr(), ids[at..].as_ptr()];
            // SAFETY: corners and ids come in whole registers, and a byte of a face is a vertex of its cluster or, at
            // worst, one of the others that there is room for.
            let cells = unsafe { L::gather_cells(self.cells.as_ptr(), from[0]) };
            let unseen = L::judge_cells(cells, side)[0] & real;
            let cells = L::greatest_cells(cells, least);
            let [_, some, small] = L::judge_cells(cells, side);
            let some = some & !unseen & real;
            self.small.append::<L>(some & small, cells, from);
            if some & !small != 0 {
                self.large.append::<L>(some & !small, cells, from);
            }
            if unseen != 0 {
                self.straddling.append::<L>(unseen, cells, from);
            }
        }
    }
}

/// [`View::project`] and [`View::screen`] for several points.
struct Transform<L: Lanes> {
    x: [L; 4],
    y: [L; 4],
    w: [L; 4],
    depth: [L; 4],
    half: [L; 2],
}

impl<L: Lanes> Transform<L> {
    #[inline(always)]
    fn new(view: &View) -> Self {
        let m = &view.matrix;
        Self {
            x: splat([m.x_axis.x, m.y_axis.x, m.z_axis.x, view.offset.x]),
            y: splat([m.x_axis.y, m.y_axis.y, m.z_axis.y, view.offset.y]),
            w: splat([m.x_axis.z, m.y_axis.z, m.z_axis.z, view.offset.z]),
            depth: splat([view.axis.x, view.axis.y, view.axis.z, view.distance]),
            half: [L::splat(view.half()[0]), L::splat(view.half()[1])],
        }
    }

    /// Homogeneous coordinates and values; columns and rows.
    #[inline(always)]
    fn at<const PERSPECTIVE: bool>(&self, p: [L; 3]) -> ([L; 4], [L; 2]) {
        let (x, y, w) = (along(self.x, p), along(self.y, p), along(self.w, p));
        let inverse = L::splat(1.0).div(w);
        let value = if PERSPECTIVE { inverse } else { along(self.depth, p) };
        ([x, y, w, value], [x.mul(inverse).add(self.half[0]), y.mul(inverse).add(self.half[1])])
    }
}

#[inline(always)]
fn splat<L: Lanes>(m: [f64; 4]) -> [L; 4] {
    [L::splat(m[0]), L::splat(m[1]), L::splat(m[2]), L::splat(m[3])]
}

/// `m . (p, 1)`, in the order of [`View::project`].
#[inline(always)]
fn along<L: Lanes>(m: [L; 4], p: [L; 3]) -> L {
    m[0].mul(p[0]).add(m[1].mul(p[1])).add(m[2].mul(p[2])).add(m[3])
}

/// [`screen_error`](super::super::view::screen_error), its absolute part and more in `reach`.
#[inline(always)]
fn error<L: Lanes>(coordinate: L, reach: L) -> L {
    coordinate.abs().mul(L::splat(2.0 * f64::from(f32::EPSILON))).add(reach)
}
